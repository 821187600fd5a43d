"""Whether the parts of a plan are those of the models: solids as sets, meshes as surfaces."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from fmopt.verify.arithmetic.rational import ArithmeticRefusal, Matrix, add, number, turned, vector
from fmopt.verify.parts.reach import cross
from fmopt.verify.problem.meshes import NoMesh, Point, Triangle, triangles
from fmopt.verify.problem.model import Mesh, Solid
from fmopt.verify.problem.problem import Problem
from fmopt.verify.problem.solids import Comparison, Frame, Unbounded, frame, of_piece, tree_of
from fmopt.verify.problem.surfaces import FLAT, basis, between, chord_error, compared, diameter, fitting, seated
from fmopt.verify.problem.tables import LARGEST_MESH, read_bytes
from fmopt.verify.reading.document import Body, Part

_SAME = 1e-12  # m: between coordinates that went the same way
_SINGLE = 2e-8  # m: what facets are off their faces by less is rounding of numbers of single precision
_NEAR = 1e-8  # m: between corners that are one
_MOST_CORNERS, _MOST_TRIPLES = 3000, 2000


@dataclass(frozen=True)
class Given:
    """A part as the planner's reader has it from a file that the check cannot read, in its mating frame.

    Attributes:
        body: its surface.
        chord: how far the true surface lies from it, m.
        form: its tolerance of form, m.
    """

    body: Body
    chord: float
    form: float = 0.0


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
        reader: what the planner makes of files that the check cannot read, by side; None to leave them out.

    Raises:
        ProblemError: a mesh cannot be read.
    """
    model = problem.model(side)
    try:
        if model.solid is not None and problem.feature(side).found and not problem.framed(side):
            return _beside_turned(part, side, model.name, model.solid)
        if model.solid is not None:
            tree = tree_of(model.solid, problem.frame(side))
            comparison = Comparison(tree, [of_piece(piece) for piece in part.pieces])
            found = (*_differences(comparison, side, model.name), *_ball_differences(part, problem, side))
            return Compared(found, tuple(_choices(problem, side)))
        if model.mesh is not None and model.mesh.per_metre is not None:
            return _beside_mesh(part, problem, side, model.mesh, model.mesh.per_metre)
    except (Unbounded, ArithmeticRefusal) as error:
        # A difference, as silence would pass for agreement.
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
    for at in _frames(solid, part.body):
        found = tuple(_differences(Comparison(tree_of(solid, at), pieces), side, name))
        if not found:
            words = f"the frame in which the {side} part mates is the planner's choice, as its model leaves it open"
            return Compared((), (words,))
        flaws = found
    return Compared(flaws)


def _choices(problem: Problem, side: str) -> Iterator[str]:
    """What of how a part mates is the planner's choice, in words."""
    if problem.feature(side).found:
        yield f"the frame in which the {side} part mates is the planner's choice, as its model declares no features"


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
            left.remove(same[0])  # each stands for one
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
    flaws = tuple(_form_differences(part, side, "its file", given.form))
    return Compared(flaws, (words,), Chord(given.chord, given.chord))


def _beside_mesh(part: Part, problem: Problem, side: str, mesh: Mesh, per_metre: float) -> Compared:
    model = problem.model(side)
    table, key = (model.table.table("mesh"), "file") if model.given else (model.table, "model")
    content = read_bytes(mesh.path, table, key, LARGEST_MESH)
    try:
        found = triangles(content, mesh.path.suffix.lower().removeprefix("."), per_metre)
    except NoMesh as error:
        raise table.error(key, f"{mesh.name} {error}") from None
    remarks = tuple(_choices(problem, side))
    # What a frame that rests on corners, or single precision, leaves is no deviation of form.
    if problem.feature(side).found and not problem.framed(side):
        placed, blur = seated(found, part.body), max(2.0 * FLAT * diameter(part.body), _SINGLE)
    else:
        blur = _SINGLE
        at = problem.frame(side)
        placed = iter([[_moved(triangle, at) for triangle in found]])
    flaw = "no frame puts its corners on those of the part"
    for candidate in placed:
        surface = compared(candidate, part.body)
        if surface.flaw is None:
            # A frame that rests on three corners may lean a little: the mesh is tried where it fits best, too.
            near = min(surface, compared(fitting(candidate, part.body), part.body), key=lambda s: (bool(s.flaw), s.off))
            flaws = tuple(_form_differences(part, side, mesh.name, near.off - blur))
            return Compared(flaws, (*remarks, *near.remarks), _chord(part.body, mesh))
        flaw = surface.flaw
    told = f"parts.{side}: the plan is for another {side} part than the mesh {mesh.name}: {flaw}"
    return Compared((told,), remarks, _chord(part.body, mesh))


