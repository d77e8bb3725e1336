"""What of the compiled code a process has ready."""

import importlib
import pkgutil
from typing import Any

import slam.kernels


def loaded() -> set[tuple[str, Any]]:
    """Name and signature of each kernel that was compiled, or loaded from the cache."""
    names = [module.name for module in pkgutil.iter_modules(slam.kernels.__path__)]
    modules = [importlib.import_module(f"slam.kernels.{name}") for name in names]
    return {
        (kernel.__name__, signature)
        for module in modules
        for kernel in vars(module).values()
        for signature in getattr(kernel, "signatures", ())
    }
