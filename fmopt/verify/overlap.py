"""A proof that two convex pieces overlap at a pose: a point deeper than the tolerance inside both."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from fmopt.verify.rational import ONE, Vector, dot, fixed, number, sub, transposed, turned
from fmopt.verify.rows import Pose
from fmopt.verify.solids import Plane, Shape

Point = tuple[float, float, float]


def overlap(M: Shape, F: Shape, X: Pose, least: float) -> float:
    """A depth (m) to which the pieces certainly overlap, 0 when no overlap deeper than `least` was found.

    Candidates come from floats (corners of the intersection and their mean); the depth of a candidate is exact.
    """
    back = transposed(X.R)
    own = [X.apply(v) for v in M.vertices]
    planes = [face.plane for face in F.faces]
    for side in M.faces:
        n = turned(X.R, side.plane.normal)
        planes.append(Plane(n, side.plane.offset + dot(n, X.p)))
    corners = list(_corners(own, M, F, planes))
    if not corners:
        return 0.0
    count = len(corners)
    mean = (sum(p[0] for p in corners) / count, sum(p[1] for p in corners) / count, sum(p[2] for p in corners) / count)
    best = 0.0
    for candidate in (mean, *corners):
        x: Vector = (fixed(candidate[0]), fixed(candidate[1]), fixed(candidate[2]))
        body = turned(back, sub(x, X.p))
        height = max(max(face.plane.height(x) for face in F.faces), max(face.plane.height(body) for face in M.faces))
        best = max(best, -number(height + (ONE >> 100)))
    return best if best > least else 0.0


def _corners(own: Sequence[Vector], M: Shape, F: Shape, planes: Sequence[Plane]) -> Iterator[Point]:
    """Corners of the intersection, in floats: vertices and edges of one against faces of the other."""
    half = [(number(p.normal[0]), number(p.normal[1]), number(p.normal[2]), number(p.offset)) for p in planes]
    for shape, vertices in ((M, own), (F, F.vertices)):
        points = [(number(v[0]), number(v[1]), number(v[2])) for v in vertices]
        for i, j in shape.edge_faces:
            if i < j:
                yield from _inside(points[i], points[j], half)


def _inside(p: Point, q: Point, half: Sequence[tuple[float, float, float, float]]) -> Iterator[Point]:
    """The ends of the part of a segment behind all planes, with a little room for rounding."""
    low, high = 0.0, 1.0
    for a, b, c, offset in half:
        g = a * p[0] + b * p[1] + c * p[2] - offset - 1e-12
        h = a * q[0] + b * q[1] + c * q[2] - offset - 1e-12
        if g > 0.0 and h > 0.0:
            return
        if g > 0.0:
            low = max(low, g / (g - h))
        elif h > 0.0:
            high = min(high, g / (g - h))
    if low <= high:
        for t in (low, high):
            yield (p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1]), p[2] + t * (q[2] - p[2]))
