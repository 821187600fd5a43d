"""Frozen values: arrays inside are copied, float64, checked and read-only, also after unpickling."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def frozen(values: ArrayLike, *shape: int | None, name: str = "array") -> Array:
    """A read-only float64 copy of `values`, whatever their unit.

    Args:
        values: numbers, of any shape (…,).
        shape: expected length of each axis, None for any; no shape means any shape.
        name: what to call the array in an error.

    Raises:
        ValueError: the shape differs, or a number is not finite.
    """
    array = np.array(values, dtype=np.float64, order="C")
    if shape and array.shape != shape:
        fits = (n in (None, m) for n, m in zip(shape, array.shape, strict=True))
        if array.ndim != len(shape) or not all(fits):
            raise ValueError(f"{name} has shape {array.shape}, expected {shape}")
    flat = array.reshape(-1)
    # One product tells in a quarter of the time, unless squares are beyond all numbers.
    if not (math.isfinite(flat.dot(flat)) or np.isfinite(array).all()):
        raise ValueError(f"{name} holds a number that is not finite")
    array.setflags(write=False)
    return array


class Value:
    """Base of frozen dataclasses that hold arrays: they stay read-only through pickling."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        for key, value in state.items():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
            object.__setattr__(self, key, value)
