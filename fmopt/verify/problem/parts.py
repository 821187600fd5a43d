"""Whether the parts of a plan are those of the models: solids as sets, meshes as surfaces.

Whether the triangles of a mesh and the faces of a part are one surface.

Every triangle lies on a face, looks the way the face looks, and the triangles on a face add up to its area.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from fmopt.verify.document import Body, Part
from fmopt.verify.problem.meshes import NoMesh, Point, Triangle, triangles
from fmopt.verify.problem.model import Mesh, Solid
from fmopt.verify.problem.problem import Problem
from fmopt.verify.problem.seating import frames
from fmopt.verify.problem.solids import Comparison, Frame, Unbounded, of_piece, tree_of
from fmopt.verify.problem.tables import LARGEST_MESH, read_bytes
from fmopt.verify.rational import ArithmeticRefusal, number, vector

_SAME = 1e-12  # m: between coordinates that went the same way

FLAT = 2e-6  # of the diameter: facets so close to a plane are taken for plane
COARSE = 2e-4  # of the diameter: facets farther off a face are not its own, whatever the numbers are rounded to
MOST_PAIRS, MOST_TRIPLES, MOST_CORNERS = 20_000_000, 20_000, 3000
_SMOOTH = math.radians(30.5)  # facets that meet at less than this may stand for one curved surface
Flat = tuple[float, float]

_Basis = tuple[Point, Point, Point]


@dataclass(frozen=True)
class Given:
    """A part as the planner's reader has it from a file that the check cannot read, in its mating frame.

    Attributes:
        body: its surface.
        chord: how far the true surface lies from it, m.
    """

    body: Body
    chord: float


Reader = Callable[[], Mapping[str, Given]]


@dataclass(frozen=True)
class Chord:
    """How far the true surface of a mesh may lie from its facets, m: at least, and at most."""

    least: float = 0.0
    most: float = 0.0


@dataclass(frozen=True)
class Compared:
    """A part beside its model: differences and remarks in words, and what its facets add to the errors."""

    differences: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    chord: Chord = Chord()


def part_beside_its_model(part: Part, problem: Problem, side: str, reader: Reader | None) -> Compared:
    """A part of a plan held against its model.

    Args:
        part: of the plan.
        problem: the problem.
        side: of the plan, "moving" or "fixed".
        reader: what the planner makes of files that the check cannot read, by side; None to leave them out.

    Raises:
        ProblemError: a mesh cannot be read.
    """
    model = problem.model(side)
    try:
        if model.solid is not None and problem.feature(side).found:
            return _beside_turned(part, side, model.name, model.solid)
        if model.solid is not None:
            tree = tree_of(model.solid, problem.frame(side))
            comparison = Comparison(tree, [of_piece(piece) for piece in part.pieces])
            return Compared((*_differences(comparison, side, model.name), *_ball_differences(part, problem, side)))
        if model.mesh is not None and model.mesh.per_metre is not None:
            return _beside_mesh(part, problem, side, model.mesh, model.mesh.per_metre)
    except (Unbounded, ArithmeticRefusal) as error:
        return Compared((f"parts.{side}: the part was not compared with its model: {error}",))
    if reader is None:
        name = model.mesh.name if model.mesh is not None else ""
        return Compared((f"parts.{side}: the part was not compared with {name}: the check reads no STEP files",))
    return _beside_given(part, side, reader()[side])


def _beside_turned(part: Part, side: str, name: str, solid: Solid) -> Compared:
    """A part beside a model whose frame is the planner's choice: in one of the frames that fit the two are the same."""
    flaws: tuple[str, ...] = (
        f"parts.{side}: the plan is for another {side} part than the model {name!r}: no frame fits its corners",
    )
    pieces = [of_piece(piece) for piece in part.pieces]
    for at in frames(solid, part.body):
        found = tuple(_differences(Comparison(tree_of(solid, at), pieces), side, name))
        if not found:
            words = f"the frame in which the {side} part mates is the planner's choice, as its model leaves it open"
            return Compared((), (words,))
        flaws = found
    return Compared(flaws)