def _moved(triangle: Triangle, at: Frame) -> Triangle:
    rows = [[number(x) for x in row] for row in at.R]
    shift = [number(x) for x in at.p]
    found = []
    for p in triangle:
        x, y, z = (sum(a * b for a, b in zip(row, p, strict=True)) + s for row, s in zip(rows, shift, strict=True))
        found.append((x, y, z))
    return found[0], found[1], found[2]


def _form_differences(part: Part, side: str, name: str, off: float) -> Iterator[str]:
    """Where a part's tolerance of form does not cover how far it lies from the facets of its file, m."""
    if off > part.form:
        yield (
            f"parts.{side}.form: the plan allows for {part.form!r} m between its {side} part and the surface of "
            f"{name}, which lies up to {off!r} m off"
        )


def _chord(body: Body, mesh: Mesh) -> Chord:
    """What the facets of a mesh add to the errors, as stated or estimated.

    The estimate is of the part's facets, which the mesh's differ from by rounding.
    """
    stated = mesh.deviation
    base = chord_error(body) * (1.0 - 1e-3) if stated is None else stated
    return Chord(base, base * (1.0 + 3e-3) + FLAT * diameter(body))


def _frames(solid: Solid, body: Body) -> Iterator[Frame]:
    """The frames in which three far corners of a part are corners of a solid, and none of the part lies out of reach.

    Raises:
        Unbounded: there are too many corners to try.
    """
    points = list(dict.fromkeys(_corners(solid, frame((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))))
    if len(points) > _MOST_CORNERS:
        raise Unbounded("the model leaves its features to be found, and has too many corners to find its frame by")
    a = max(body.vertices, key=lambda p: math.dist(p, body.vertices[0]))
    b = max(body.vertices, key=lambda p: math.dist(p, a))
    c = max(body.vertices, key=lambda p: math.hypot(*cross(between(a, p), between(a, b))))
    one, two, three = math.dist(a, b), math.dist(a, c), math.dist(b, c)
    there, tries = basis(a, b, c), 0
    for p in points:
        seconds = [q for q in points if abs(math.dist(p, q) - one) <= _NEAR]
        thirds = [r for r in points if abs(math.dist(p, r) - two) <= _NEAR] if seconds else []
        for q in seconds:
            for r in thirds:
                if abs(math.dist(q, r) - three) <= _NEAR:
                    tries += 1
                    if tries > _MOST_TRIPLES:
                        raise Unbounded("the frame of the model cannot be found in so many tries")
                    yield _carrying(basis(p, q, r), p, there, a)


def _corners(solid: Solid, at: Frame) -> Iterator[Point]:
    own = at.after(frame(solid.at, solid.turn))
    if solid.convex is not None:
        for point in solid.convex.points:
            x, y, z = (number(value) for value in own(vector(point)))
            yield x, y, z
    # Corners of what is taken away are corners of what is left.
    for part in (*solid.first, *solid.minus):
        yield from _corners(part, own)


def _carrying(here: Sequence[Point], p: Point, there: Sequence[Point], a: Sequence[float]) -> Frame:
    """The frame that takes the point p with its axes to the point a with its."""
    rows = [[math.fsum(t[i] * h[j] for t, h in zip(there, here, strict=True)) for j in range(3)] for i in range(3)]
    x, y, z = (vector(row) for row in rows)
    R: Matrix = (x, y, z)
    back = turned(R, vector(p))
    return Frame(R, add(vector(a), (-back[0], -back[1], -back[2])))
