"""Inner loops, compiled by Numba: arrays and numbers in, arrays and numbers out, no policy."""

from collections.abc import Callable
from typing import Any

from numba import njit
from numpy.typing import NDArray


def _kept(**options: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Numba's decorator, its code kept on disk; compiled anew in each process where no disk may be
    written: a container whose root, home and all, is read-only."""

    def compile_(function: Callable[..., Any]) -> Callable[..., Any]:
        try:
            compiled: Callable[..., Any] = njit(cache=True, **options)(function)
        except RuntimeError as error:
            if "cannot cache" not in str(error):
                raise
            compiled = njit(**options)(function)
        return compiled

    return compile_


# Kept on disk, so that each machine compiles once. Numba renews a kernel when its own file changes,
# not when that of a kernel which it calls does: after editing one, remove slam/kernels/__pycache__.
# A division by zero gives inf, as in NumPy.
# A product and a sum may be joined in one rounding: equal bits on a machine, the last one not
# between two.
compiled = _kept(error_model="numpy", fastmath={"contract", "arcp", "nsz"})
# For sums over many points, taken several at a time: three times as fast; their order depends on
# the machine's width. No nan may come in.
compiled_vectorised = _kept(error_model="numpy", fastmath=True)


@compiled
def copy_into(source: NDArray[Any], target: NDArray[Any]) -> None:
    """The numbers of an array into another one of its shape; written with [:], or as a row, that takes
    two or three seconds to compile."""
    for i in range(source.size):
        target.flat[i] = source.flat[i]
