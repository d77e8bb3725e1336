"""Tests that draw need a way to OpenGL without a display."""

import ctypes

import pytest


def has_egl() -> bool:
    try:
        ctypes.CDLL("libEGL.so.1")
    except OSError:
        return False
    return True


needs_egl = pytest.mark.skipif(not has_egl(), reason="needs libEGL: apt-get install libegl1 libgl1")
