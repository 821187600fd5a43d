"""What a lie about a plan is: one thing altered, and who can tell that it is false."""

import contextlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from random import Random
from typing import Any, TypeVar

T = TypeVar("T")
Document = dict[str, Any]
Point = list[float]
SIDES = ("moving", "fixed")
CONSTRUCTION = "construction"  # it is false whatever else holds
PROBLEM = "problem"  # it is false of the problem, and may be true of another one
SAMPLING = "sampling"  # executions tell


@dataclass(frozen=True)
class Lie:
    """A kind of lie."""

    name: str  # in a few words
    oracle: str  # who can tell that a plan with it is false: one of the constants above
    # Alters a plan in place by numbers drawn; False where the plan has nothing of the kind to lie about
    tell: Callable[[Document, Random], bool]
    settled: bool = True  # whether the dependent numbers are derived anew
    base: Callable[[], Document] | None = None  # the plan that it is told of, where it needs one of its own


class Untold(Exception):
    """A plan has nothing of the kind to lie about."""


def chosen(rng: Random, items: Sequence[T]) -> T:
    """One of several; where there is none, the lie is not told."""
    if not items:
        raise Untold
    return rng.choice(items)


def drawn(rng: Random, low: float, high: float) -> float:
    """A power of ten between two, its exponent uniform."""
    return float(10.0 ** rng.uniform(low, high))


def bodies(part: Document) -> Iterator[Document]:
    """A part's surface and its pieces."""
    yield part
    yield from part["pieces"]


def plus(a: Point, b: Point, t: float = 1.0) -> Point:
    """a + t b."""
    return [x + t * y for x, y in zip(a, b, strict=True)]


def minus(a: Point, b: Point) -> Point:
    """a − b."""
    return [x - y for x, y in zip(a, b, strict=True)]


def cross(a: Point, b: Point) -> Point:
    """a × b."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def unit(a: Point) -> Point:
    """a / |a|."""
    size = sum(x * x for x in a) ** 0.5
    return [x / size for x in a]


def centre(points: list[Point]) -> Point:
    """The mean of points."""
    return [sum(p[k] for p in points) / len(points) for k in range(3)]


def normal(vertices: list[Point], loop: list[int]) -> Point:
    """The unit normal of a loop (Newell)."""
    total, a = [0.0] * 3, vertices[loop[0]]
    for i, j in pairwise(loop[1:]):
        total = plus(total, cross(minus(vertices[i], a), minus(vertices[j], a)))
    return unit(total)


def around(loop: list[int]) -> Iterator[tuple[int, int]]:
    """The edges of a loop."""
    return zip(loop, [*loop[1:], loop[0]], strict=True)


def named(oracle: str, settled: bool, *changes: Callable[[Document, Random], None]) -> tuple[Lie, ...]:
    """Lies by the names of what alters a plan, or leaves it where it has nothing of the kind."""
    return tuple(Lie(change.__name__.replace("_", " "), oracle, _told(change), settled) for change in changes)


def _told(change: Callable[[Document, Random], None]) -> Callable[[Document, Random], bool]:
    def tell(plan: Document, rng: Random) -> bool:
        before = json.dumps(plan)
        with contextlib.suppress(Untold):
            change(plan, rng)
        return json.dumps(plan) != before

    return tell