def _differences(comparison: Comparison, side: str, name: str) -> Iterator[str]:
    reaching, missing = comparison.outside(), comparison.uncovered()
    if reaching is not None:
        yield (
            f"parts.{side}.pieces[{reaching[0]}]: the plan is for another {side} part: at {reaching[1]} of its frame "
            f"the piece has material, the model {name!r} has none"
        )
    if missing is not None:
        yield (
            f"parts.{side}.pieces: the plan is for another {side} part: at {missing} of its frame the model "
            f"{name!r} has material, no piece has"
        )


def _ball_differences(part: Part, problem: Problem, side: str) -> Iterator[str]:
    """Balls of a part that its model has not, and those of the model that it lacks."""
    model, at = problem.model(side), problem.frame(side)
    left = [(part.body.vertices[n], radius) for n, radius in part.body.balls]
    for centre, radius in model.balls:
        x, y, z = (number(coordinate) for coordinate in at(vector(centre)))
        same = [ball for ball in left if math.dist(ball[0], (x, y, z)) <= _SAME and abs(ball[1] - radius) <= _SAME]
        if same:
            left.remove(same[0])
        else:
            yield (
                f"parts.{side}.balls: the plan is for another {side} part: the model {model.name!r} has a ball of "
                f"radius {radius!r} m at {_told((x, y, z))} of its frame, the part has none like it"
            )
    for (x, y, z), radius in left:
        yield (
            f"parts.{side}.balls: the plan is for another {side} part: it has a ball of radius {radius!r} m at "
            f"{_told((x, y, z))} of its frame, the model {model.name!r} has none like it"
        )


def _told(p: Point) -> str:
    return "(" + ", ".join(f"{1e3 * x + 0.0:.6g}" for x in p) + ") mm"


def _beside_given(part: Part, side: str, given: Given) -> Compared:
    """A part beside the same part as the planner's reader has it from a STEP file."""
    same = part.body.faces == given.body.faces and len(part.body.vertices) == len(given.body.vertices)
    if not same or not all(
        abs(x - y) <= _SAME
        for a, b in zip(part.body.vertices, given.body.vertices, strict=True)
        for x, y in zip(a, b, strict=True)
    ):
        found = f"parts.{side}: the plan is for another {side} part: its vertices or faces are not those of its file"
        return Compared((found,), (), Chord(given.chord, given.chord))
    words = f"the {side} part was held against its STEP file by way of the planner's reader"
    return Compared((), (words,), Chord(given.chord, given.chord))


def _beside_mesh(part: Part, problem: Problem, side: str, mesh: Mesh, per_metre: float) -> Compared:
    table = problem.model(side).table.table("mesh")
    content = read_bytes(mesh.path, table, "file", LARGEST_MESH)
    try:
        found = triangles(content, mesh.path.suffix.lower().removeprefix("."), per_metre)
    except NoMesh as error:
        raise table.error("file", f"{mesh.name} {error}") from None
    remarks: tuple[str, ...] = ()
    if problem.feature(side).found:
        words = f"the frame in which the {side} part mates is the planner's choice, as its model declares no features"
        placed, remarks = seated(found, part.body), (words,)
    else:
        at = problem.frame(side)
        placed = iter([[_moved(triangle, at) for triangle in found]])
    flaw = "no frame puts its corners on those of the part"
    for candidate in placed:
        surface = compared(candidate, part.body)
        if surface.flaw is None:
            return Compared((), remarks, _chord(part.body, mesh, surface.off))
        flaw = surface.flaw
    told = f"parts.{side}: the plan is for another {side} part than the mesh {mesh.name}: {flaw}"
    return Compared((told,), remarks, _chord(part.body, mesh, 0.0))


def _moved(triangle: Triangle, at: Frame) -> Triangle:
    rows = [[number(x) for x in row] for row in at.R]
    shift = [number(x) for x in at.p]
    found = []
    for p in triangle:
        x, y, z = (sum(a * b for a, b in zip(row, p, strict=True)) + s for row, s in zip(rows, shift, strict=True))
        found.append((x, y, z))
    return found[0], found[1], found[2]


