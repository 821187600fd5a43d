"""Frozen values: arrays inside are copied, float64, checked and read-only, also after unpickling.

What has been worked out about an object, kept with it: the memory goes when the object does.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache, wraps
from typing import Any, ClassVar, Concatenate, ParamSpec, TypeVar
from weakref import ref

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Bits = NDArray[np.bool_]
Indices = NDArray[np.intp]

T = TypeVar("T")
R = TypeVar("R")
P = ParamSpec("P")
_PLACE = "_remembered"


def frozen(values: ArrayLike, *shape: int | None, name: str = "array") -> Array:
    """A read-only float64 copy of `values`, whatever their unit, of a shape (…,) with None for any length, or any.

    Raises:
        ValueError: the shape differs, or a number is not finite.
    """
    array = np.array(values, dtype=np.float64, order="C")
    if shape and array.shape != shape:
        # A copy: a frozen record around somebody else's array could be changed from outside.
        fits = (n in (None, m) for n, m in zip(shape, array.shape, strict=True))
        if array.ndim != len(shape) or not all(fits):
            raise ValueError(f"{name} has shape {array.shape}, expected {shape}")
    flat = array.reshape(-1)
    # One product tells in a quarter of the time, unless squares are beyond all numbers.
    if not (math.isfinite(flat.dot(flat)) or np.isfinite(array).all()):
        raise ValueError(f"{name} holds a number that is not finite")
    array.setflags(write=False)
    return array


def fixed(array: Array) -> Array:
    """A view that takes nothing of an array of any shape (…,), whatever its unit.

    A kernel that is given such is compiled once, whether the arrays themselves can be written to or not.
    """
    view = array.view()
    view.setflags(write=False)
    return view


class Value:
    """Base of frozen dataclasses that hold arrays: they stay read-only through pickling.

    A class names the shapes of its arrays, `class Stop(Value, gain=(6,))`: each is copied and checked as by `frozen`.
    A name among the numbers of a shape stands for how many entries that field has; errors call a field by its label.
    """

    _shapes: ClassVar[Mapping[str, tuple[int | str | None, ...]]] = {}
    _labels: ClassVar[Mapping[str, str]] = {}

    def __init_subclass__(cls, labels: Mapping[str, str] | None = None, **shapes: tuple[int | str | None, ...]) -> None:
        cls._shapes, cls._labels = {**cls._shapes, **shapes}, {**cls._labels, **(labels or {})}

    def __post_init__(self) -> None:
        for name, shape in self._shapes.items():
            sizes = (len(getattr(self, n)) if isinstance(n, str) else n for n in shape)
            label = self._labels.get(name, name.replace("_", " "))
            object.__setattr__(self, name, frozen(getattr(self, name), *sizes, name=label))

    def __setstate__(self, state: dict[str, Any]) -> None:
        for key, value in state.items():
            if isinstance(value, np.ndarray):
                # Pickling forgets the flag, so that a value sent to a worker would be writable.
                value.setflags(write=False)
            object.__setattr__(self, key, value)


class _Memory(dict[Any, Any]):
    """Results by function, in the process that found them: copies and what is sent to others start without."""

    def __reduce__(self) -> "tuple[type[_Memory], tuple[()]]":
        # What is remembered is cheap to find again and may hold references back to its owner.
        return _Memory, ()


def _of(function: Callable[Concatenate[T, P], R], owner: ref[T]) -> Callable[P, R]:
    """The function of an object that does not live on for it: a cycle would wait for the garbage collector."""

    def found(*arguments: P.args, **named: P.kwargs) -> R:
        return function(there(owner), *arguments, **named)

    return found


def there(owner: ref[T]) -> T:
    """The object, which is there as long as somebody asks for what it remembers."""
    found = owner()
    assert found is not None
    return found


def remembered(most: int) -> Callable[[Callable[Concatenate[T, P], R]], Callable[Concatenate[T, P], R]]:
    """Keeps the latest results of a pure function with its first argument, an object that does not change.

    A cache of the function's own would hold on to objects that nobody uses any more: a worker that plans one problem
    after the other would grow by each of them.
    """

    def decorated(function: Callable[Concatenate[T, P], R]) -> Callable[Concatenate[T, P], R]:
        @wraps(function)
        def found(owner: T, /, *arguments: P.args, **named: P.kwargs) -> R:
            # In the object's own dictionary, past the frozen dataclass's guard: it is no part of the value, nor of its
            # pickle.
            memory = owner.__dict__.get(_PLACE)
            if memory is None:
                memory = owner.__dict__[_PLACE] = _Memory()
            if function not in memory:
                memory[function] = lru_cache(maxsize=most)(_of(function, ref(owner)))
            kept: Callable[P, R] = memory[function]
            return kept(*arguments, **named)

        return found

    return decorated


@dataclass(frozen=True, eq=False)
class Framing(Value, hole=(6,), hand=(6,)):
    """Shares (6,), from 0 to 1, of the start error that turn with the fixed part (`hole`) and with the other (`hand`).

    What is left stays as it is in the world: the robot's own error, which neither part turns with.
    """

    hole: Array
    hand: Array

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.hole < 0.0).any() or (self.hand < 0.0).any() or (self.hole + self.hand > 1.0 + 1e-12).any():
            raise ValueError("shares of an error lie between 0 and 1, and so do their sums")

    @property
    def still(self) -> bool:
        """Whether all errors are fixed in the world."""
        return not (self.hole.any() or self.hand.any())

    def parts(self, box: Array) -> tuple[Array, Array, Array]:
        """The half-widths (6,) of a box that are fixed in the hole, in the hand and in the world; they add up to it."""
        hole, hand = self.hole * box, self.hand * box
        return hole, hand, np.maximum(box - hole - hand, 0.0)


IN_THE_WORLD = Framing(frozen([0.0] * 6), frozen([0.0] * 6))
"""All errors are fixed in the world."""
