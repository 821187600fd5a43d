"""Whether the triangles of a mesh and the faces of a part are one surface.

Every triangle lies on a face, but for what is stated beside, and the triangles on a face add up to its area. Which way
a triangle looks does not count, nor how often it stands in the file: the faces of the part close.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from fmopt.verify.parts.reach import cross
from fmopt.verify.problem.meshes import Point, Triangle
from fmopt.verify.problem.solids import Unbounded
from fmopt.verify.reading.document import Body

FLAT = 2e-6  # of the diameter: facets so close to a plane are taken for plane
COARSE = 2e-4  # of the diameter: corners farther off those of a part are not the same
OFF = 4e-5  # m: facets farther off a face are not its own
_MOST = 0.45  # of the surface: what lacks more has no gap
MOST_PAIRS, MOST_TRIPLES, MOST_CORNERS = 20_000_000, 20_000, 3000
_SMOOTH = math.radians(30.5)  # facets that meet at less than this may stand for one curved surface
Flat = tuple[float, float]

_Basis = tuple[Point, Point, Point]


@dataclass(frozen=True)
class _Face:
    """A face: plane, axes in it, loops in these axes, area and the length of its rims."""

    n: Point
    o: float
    axes: tuple[Point, Point]
    loops: tuple[tuple[Flat, ...], ...]
    area: float
    rim: float


@dataclass(frozen=True)
class Surface:
    """What a mesh is beside a part.

    Attributes:
        off: how far its triangles lie from the faces at most, m.
        flaw: where the two are not the same, in words; None where they are.
        remarks: where the mesh has no triangles that it should have.
    """

    off: float
    flaw: str | None
    remarks: tuple[str, ...] = ()


def diameter(body: Body) -> float:
    """The diagonal of the box around a part, m."""
    return math.hypot(*(max(axis) - min(axis) for axis in zip(*body.vertices, strict=True)))


def compared(mesh: Sequence[Triangle], body: Body) -> Surface:
    """A mesh in the part's frame held against the part.

    Args:
        mesh: in the frame of the part, m.

    Raises:
        Unbounded: both have very many faces.
    """
    if len(mesh) * len(body.faces) > MOST_PAIRS:
        raise Unbounded("there are too many faces to compare")
    faces, span = [_face(body, loops) for loops in body.faces], diameter(body)
    covered, off = [0.0] * len(faces), 0.0
    for triangle in _once(mesh):
        normal, area = _area(triangle)
        longest = max(math.dist(triangle[k], triangle[k - 1]) for k in range(3))
        # No higher than noise: it covers nothing.
        if 2.0 * area <= FLAT * span * longest:
            continue
        # No higher than facets may be off: which way it looks does not tell its face.
        thin = 2.0 * area <= 2.0 * OFF * longest
        best = min(_fits(triangle, None if thin else normal, faces, span), default=None)
        if best is None:
            return Surface(off, f"the triangle at {_place(triangle)} of the mesh lies on no face of the part")
        off = max(off, best[0])
        covered[best[1]] += area
    lacking = []
    for face, area in zip(faces, covered, strict=True):
        lack = face.area - area
        # What corners are off by makes areas differ, all along the rim.
        if abs(lack) > (2.0 * FLAT * span + 2.0 * off) * face.rim + 1e-6 * face.area:
            lacking.append((lack, face, area))
    if lacking and not _is_gap([(lack, face) for lack, face, _ in lacking], sum(face.area for face in faces)):
        _, face, area = max(lacking, key=lambda row: abs(row[0]))
        return Surface(off, f"of the face at {_corner(face)} mm, {face.area!r} m², the mesh has {area!r} m²")
    remarks = tuple(
        f"the mesh is open in the face at {_corner(face)} mm, where it lacks {lack!r} m²" for lack, face, _ in lacking
    )
    return Surface(off, None, remarks)


def _once(mesh: Sequence[Triangle]) -> list[Triangle]:
    """Each triangle once, whichever corner comes first."""
    return list({min((t[k], t[(k + 1) % 3], t[(k + 2) % 3]) for k in range(3)): t for t in mesh}.values())


def _is_gap(lacking: Sequence[tuple[float, _Face]], whole: float) -> bool:
    """Whether what a mesh lacks of faces is a hole in it: all of it looks the same way, so that it closes nothing."""
    amount = sum(lack for lack, _ in lacking)
    if any(lack < 0.0 for lack, _ in lacking) or amount > _MOST * whole:
        return False
    sums = [sum(lack * face.n[k] for lack, face in lacking) for k in range(3)]
    return math.hypot(*sums) > 0.9 * amount


def _corner(face: _Face) -> str:
    p = face.loops[0][0]
    corner = [p[0] * u + p[1] * v + face.o * n for u, v, n in zip(*face.axes, face.n, strict=True)]
    return "(" + ", ".join(f"{1e3 * x + 0.0:.6g}" for x in corner) + ")"


def _fits(triangle: Triangle, normal: Point | None, faces: Sequence[_Face], span: float) -> Iterator[tuple[float, int]]:
    """The faces that a triangle lies on, whichever way it looks, with how far it lies off them."""
    centre = tuple(sum(axis) / 3.0 for axis in zip(*triangle, strict=True))
    for n, face in enumerate(faces):
        high = max(abs(_dot(face.n, p) - face.o) for p in triangle)
        if high <= OFF and (normal is None or abs(_dot(face.n, normal)) > 0.9):
            # Its centre, too: of a triangle across a hole or a dent all corners may be of the face.
            beside = max(_beside(face, p, OFF) for p in (*triangle, centre))
            if beside <= OFF:
                yield math.hypot(high, max(beside - 2.0 * FLAT * span, 0.0)), n


def fitting(mesh: Sequence[Triangle], body: Body) -> list[Triangle]:
    """The mesh moved so that its corners lie as near the faces as they can be, by least squares of their heights."""
    faces, span = [_face(body, loops) for loops in body.faces], diameter(body)
    middle = [sum(axis) / len(body.vertices) for axis in zip(*body.vertices, strict=True)]
    rows = [[0.0] * 7 for _ in range(6)]
    for triangle in mesh:
        normal, area = _area(triangle)
        best = min(_fits(triangle, normal, faces, span), default=None) if area else None
        for p in triangle if best is not None else ():
            n = faces[best[1] if best is not None else 0].n
            arm = between(middle, p)
            slope = (*n, *cross(arm, n))
            high = _dot(n, p) - faces[best[1] if best is not None else 0].o
            for i in range(6):
                for j in range(6):
                    rows[i][j] += slope[i] * slope[j]
                rows[i][6] -= slope[i] * high
    step = _solved(rows)
    return [_shifted(triangle, step, middle) for triangle in mesh]


def _solved(rows: list[list[float]]) -> list[float]:
    """The solution of six equations by elimination; 0 for what they leave open."""
    done: list[tuple[int, int]] = []
    left = set(range(6))
    for _ in range(6):
        i, j = max(
            ((i, j) for i in left for j in range(6) if j not in {c for _, c in done}),
            key=lambda ij: abs(rows[ij[0]][ij[1]]),
        )
        if abs(rows[i][j]) <= 1e-12 * max(abs(rows[k][k]) for k in range(3)):
            break
        done.append((i, j))
        left.discard(i)
        for k in range(6):
            if k != i:
                share = rows[k][j] / rows[i][j]
                rows[k] = [a - share * b for a, b in zip(rows[k], rows[i], strict=True)]
    found = [0.0] * 6
    for i, j in done:
        found[j] = rows[i][6] / rows[i][j]
    return found


def _shifted(triangle: Triangle, step: Sequence[float], middle: Sequence[float]) -> Triangle:
    """A triangle turned about the middle by a small angle, to second order a rotation, and moved."""
    w = (step[3], step[4], step[5])
    made = []
    for p in triangle:
        arm = between(middle, p)
        turn = cross(w, arm)
        again = cross(w, turn)
        # Of `step`, which has six numbers, the shift: its turn is in w.
        made.append(tuple(x + d + t + 0.5 * a for x, d, t, a in zip(p, step, turn, again, strict=False)))
    (a0, a1, a2), (b0, b1, b2), (c0, c1, c2) = made
    return (a0, a1, a2), (b0, b1, b2), (c0, c1, c2)


def _face(body: Body, loops: Sequence[Sequence[int]]) -> _Face:
    points = [[body.vertices[k] for k in loop] for loop in loops]
    origin = points[0][0]
    total = [0.0, 0.0, 0.0]
    for loop in points:
        for p, q in zip(loop, [*loop[1:], loop[0]], strict=True):
            u, v = between(origin, p), between(origin, q)
            total = [t + x for t, x in zip(total, cross(u, v), strict=True)]
    size = math.hypot(*total) or 1.0
    n = (total[0] / size, total[1] / size, total[2] / size)
    axis = min(range(3), key=lambda k: abs(n[k]))
    u = cross(n, (float(axis == 0), float(axis == 1), float(axis == 2)))
    length = math.hypot(*u)
    u = (u[0] / length, u[1] / length, u[2] / length)
    v = cross(n, u)
    flat = tuple(tuple((_dot(u, p), _dot(v, p)) for p in loop) for loop in points)
    corners = [p for loop in points for p in loop]
    rim = math.fsum(math.dist(p, q) for loop in flat for p, q in zip(loop, loop[1:] + loop[:1], strict=True))
    return _Face(n, math.fsum(_dot(n, p) for p in corners) / len(corners), (u, v), flat, 0.5 * size, rim)


def _beside(face: _Face, p: Sequence[float], most: float) -> float:
    """How far a point of its plane lies outside a face, m, 0 inside; at least whether by more than `most`."""
    x, y = _dot(face.axes[0], p), _dot(face.axes[1], p)
    inside, nearest = False, math.inf
    for loop in face.loops:
        for (ax, ay), (bx, by) in zip(loop, loop[1:] + loop[:1], strict=True):
            if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
                inside = not inside
            if min(ax, bx) - most <= x <= max(ax, bx) + most and min(ay, by) - most <= y <= max(ay, by) + most:
                ux, uy = bx - ax, by - ay
                size = ux * ux + uy * uy
                s = min(max(((x - ax) * ux + (y - ay) * uy) / size, 0.0), 1.0) if size else 0.0
                nearest = min(nearest, math.hypot(x - ax - s * ux, y - ay - s * uy))
    return 0.0 if inside else nearest


def chord_error(body: Body) -> float:
    """The sagitta (m) of the arcs that chains of narrow facets stand for, 0 where there are none.

    Facets of width c that turn by φ from one to the next are chords of an arc with the sagitta c/2 · tan(φ/4); only
    those with two such neighbours or more count.
    """
    faces = [_face(body, loops) for loops in body.faces]
    owner = {
        (a, b): n
        for n, loops in enumerate(body.faces)
        for loop in loops
        for a, b in zip(loop, loop[1:] + loop[:1], strict=True)
    }
    turns, neighbours = [], [0] * len(faces)
    for (a, b), one in owner.items():
        other = owner.get((b, a))
        if a < b and other is not None:
            n, m = faces[one].n, faces[other].n
            turn = math.atan2(math.hypot(*cross(n, m)), _dot(n, m))
            if turn <= _SMOOTH:
                turns.append((a, b, one, other, turn))
                neighbours[one] += 1
                neighbours[other] += 1
    largest = 0.0
    for a, b, one, other, turn in turns:
        if max(neighbours[one], neighbours[other]) > 1:
            along = _unit(between(body.vertices[a], body.vertices[b]))
            widths = (_width(body, k, cross(faces[k].n, along)) for k in (one, other))
            largest = max(largest, 0.5 * min(widths) * math.tan(0.25 * turn))
    return largest


def _width(body: Body, face: int, across: Point) -> float:
    heights = [_dot(across, body.vertices[k]) for loop in body.faces[face] for k in loop]
    return max(heights) - min(heights)


def seated(mesh: Sequence[Triangle], body: Body) -> Iterator[list[Triangle]]:
    """The mesh in every frame in which three far corners of the part are corners of it: the part's own is one.

    Args:
        mesh: in a frame of its own, m.

    Raises:
        Unbounded: the mesh has too many corners to try.
    """
    span = diameter(body)
    points = list({p for triangle in mesh for p in triangle})
    if len(points) > MOST_CORNERS:
        raise Unbounded("the model declares no features, and its mesh has too many corners to find its frame by")
    a = max(body.vertices, key=lambda p: math.dist(p, body.vertices[0]))
    b = max(body.vertices, key=lambda p: math.dist(p, a))
    c = max(body.vertices, key=lambda p: math.hypot(*cross(between(a, p), between(a, b))))
    sides, near, tries = (math.dist(a, b), math.dist(a, c), math.dist(b, c)), COARSE * span + OFF, 0
    there = basis(a, b, c)
    low, high = ([pick(axis) for axis in zip(*body.vertices, strict=True)] for pick in (min, max))
    for p in points:
        seconds = [q for q in points if abs(math.dist(p, q) - sides[0]) <= near]
        thirds = [r for r in points if abs(math.dist(p, r) - sides[1]) <= near] if seconds else []
        for q in seconds:
            for r in thirds:
                if abs(math.dist(q, r) - sides[2]) <= near:
                    tries += 1
                    if tries > MOST_TRIPLES:
                        raise Unbounded("the frame of the mesh cannot be found in so many tries")
                    here = basis(p, q, r)
                    # Some corners tell most wrong frames, before all triangles are moved.
                    if all(_in_box(_carried(x, p, here, a, there), low, high, near) for x in points[:8]):
                        yield [_placed(triangle, p, here, a, there) for triangle in mesh]


def _in_box(p: Point, low: Sequence[float], high: Sequence[float], reach: float) -> bool:
    return all(a - reach <= x <= b + reach for x, a, b in zip(p, low, high, strict=True))


def basis(a: Sequence[float], b: Sequence[float], c: Sequence[float]) -> _Basis:
    """The axes of the triangle a b c: along a b, in its plane, and its normal."""
    u = _unit(between(a, b))
    w = _unit(cross(u, between(a, c)))
    return u, cross(w, u), w


def _carried(x: Sequence[float], p: Sequence[float], here: _Basis, a: Sequence[float], there: _Basis) -> Point:
    arm = between(p, x)
    i, j, k = (_dot(axis, arm) for axis in here)
    u, v, w = there
    return (
        a[0] + i * u[0] + j * v[0] + k * w[0],
        a[1] + i * u[1] + j * v[1] + k * w[1],
        a[2] + i * u[2] + j * v[2] + k * w[2],
    )


def _placed(triangle: Triangle, p: Point, here: _Basis, a: Sequence[float], there: _Basis) -> Triangle:
    one, two, three = (_carried(x, p, here, a, there) for x in triangle)
    return one, two, three


def _area(triangle: Triangle) -> tuple[Point, float]:
    x, y, z = cross(between(triangle[0], triangle[1]), between(triangle[0], triangle[2]))
    size = math.hypot(x, y, z)
    return ((x / size, y / size, z / size) if size else (0.0, 0.0, 0.0)), 0.5 * size


def _place(triangle: Triangle) -> str:
    return "(" + ", ".join(f"{1e3 * sum(axis) / 3.0 + 0.0:.6g}" for axis in zip(*triangle, strict=True)) + ") mm"


def between(a: Sequence[float], b: Sequence[float]) -> Point:
    """From the point a to the point b."""
    return b[0] - a[0], b[1] - a[1], b[2] - a[2]


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _unit(a: Sequence[float]) -> Point:
    size = math.hypot(*a) or 1.0
    return a[0] / size, a[1] / size, a[2] / size
