"""Where a contact touches at a pose, how far inside its features, and the wrench that it can exert, in doubles."""

import math
from collections.abc import Sequence
from operator import mul
from typing import NamedTuple

from fmopt.verify.arithmetic.rational import doubles, number, transposed
from fmopt.verify.parts.assembly import PartPair, Touch
from fmopt.verify.parts.rows import CheckedPose
from fmopt.verify.parts.solids import Shape
from fmopt.verify.reading.reader import Numbers

_LEVEL = 1e-3  # sine of the angle below which two edges cross in no one point


class PosedContact(NamedTuple):
    """A contact at a pose."""

    point: Numbers  # where it touches, in the world, m
    arm: Numbers  # the same from the part's reference point
    wrench: Numbers  # of a unit normal force, about the reference point
    centre: Numbers | None = None  # of a ball, from the reference point; None of others

    def sliding(self, V: Numbers) -> float:
        """The speed at which the contact point slides along the contact for the twist V."""
        u, v, w = cross(V[3:], self.arm)
        x, y, z = V[0] + u, V[1] + v, V[2] + w
        a, b, c = self.wrench[:3]
        along = x * a + y * b + z * c
        return math.hypot(x - along * a, y - along * b, z - along * c)


def unit_wrench(touch: Touch, X: CheckedPose) -> PosedContact:
    """The contact with its wrench at a pose."""
    centre: Numbers | None = None
    # Doubles are enough here: forces are judged with margins far above rounding, unlike distances.
    if touch.kind == "edge-edge":
        (a, b), (q, r) = (_placed(v, X) for v in touch.moving), (doubles(w) for w in touch.fixed)
        own, other = _sub(b, a), _sub(r, q)
        # As in its row, which is positive where the parts are apart: this points out of the fixed part.
        m = cross(own, other)
        size = math.hypot(*m)
        normal = tuple(x / size for x in m)
        across = cross(other, m)
        # The point of the moving edge nearest to the line of the fixed one, which is where they cross.
        s = dot(across, _sub(q, a)) / dot(across, own)
        point = tuple(x + s * y for x, y in zip(a, own, strict=True))
    elif touch.kind == "ball-face" and touch.plane is not None:
        normal = doubles(touch.plane.normal)
        radius, middle = number(touch.plane.offset - touch.faces[0].offset), _placed(touch.moving[0], X)
        point = tuple(x - radius * n for x, n in zip(middle, normal, strict=True))
        centre = _sub(middle, X.in_doubles[0])
    elif touch.kind == "vertex-face" and touch.plane is not None:
        normal, point = doubles(touch.plane.normal), _placed(touch.moving[0], X)
    else:
        assert touch.plane is not None
        # The force on the moving part is against the outward normal of its own face.
        normal = tuple(-x for x in _turned(touch.plane.normal, X))
        point = doubles(touch.fixed[0])
    arm = _sub(point, X.in_doubles[0])
    return PosedContact(point, arm, (*normal, *cross(arm, normal)), centre)


def touching(assembly: PartPair, touch: Touch, X: CheckedPose) -> float:
    """How far the touching point lies inside both features (m), negative outside; for level edges minus 1 m."""
    if touch.kind in ("vertex-face", "ball-face"):
        return _inside(assembly.fixed, touch.face, _placed(touch.moving[0], X))
    if touch.kind == "face-vertex":
        away = _sub(doubles(touch.fixed[0]), X.in_doubles[0])
        return _inside(assembly.moving, touch.face, tuple(dot(doubles(line), away) for line in transposed(X.R)))
    (a, b), (q, r) = (_placed(v, X) for v in touch.moving), (doubles(w) for w in touch.fixed)
    own, other = _sub(b, a), _sub(r, q)
    m = cross(own, other)
    # Edges that are level cross everywhere or nowhere.
    if math.hypot(*m) < _LEVEL * math.hypot(*own) * math.hypot(*other):
        return -1.0
    square = dot(m, m)
    s = dot(cross(_sub(q, a), other), m) / square
    t = dot(cross(_sub(q, a), own), m) / square
    return min(min(s, 1.0 - s) * math.hypot(*own), min(t, 1.0 - t) * math.hypot(*other))


def _inside(shape: Shape, face: int, point: Numbers) -> float:
    """How far the foot of a point on the plane of a face lies inside the face, m; negative outside."""
    plane = shape.faces[face].plane
    normal = doubles(plane.normal)
    height = dot(normal, point) - number(plane.offset)
    point = tuple(x - height * n for x, n in zip(point, normal, strict=True))
    # Seen along the steepest axis, so that the projection does not fold.
    axis = max(range(3), key=lambda k: abs(normal[k]))
    u, v = (axis + 1) % 3, (axis + 2) % 3
    within, nearest = False, math.inf
    for loop in shape.faces[face].loops:
        corners = [shape.in_doubles[i] for i in loop]
        for a, b in zip(corners, (*corners[1:], corners[0]), strict=True):
            edge, off = _sub(b, a), _sub(point, a)
            share = min(max(dot(edge, off) / dot(edge, edge), 0.0), 1.0)
            nearest = min(nearest, math.hypot(*(x - share * y for x, y in zip(off, edge, strict=True))))
            # Half-open: a ray through a vertex counts one of its two edges.
            if (a[v] > point[v]) != (b[v] > point[v]):
                at = a[u] + (point[v] - a[v]) / (b[v] - a[v]) * (b[u] - a[u])
                within ^= point[u] < at
    return nearest if within else -nearest


def _turned(v: Sequence[int], X: CheckedPose) -> Numbers:
    w = doubles(v)
    return tuple([dot(line, w) for line in X.in_doubles[1]])


def _placed(v: Sequence[int], X: CheckedPose) -> Numbers:
    a, b, c = _turned(v, X)
    x, y, z = X.in_doubles[0]
    return (a + x, b + y, c + z)


def _sub(a: Numbers, b: Numbers) -> Numbers:
    return tuple([x - y for x, y in zip(a, b, strict=True)])


def dot(a: Sequence[float], b: Sequence[float]) -> float:
    """a·b of vectors of one size in doubles, rounded once."""
    if len(a) != len(b):
        raise ValueError(f"vectors of {len(a)} and {len(b)} numbers have no product")
    return math.fsum(map(mul, a, b))


def cross(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float]:
    """a × b in doubles."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
