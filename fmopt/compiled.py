"""Numeric kernels: plain loops over arrays of a few numbers, which Numba compiles when they are first called.

What is compiled stays beside the source, or in the user's cache, for later processes. Numba looks at the file of a
kernel alone to tell whether that is still valid: kernels call only kernels of their own file.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

from numba import njit

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """A kernel: a function of numbers and contiguous arrays, compiled; `py_func` is the function as it is written.

    Where no folder for what is compiled can be written to, each process compiles anew.
    """
    settings = {"error_model": "numpy"}
    try:
        kernel = njit(cache=True, **settings)(function)
    except RuntimeError:  # no folder to keep it in
        kernel = njit(**settings)(function)
    return cast("Callable[P, R]", kernel)
