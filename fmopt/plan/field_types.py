"""Types of the fields of a plan's description: numbers, texts and lists, each with its bounds."""

from collections.abc import Sequence
from typing import Annotated, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import AfterValidator, ConfigDict, Field, TypeAdapter, ValidationError

from fmopt.verify.reading.reader import LABEL, LONGEST, MOST, UNSEEN, Numbers, PlanError

T = TypeVar("T")
FORM = ConfigDict(extra="forbid")


def _one_line(text: str) -> str:
    if (unseen := UNSEEN.search(text)) is not None:
        raise ValueError(f"must be one line of text, without the control character U+{ord(unseen.group()):04X}")
    return text


def one_of(*words: str) -> Any:
    """The constraint of a text to one of these words."""
    return Field(pattern=f"^(?:{'|'.join(words)})$")


Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1e6, le=1e6)]
NonNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0, le=1e6)]
Index = Annotated[int, Field(strict=True, ge=0, lt=10**6)]
Flag = Annotated[bool, Field(strict=True)]
Label = Annotated[str, Field(pattern=f"^{LABEL}$")]
Line = Annotated[str, Field(max_length=LONGEST), AfterValidator(_one_line)]
Many = Annotated[tuple[T, ...], Field(max_length=MOST)]
Six = Annotated[tuple[Number, ...], Field(min_length=6, max_length=6)]
HalfWidths = Annotated[tuple[NonNegative, ...], Field(min_length=6, max_length=6)]
Point = tuple[Number, Number]
Polyline = Many[Point]
Loops = Many[Polyline]
Pair = Annotated[Polyline, Field(min_length=2, max_length=2)]
# 0 free, stopped in one direction or the other, stopped in both.
Freedom = Annotated[int, Field(strict=True, ge=-1, le=2)]
StateVerdict = Annotated[str, one_of("confirmed", "blocked", "out_of_bounds", "split", "undecided")]
MotionKind = Annotated[str, one_of("gross", "fine", "blocked")]
MoveName = Annotated[str, Field(pattern=r"^([+-]r?[xyz]|[a-z]{1,16})$")]


def numbers(values: ArrayLike) -> Numbers:
    """Floats of an array (n,), in its unit."""
    return tuple(np.asarray(values, dtype=np.float64).tolist())


def polyline(points: ArrayLike) -> tuple[tuple[float, float], ...]:
    """Points (n, 2), in the unit of the array."""
    return tuple((u, v) for u, v in np.reshape(np.asarray(points, dtype=np.float64), (-1, 2)).tolist())


def check_indices(what: str, indices: Sequence[int], count: int) -> None:
    """Refuse indices that repeat, or that are not below `count`."""
    if len(set(indices)) != len(indices) or any(index >= count for index in indices):
        raise ValueError(f"{what} must hold different indices below {count}")


def validated(adapter: TypeAdapter[T], value: Any, name: str) -> T:
    """The value of a type that a JSON value is of.

    Raises:
        PlanError: it is none; says where in it, and what is wrong.
    """
    try:
        return adapter.validate_python(value)
    except ValidationError as error:
        fault = error.errors(include_url=False, include_input=False)[0]
        place = "".join(f"[{at}]" if isinstance(at, int) else f".{at[:40]}" for at in fault["loc"])
        words = f"{name}{place}", fault["msg"].removeprefix("Value error, ")
        raise PlanError(*(UNSEEN.sub("\N{REPLACEMENT CHARACTER}", text) for text in words)) from error
