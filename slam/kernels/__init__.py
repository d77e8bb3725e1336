"""Inner loops, compiled by Numba: arrays and numbers in, arrays and numbers out, no policy."""

from numba import njit

# Kept on disk, so that each machine compiles once. Numba renews a kernel when its own file changes,
# not when that of a kernel which it calls does: after editing one, remove slam/kernels/__pycache__.
# A division by zero gives inf, as in NumPy.
# A product and a sum may be joined in one rounding: equal bits on a machine, the last one not
# between two.
compiled = njit(cache=True, error_model="numpy", fastmath={"contract", "arcp", "nsz"})
# For sums over many points, taken several at a time: three times as fast; their order depends on
# the machine's width. No nan may come in.
compiled_vectorised = njit(cache=True, error_model="numpy", fastmath=True)
