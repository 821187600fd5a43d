"""Advice on sections of a stack, on profiles and on plane regions, followed."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from fmopt.geometry.csg import Solid, Union
from fmopt.geometry.outline_solids import stack
from fmopt.geometry.part import convex, width
from fmopt.geometry.plane.curve import Segment
from fmopt.geometry.plane.region import Region
from tests.shared.files.advice.case import Case, compared
from tests.shared.files.advice.solids import ARROW, CORNERS, SIZE, SQUARE, TRIANGLE, Outline, made

LEFT = "list the corners of a convex polygon counter-clockwise, x to the right and z up; cut others into several"
WALLS = "between two heights an outline keeps its corners and the directions of its sides; put two sections at one "
WALLS += "height where it steps"


def raised(outline: Outline, height: float = 0.01) -> float:
    """The volume of a prism over any outline."""
    return made(stack([(0.0, outline), (height, outline)]))


def upright(heights: tuple[float, ...]) -> float:
    """The volume of a stack of squares."""
    return made(stack([(z, SQUARE) for z in heights]))


def shrunk(outline: Outline, times: float) -> Outline:
    """An outline about the origin, scaled."""
    return tuple((times * x, times * y) for x, y in outline)


def shoulders(left: float, right: float) -> Outline:
    """A stem with a shoulder on either side, at heights of its own."""
    return tuple(
        (1e-3 * x, 1e-3 * y)
        for x, y in (
            *((-2.0, -9.0), (2.0, -9.0), (2.0, right), (6.0, right)),
            *((6.0, 9.0), (-6.0, 9.0), (-6.0, left), (-2.0, left)),
        )
    )


def chain(*points: tuple[float, float]) -> Region:
    """A region of segments from each point to the next."""
    return Region((tuple(Segment(np.array(a), np.array(b)) for a, b in pairwise(points)),))


def profile(corners: Outline) -> float:
    """The area of a convex polygon, m²."""
    x, z = convex(corners).T
    assert width(np.column_stack([x, z])) > 0.0
    return 0.5 * float(np.sum(x * np.roll(z, -1) - np.roll(x, -1) * z))


CROSSED = (*SQUARE[::2], *SQUARE[1::2])
SHOULDERS = [(0.0, shoulders(-2.0, 2.0)), (0.01, shoulders(2.0, -2.0))]
LEVEL = (0.005, shoulders(0.0, 0.0))


def halves() -> Solid:
    """The stem with shoulders as two stacks beside each other."""

    def half(side: float, height: float) -> Outline:
        corners = ((0.0, -9.0), (2.0, -9.0), (2.0, height), (6.0, height), (6.0, 9.0), (0.0, 9.0))
        loop = tuple((1e-3 * side * x, 1e-3 * y) for x, y in corners)
        return loop if side > 0.0 else loop[::-1]

    return Union(tuple(stack([(0.0, half(s, 2.0 * s)), (0.01, half(s, -2.0 * s))]) for s in (1.0, -1.0)))


CASES = (
    compared("sections downwards", "list them upwards", upright, (0.01, 0.0), (0.0, 0.01), gives=SIZE),
    compared("sections at one height", "give sections at two heights", upright, (0.0, 0.0), (0.0, 0.01), gives=SIZE),
    Case(
        "walls that turn",
        WALLS,
        lambda f: stack([(0.0, SQUARE), (0.01, (*SQUARE[:2], (0.012, 0.01), SQUARE[3]))]),
        lambda f: (
            made(stack([(0.0, SQUARE), (0.01, shrunk(SQUARE, 0.5))])),
            made(stack([(0.0, SQUARE), (0.005, SQUARE), (0.005, TRIANGLE), (0.01, TRIANGLE)])),
        ),
        (SIZE * 7.0 / 12.0, 0.75 * SIZE),
    ),
    Case(
        "fewer corners above",
        WALLS,
        lambda f: stack([(0.0, SQUARE), (0.01, TRIANGLE)]),
        lambda f: made(stack([(0.0, SQUARE), (0.005, SQUARE), (0.005, TRIANGLE), (0.01, TRIANGLE)])),
        0.75 * SIZE,
    ),
    Case(
        "shoulders that change places",
        "give sections in between, or unite several stacks",
        lambda f: stack(SHOULDERS),
        lambda f: (made(stack([SHOULDERS[0], LEVEL, SHOULDERS[1]])), made(halves())),
        (1.44e-6, 1.44e-6),
    ),
    compared("an outline of two corners", CORNERS, raised, SQUARE[:2], SQUARE, gives=SIZE),
    compared(
        "an outline that crosses itself", "list the corners in order around it", raised, CROSSED, SQUARE, gives=SIZE
    ),
    compared(
        "an outline turned",
        "list its corners counter-clockwise, seen from above",
        raised,
        SQUARE[::-1],
        SQUARE,
        gives=SIZE,
    ),
    compared("a profile of two corners", "give at least three", profile, SQUARE[:2], SQUARE, gives=1e-4),
    Case(
        "a profile that is not convex",
        LEFT,
        lambda f: profile(ARROW),
        lambda f: profile(ARROW[:3]) + profile((ARROW[0], *ARROW[2:])),
        1e-4,
    ),
    Case(
        "an open loop",
        "let every curve begin where the last one ended",
        lambda f: chain((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)),
        lambda f: chain((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 0.0)).area,
        0.5,
    ),
    Case(
        "the box of nothing",
        "test Region.empty first",
        lambda f: Region(()).box,
        lambda f: 0.0 if Region(()).empty else Region(()).size,
        0.0,
    ),
)