def _chord(body: Body, mesh: Mesh, off: float) -> Chord:
    """What the facets of a mesh add to the errors: as stated or estimated, and how far they were put from the file's.

    The estimate is of the part's facets, which the mesh's differ from by rounding.
    """
    span = diameter(body)
    stated = mesh.deviation
    base = chord_error(body) * (1.0 - 1e-3) if stated is None else stated
    return Chord(base + max(off - 2.0 * FLAT * span, 0.0), base * (1.0 + 3e-3) + COARSE * span)


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
    """

    off: float
    flaw: str | None


def diameter(body: Body) -> float:
    """The diagonal of the box around a part, m."""
    return math.hypot(*(max(axis) - min(axis) for axis in zip(*body.vertices, strict=True)))


def compared(mesh: Sequence[Triangle], body: Body) -> Surface:
    """A mesh in the part's frame held against the part.

    Raises:
        Unbounded: both have very many faces.
    """
    if len(mesh) * len(body.faces) > MOST_PAIRS:
        raise Unbounded("there are too many faces to compare")
    faces, span = [_face(body, loops) for loops in body.faces], diameter(body)
    covered, off = [0.0] * len(faces), 0.0
    for triangle in mesh:
        normal, area = _area(triangle)
        longest = max(math.dist(triangle[k], triangle[k - 1]) for k in range(3))
        if 2.0 * area <= FLAT * span * longest:
            continue
        best = min(_fits(triangle, normal, faces, span), default=None)
        if best is None:
            return Surface(off, f"the triangle at {_place(triangle)} of the mesh lies on no face of the part")
        off = max(off, best[0])
        covered[best[1]] += area
    for face, area in zip(faces, covered, strict=True):
        if abs(face.area - area) > (2.0 * FLAT * span + off) * face.rim + 1e-6 * face.area:
            p = face.loops[0][0]
            corner = [p[0] * u + p[1] * v + face.o * n for u, v, n in zip(*face.axes, face.n, strict=True)]
            where = ", ".join(f"{1e3 * x + 0.0:.6g}" for x in corner)
            return Surface(off, f"of the face at ({where}) mm, {face.area!r} m², the mesh has {area!r} m²")
    return Surface(off, None)


def _fits(triangle: Triangle, normal: Point, faces: Sequence[_Face], span: float) -> Iterator[tuple[float, int]]:
    """The faces that a triangle lies on, with how far it lies off their planes."""
    centre = tuple(sum(axis) / 3.0 for axis in zip(*triangle, strict=True))
    for n, face in enumerate(faces):
        off = max(abs(_dot(face.n, p) - face.o) for p in triangle)
        if off <= COARSE * span and _dot(face.n, normal) > 0.9:
            reach = 2.0 * FLAT * span + off
            if all(_holds(face, p, reach) for p in (*triangle, centre)):
                yield off, n


def _face(body: Body, loops: Sequence[Sequence[int]]) -> _Face:
    points = [[body.vertices[k] for k in loop] for loop in loops]
    origin = points[0][0]
    total = [0.0, 0.0, 0.0]
    for loop in points:
        for p, q in zip(loop, [*loop[1:], loop[0]], strict=True):
            u, v = _arm(origin, p), _arm(origin, q)
            total = [t + x for t, x in zip(total, _cross(u, v), strict=True)]
    size = math.hypot(*total) or 1.0
    n = (total[0] / size, total[1] / size, total[2] / size)
    axis = min(range(3), key=lambda k: abs(n[k]))
    u = _cross(n, (float(axis == 0), float(axis == 1), float(axis == 2)))
    length = math.hypot(*u)
    u = (u[0] / length, u[1] / length, u[2] / length)
    v = _cross(n, u)
    flat = tuple(tuple((_dot(u, p), _dot(v, p)) for p in loop) for loop in points)
    corners = [p for loop in points for p in loop]
    rim = math.fsum(math.dist(p, q) for loop in flat for p, q in zip(loop, loop[1:] + loop[:1], strict=True))
    return _Face(n, math.fsum(_dot(n, p) for p in corners) / len(corners), (u, v), flat, 0.5 * size, rim)


def _holds(face: _Face, p: Sequence[float], reach: float) -> bool:
    """Whether a point of its plane lies in a face, or so close to its rim."""
    x, y = _dot(face.axes[0], p), _dot(face.axes[1], p)
    inside = False
    for loop in face.loops:
        for (ax, ay), (bx, by) in zip(loop, loop[1:] + loop[:1], strict=True):
            ux, uy = bx - ax, by - ay
            size = ux * ux + uy * uy
            s = min(max(((x - ax) * ux + (y - ay) * uy) / size, 0.0), 1.0) if size else 0.0
            if math.hypot(x - ax - s * ux, y - ay - s * uy) <= reach:
                return True
            if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * ux:
                inside = not inside
    return inside


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
            turn = math.atan2(math.hypot(*_cross(n, m)), _dot(n, m))
            if turn <= _SMOOTH:
                turns.append((a, b, one, other, turn))
                neighbours[one] += 1
                neighbours[other] += 1
    largest = 0.0
    for a, b, one, other, turn in turns:
        if max(neighbours[one], neighbours[other]) > 1:
            along = _unit(_arm(body.vertices[a], body.vertices[b]))
            widths = (_width(body, k, _cross(faces[k].n, along)) for k in (one, other))
            largest = max(largest, 0.5 * min(widths) * math.tan(0.25 * turn))
    return largest


def _width(body: Body, face: int, across: Point) -> float:
    heights = [_dot(across, body.vertices[k]) for loop in body.faces[face] for k in loop]
    return max(heights) - min(heights)


def seated(mesh: Sequence[Triangle], body: Body) -> Iterator[list[Triangle]]:
    """The mesh in every frame in which three far corners of the part are corners of it: the part's own is one.

    Raises:
        Unbounded: the mesh has too many corners to try.
    """
    span = diameter(body)
    points = list({p for triangle in mesh for p in triangle})
    if len(points) > MOST_CORNERS:
        raise Unbounded("the model declares no features, and its mesh has too many corners to find its frame by")
    a = max(body.vertices, key=lambda p: math.dist(p, body.vertices[0]))
    b = max(body.vertices, key=lambda p: math.dist(p, a))
    c = max(body.vertices, key=lambda p: math.hypot(*_cross(_arm(a, p), _arm(a, b))))
    sides, near, tries = (math.dist(a, b), math.dist(a, c), math.dist(b, c)), COARSE * span, 0
    there = _basis(a, b, c)
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
                    here = _basis(p, q, r)
                    if all(_in_box(_carried(x, p, here, a, there), low, high, near) for x in points[:8]):
                        yield [_placed(triangle, p, here, a, there) for triangle in mesh]


def _in_box(p: Point, low: Sequence[float], high: Sequence[float], reach: float) -> bool:
    return all(a - reach <= x <= b + reach for x, a, b in zip(p, low, high, strict=True))


def _basis(a: Sequence[float], b: Sequence[float], c: Sequence[float]) -> _Basis:
    u = _unit(_arm(a, b))
    w = _unit(_cross(u, _arm(a, c)))
    return u, _cross(w, u), w


def _carried(x: Sequence[float], p: Sequence[float], here: _Basis, a: Sequence[float], there: _Basis) -> Point:
    arm = _arm(p, x)
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
    x, y, z = _cross(_arm(triangle[0], triangle[1]), _arm(triangle[0], triangle[2]))
    size = math.hypot(x, y, z)
    return ((x / size, y / size, z / size) if size else (0.0, 0.0, 0.0)), 0.5 * size


def _place(triangle: Triangle) -> str:
    return "(" + ", ".join(f"{1e3 * sum(axis) / 3.0 + 0.0:.6g}" for axis in zip(*triangle, strict=True)) + ") mm"


def _arm(a: Sequence[float], b: Sequence[float]) -> Point:
    return b[0] - a[0], b[1] - a[1], b[2] - a[2]


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Sequence[float], b: Sequence[float]) -> Point:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _unit(a: Sequence[float]) -> Point:
    size = math.hypot(*a) or 1.0
    return a[0] / size, a[1] / size, a[2] / size
