"""The frames in which a model may mate where its file leaves that open: those that put its corners on a part's."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from fmopt.verify.arithmetic.rational import Matrix, add, number, turned, vector
from fmopt.verify.parts.reach import cross
from fmopt.verify.problem.model import Solid
from fmopt.verify.problem.solids import Frame, Unbounded, frame
from fmopt.verify.problem.surfaces import basis, between
from fmopt.verify.reading.document import Body

NEAR = 1e-8  # m: between corners that are one
MOST_CORNERS, MOST_TRIPLES = 3000, 2000

Point = tuple[float, float, float]


def frames(solid: Solid, body: Body) -> Iterator[Frame]:
    """The frames in which three far corners of a part are corners of a solid, and none of the part lies out of reach.

    Args:
        solid: of the model.
        body: of the plan.

    Raises:
        Unbounded: there are too many corners to try.
    """
    points = list(dict.fromkeys(_corners(solid, frame((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))))
    if len(points) > MOST_CORNERS:
        raise Unbounded("the model leaves its features to be found, and has too many corners to find its frame by")
    a = max(body.vertices, key=lambda p: math.dist(p, body.vertices[0]))
    b = max(body.vertices, key=lambda p: math.dist(p, a))
    c = max(body.vertices, key=lambda p: math.hypot(*cross(between(a, p), between(a, b))))
    one, two, three = math.dist(a, b), math.dist(a, c), math.dist(b, c)
    there, tries = basis(a, b, c), 0
    for p in points:
        seconds = [q for q in points if abs(math.dist(p, q) - one) <= NEAR]
        thirds = [r for r in points if abs(math.dist(p, r) - two) <= NEAR] if seconds else []
        for q in seconds:
            for r in thirds:
                if abs(math.dist(q, r) - three) <= NEAR:
                    tries += 1
                    if tries > MOST_TRIPLES:
                        raise Unbounded("the frame of the model cannot be found in so many tries")
                    yield _carrying(basis(p, q, r), p, there, a)


def _corners(solid: Solid, at: Frame) -> Iterator[Point]:
    own = at.after(frame(solid.at, solid.turn))
    if solid.convex is not None:
        for point in solid.convex.points:
            x, y, z = (number(value) for value in own(vector(point)))
            yield x, y, z
    for part in (*solid.first, *solid.minus):
        yield from _corners(part, own)


def _carrying(here: Sequence[Point], p: Point, there: Sequence[Point], a: Sequence[float]) -> Frame:
    """The frame that takes the point p with its axes to the point a with its."""
    rows = [[math.fsum(t[i] * h[j] for t, h in zip(there, here, strict=True)) for j in range(3)] for i in range(3)]
    x, y, z = (vector(row) for row in rows)
    R: Matrix = (x, y, z)
    back = turned(R, vector(p))
    return Frame(R, add(vector(a), (-back[0], -back[1], -back[2])))
