"""Numba's compiler for inner loops, kept on disk."""

from collections.abc import Callable
from typing import Any

from numba import njit


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Kept on disk; where no disk may be written, compiled anew in each process.

    `slam.kernels` does the same; neither package may import the other.
    """
    try:
        return njit(cache=True, nogil=True)(function)
    except RuntimeError as error:
        if "cannot cache" not in str(error):
            raise
        return njit(nogil=True)(function)
