"""Model files: the solids of a part in its model frame, or its mesh, and the features by which it mates."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os.path import normpath
from pathlib import Path

from fmopt.verify.problem.outlines import prism, stack
from fmopt.verify.problem.quantities import ANGLE, LENGTH, Quantity
from fmopt.verify.problem.shapes import SHAPES, Convex, extruded, polygon_of, shape
from fmopt.verify.problem.tables import Table, parameters, read

MOST_INSTANCES = 1000
_ZERO = (0.0, 0.0, 0.0)
_FEATURE = ("kind", "at", "turn", "length", "through", "classification", "solids")
_STEP = (".step", ".stp")
_OWN_UNIT = (".3mf", ".glb")
_MESHES = (".stl", ".obj", ".ply", *_STEP, *_OWN_UNIT)
_PER_METRE = {"m": 1.0, "cm": 100.0, "mm": 1e3, "um": 1e6, "in": 1.0 / 0.0254}


@dataclass(frozen=True)
class Solid:
    """A node of the tree of solids: a convex one, or a union or a difference of others, moved.

    Attributes:
        name: in the file.
        convex: the convex solid, None for the others.
        first: what a union joins, or the base of a difference.
        minus: what a difference takes away; empty for a union.
        at, turn: where its origin is put, and its rotation vector.
    """

    name: str
    convex: Convex | None
    first: tuple[Solid, ...] = ()
    minus: tuple[Solid, ...] = ()
    at: tuple[float, ...] = _ZERO
    turn: tuple[float, ...] = _ZERO


@dataclass(frozen=True)
class Feature:
    """A peg or hole: its kind, its frame in the model's, its length, and the named solids it is made of.

    One that is `found` by the planner has the frame that the plan states, if it states one, and one without a length an
    infinite one.
    """

    kind: str
    at: tuple[float, ...]
    turn: tuple[float, ...]
    length: float
    solids: tuple[str, ...]
    found: bool = False


@dataclass(frozen=True)
class Mesh:
    """A mesh file: its name in the model file, numbers a metre (None for STEP), and the stated deviation in m."""

    name: str
    path: Path
    per_metre: float | None
    deviation: float | None


@dataclass(frozen=True)
class Model:
    """A model with its parameters bound: solids, or a mesh; `planar` for a profile.

    One that is not `given` is a mesh or STEP file by itself, its table the one that names it. `balls` are the exact
    balls beside the solids, by centre and radius, m.
    """

    table: Table
    name: str
    solid: Solid | None
    mesh: Mesh | None
    planar: bool
    features: Mapping[str, Feature]
    given: bool = True
    balls: tuple[tuple[tuple[float, ...], float], ...] = ()


def load_model(operand: Table, overrides: Mapping[str, Quantity]) -> Model:
    """The model that a table of a problem names.

    Raises:
        ProblemError: it cannot be read.
    """
    # By its words alone, as the planner takes it: ".." does not follow links.
    path = Path(normpath(operand.file.parent / operand.text("model")))
    if path.suffix.lower() in _MESHES:
        return _bare(path, operand)
    for key in ("unit", "body"):
        if operand.has(key):
            raise operand.error(key, "is for mesh and STEP files")
    file = read(path, operand, "model").only(
        *("name", "description", "units", "parameters", "part", "solids", "balls", "mesh", "profile", "features")
    )
    cited = operand.table("parameters") if operand.has("parameters") else operand
    file = parameters(file, overrides, cited)
    given = [key for key in ("solids", "mesh", "profile") if file.has(key) and file.value(key)]
    if len(given) != 1:
        raise file.error(given[-1] if given else "solids", "a model has solids, a mesh or a profile, one of these")
    features = _features(file)
    solid, mesh = None, None
    if given == ["solids"]:
        solid = _Tree(file.table("solids")).solid(file.text("part"))
    elif given == ["profile"]:
        solid = _profile(file.table("profile").only("polygons"), path.stem, features)
    else:
        mesh = _mesh(file.table("mesh").only("file", "unit", "body", "deviation"))
    name = file.text("name") if file.has("name") else path.stem
    balls = _balls(file.table("balls")) if file.has("balls") else ()
    if balls and (given != ["solids"] or any(feature.kind == "hollow" for feature in features.values())):
        raise file.error("balls", "are for parts of solids that go in")
    return Model(file, name, solid, mesh, given == ["profile"], features, balls=balls)


def _balls(tables: Table) -> tuple[tuple[tuple[float, ...], float], ...]:
    found = []
    for name in tables.data:
        table = tables.table(name).only("at", "radius")
        found.append((table.vector("at"), table.number("radius", LENGTH, 1e-9)))
    return tuple(found)


def _features(file: Table) -> dict[str, Feature]:
    if not file.has("features"):
        return {}
    tables, found = file.table("features"), {}
    for name in tables.data:
        table = tables.table(name).only(*_FEATURE)
        table.flag("through")
        found[name] = Feature(
            table.text("kind", ("solid", "hollow")),
            table.vector("at", default=_ZERO),
            table.vector("turn", ANGLE, _ZERO),
            table.number("length", LENGTH, 1e-9) if table.has("length") else math.inf,
            tuple(table.names_of("solids")) if table.has("solids") else (),
            found=not table.has("at"),
        )
    return found


def _mesh(table: Table) -> Mesh:
    path = table.file.parent / table.text("file")
    step, own = path.suffix.lower() in _STEP, path.suffix.lower() in _OWN_UNIT
    if (step or own) and table.has("unit"):
        raise table.error("unit", f"a {'STEP' if step else path.suffix[1:].upper()} file says its unit itself")
    scale = None if step else 1.0 if own else _PER_METRE[table.text("unit", tuple(_PER_METRE))]
    return Mesh(table.text("file"), path, scale, table.maybe("deviation", LENGTH))


def _profile(table: Table, name: str, features: Mapping[str, Feature]) -> Solid:
    items = table.items("polygons", 1, 256)
    polygons = [polygon_of(table, f"polygons[{i}]", item) for i, item in enumerate(items)]
    moving = all(feature.kind == "solid" for feature in features.values())
    if moving and len(polygons) > 1:
        raise table.error("polygons", "what moves in a plane is one convex polygon")
    bodies = tuple(Solid(name, convex) for convex in extruded(polygons, moving=moving))
    return bodies[0] if len(bodies) == 1 else Solid(name, None, bodies)


def _bare(path: Path, operand: Table) -> Model:
    """The model that a mesh or STEP file is by itself; its features are found."""
    step, own = path.suffix.lower() in _STEP, path.suffix.lower() in _OWN_UNIT
    if operand.has("parameters") and operand.table("parameters").data:
        raise operand.error("parameters", "a mesh or STEP file has none")
    if (step or own) and operand.has("unit"):
        raise operand.error("unit", f"a {'STEP' if step else path.suffix[1:].upper()} file says its unit itself")
    unit = operand.text("unit", tuple(_PER_METRE)) if operand.has("unit") else "mm"
    mesh = Mesh(path.name, path, None if step else 1.0 if own else _PER_METRE[unit], None)
    return Model(operand, path.stem, None, mesh, False, {}, given=False)


class _Tree:
    """The named solids of a file, followed from one to those that it is made of."""

    def __init__(self, tables: Table) -> None:
        self._tables = tables
        self._count = 0

    def solid(self, name: str, above: tuple[str, ...] = (), hollow: bool = False) -> Solid:
        """The solid of that name, with all that it is made of; `hollow` where it is taken away.

        Raises:
            ProblemError: one is missing or wrong, made of itself, or there are too many.
        """
        self._count += 1
        if name in above or len(above) > 100:
            raise self._tables.error(name, "is made of itself")
        # Instances, not names: with unions of one solid twice they double at each level.
        if self._count > MOST_INSTANCES:
            raise self._tables.error(name, f"there are more than {MOST_INSTANCES} instances of solids")
        table = self._tables.table(name)
        kind = table.text("shape", (*SHAPES, "prism", "stack", "union", "difference"))
        at, turn = table.vector("at", default=_ZERO), table.vector("turn", ANGLE, _ZERO)
        within = (*above, name)
        if kind == "union":
            parts = table.only("shape", "at", "turn", "of").names_of("of")
            return Solid(name, None, tuple(self.solid(part, within, hollow) for part in parts), (), at, turn)
        if kind == "difference":
            tools = table.only("shape", "at", "turn", "of", "minus").names_of("minus")
            base = (self.solid(table.text("of"), within, hollow),)
            return Solid(name, None, base, tuple(self.solid(tool, within, not hollow) for tool in tools), at, turn)
        if kind == "prism":
            outer, cuts = prism(table.only("shape", "at", "turn", "polygon", "height", "holes"))
            return _united(name, outer, cuts, at, turn)
        if kind == "stack":
            return _united(name, stack(table.only("shape", "at", "turn", "sections")), (), at, turn)
        return Solid(name, shape(table.only("shape", "at", "turn", *SHAPES[kind]), kind, hollow), (), (), at, turn)


def _united(
    name: str, outer: Sequence[Convex], cuts: Sequence[Convex], at: tuple[float, ...], turn: tuple[float, ...]
) -> Solid:
    """The union of convex solids less others, a single one as it is."""
    if len(outer) == 1 and not cuts:
        return Solid(name, outer[0], (), (), at, turn)
    first, minus = (tuple(Solid(name, convex) for convex in some) for some in (outer, cuts))
    return Solid(name, None, first, minus, at, turn)


def overrides_of(operand: Table) -> dict[str, Quantity]:
    """The parameters that a problem gives for a model."""
    if not operand.has("parameters"):
        return {}
    # Without names: a problem gives quantities, no expressions.
    given = replace(operand.table("parameters"), names=None)
    return {name: given.quantity(name, raw) for name, raw in given.data.items()}
