"""Inner loops, compiled by Numba: arrays and numbers in, arrays and numbers out, no policy."""

from numba import njit

# Kept on disk, so that each machine compiles once. A division by zero gives inf, as in NumPy.
compiled = njit(cache=True, error_model="numpy")
# Multiplications and additions may be joined and divisions shared: a quarter faster, equal on each
# machine, in the last digit not equal between two.
compiled_fast = njit(cache=True, error_model="numpy", fastmath={"contract", "arcp", "nsz"})
