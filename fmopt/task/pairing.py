"""Which features of two parts mate, and where, as far as their files do not say it; which hollows matter to neither."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fmopt.errors import GeometryError, InputError
from fmopt.geometry.bodies import bodies_of
from fmopt.geometry.facets import FEW_REFLEX, MOST_REFLEX
from fmopt.geometry.mating_features import DESCRIBE, FOUND
from fmopt.geometry.polyhedron import placed, triangulated
from fmopt.spatial.se3 import Pose
from fmopt.task.mesh_source import imported
from fmopt.task.sources import as_stated
from fmopt.task.toml.model_file import MatingFeature
from fmopt.task.toml.source import Source

if TYPE_CHECKING:
    from fmopt.geometry.fit.find import FoundFit, Stated
    from fmopt.geometry.part import Part
    from fmopt.task.model import Model
    from fmopt.task.toml.problem_file import ProblemFile

Side = Literal["moving", "fixed"]
Kind = Literal["solid", "hollow"]
SIDES: tuple[Side, Side] = ("moving", "fixed")
_FULL = 1e-9  # m
_HERE = 1e-3  # m: stated features that are no nearer are others than one without a place
_ASIDE, _FAR = 0.1, 8.0  # of the size of what goes in, and times its start error, which it may be beside its way
_UPSIDE_DOWN = 0.7  # cosine between the way in and the file's own way down


@dataclass(frozen=True)
class Mated:
    """How a part mates, as far as that was found.

    Args:
        frame: of the feature in the model's frame (x, y, z and rotation vector), m and rad; None where the model states
            it.
    """

    side: Side
    feature: str
    frame: tuple[float, ...] | None

    def record(self) -> dict[str, Any]:
        """As a plan holds it."""
        known = {"side": self.side, "feature": self.feature}
        return known if self.frame is None else {**known, "frame": list(self.frame)}


def paired(
    source: Source, file: ProblemFile, models: Mapping[str, Model], parts: Mapping[str, Part]
) -> tuple[ProblemFile, Mapping[str, Mated], Mapping[str, Model]]:
    """The problem file and the models with features where they are not stated, as they were found, and which these are.

    Raises:
        InputError: nothing goes into anything; at the fixed part.
    """
    tables = {side: _tables(file, models[side], side) for side in SIDES}
    if all(len(tables[side]) == 1 and next(iter(tables[side].values())).is_whole for side in SIDES):
        if len({table.kind for side in SIDES for table in tables[side].values()}) == 1:
            message = f"the features of both parts are {tables['moving'].popitem()[1].kind}"
            raise InputError(source.place(("fixed",), of_key=True).fault("feature-kind", message, DESCRIBE))
        return _named(file, {side: next(iter(tables[side])) for side in SIDES}), {}, models
    fit = _fit(source, file, models, parts, tables)
    kinds = dict[Side, Kind](zip(SIDES, ("hollow", "solid") if fit.exchanged else ("solid", "hollow"), strict=True))
    said = {side: _said(tables[side], kinds[side], fit) for side in SIDES}
    frames = _frames(fit, {kinds[side]: said[side][1] for side in SIDES})
    found: dict[str, Mated] = {}
    changed: dict[str, Model] = {}
    for side in SIDES:
        (name, table), kind, frame = said[side], kinds[side], frames[kinds[side]]
        x, y, z, *turn = frame.vector().tolist()
        length, through = (fit.peg, False) if kind == "solid" else (fit.hole, fit.through)
        made = {"at": (x, y, z), "turn": tuple(turn), "length": length, "through": through}
        if table is not None:
            made |= {"length": table.length, "through": table.through} if table.length is not None else {}
        own = MatingFeature.model_construct(None, kind=kind, **made) if table is None else table.model_copy(update=made)
        model = models[side]
        kept = {other: one for other, one in model.file.features.items() if one.is_whole}
        notes = () if table is not None and table.is_whole else (_found(name, own, model),)
        notes = (*model.notes, *notes, *_doubts(parts[side], frame, fit, kind))
        completed = model.file.model_copy(update={"features": {**kept, name: own}})
        changed[side] = replace(model, file=completed, notes=notes)
        if table is None or not table.is_whole:
            found[side] = Mated(side, name, None if table is not None and table.at is not None else (x, y, z, *turn))
    if "depth" not in file.goal.model_fields_set and abs(fit.depth - min(fit.hole, fit.peg)) > _FULL:
        file = file.model_copy(update={"goal": file.goal.model_copy(update={"depth": fit.depth})})
    return _named(file, {side: said[side][0] for side in SIDES}), found, changed


def without_hollows(
    file: ProblemFile, models: Mapping[str, Model], parts: Mapping[str, Part], roles: tuple[str, str], depth: float
) -> Mapping[str, Model]:
    """The models, hollows of their meshes filled into which the other part never comes.

    Args:
        parts: of the models, in their frames.
        roles: the sides of what goes in, and of what it goes into.
        depth: of the tip below the mouth, m.
    """
    from fmopt.geometry.hollows import filled
    from fmopt.geometry.mesh.mesh_import import mesh_polyhedron
    from fmopt.geometry.mesh.round_planes import chord_error

    solid, hollow = (_pose(models[side].file.features[file.feature(side)]) for side in roles)
    seated = hollow.compose(_along(-depth)).compose(solid.inverse())
    away = Pose(np.zeros(3), np.diag([1.0, -1.0, -1.0])).compose(solid.inverse())  # what it goes into leaves downwards
    size, box = parts[roles[0]].polyhedron.diameter, as_stated(file.uncertainty.start).box
    # A plan may set down beside the mouth, a few errors off and turned, and slide there.
    error = float(np.hypot(*box[:2]) + 0.5 * size * np.linalg.norm(box[3:]))
    aside = 0.5 * size if file.uncertainty.sources else max(_ASIDE * size, _FAR * error)
    few = FEW_REFLEX if file.settings.evidence == "tested" else MOST_REFLEX
    changed = dict(models)
    sides = ((roles[0], seated.inverse(), roles[1], away), (roles[1], seated, roles[0], hollow.inverse()))
    for side, pose, other, upright in sides:
        if (model := models[side]).file.mesh is None:
            continue
        mesh, guest = imported(model.source, model.file.mesh), placed(parts[other].polyhedron, pose)
        if (body := filled(mesh.body, guest, upright, aside, few)) is mesh.body:
            continue
        found = replace(mesh, body=body, chord_error=chord_error(body) if mesh.kind == "mesh" else mesh.chord_error)
        if mesh.kind == "mesh" and mesh.noise is not None:  # what is left may have faces
            with suppress(GeometryError):
                found = mesh_polyhedron(body.vertices, triangulated(body), mesh.noise)
                found = replace(found, notes=(*mesh.notes, *found.notes))
        note = (
            f"warning: {parts[side].name}: its hollows into which {parts[other].name} does not come count as filled; "
            f"{len(found.body.faces)} of {len(mesh.body.faces)} faces are left"
        )
        changed[side] = replace(model, mesh=found, notes=(*model.notes, note))
    return changed


def _tables(file: ProblemFile, model: Model, side: Side) -> dict[str, MatingFeature]:
    """The features of a side that may mate, by name, as its model states them."""
    return {own: table for own, table in model.file.features.items() if file.operand(side).feature in (None, own)}


def _named(file: ProblemFile, names: Mapping[Side, str]) -> ProblemFile:
    operands: dict[str, Any] = {side: file.operand(side).model_copy(update={"feature": names[side]}) for side in SIDES}
    return file.model_copy(update=operands)


def _fit(
    source: Source,
    file: ProblemFile,
    models: Mapping[str, Model],
    parts: Mapping[str, Part],
    tables: Mapping[Side, Mapping[str, MatingFeature]],
) -> FoundFit:
    from fmopt.geometry.fit.find import find

    moving, fixed = (parts[side].polyhedron for side in SIDES)
    stated = tuple(_stated(tables[side], file.operand(side).feature) for side in SIDES)
    try:
        return find(moving, fixed, stated, file.goal.depth, _seated(file, models))
    except GeometryError as error:
        raise InputError(source.place(("fixed",), of_key=True).fault("no-fit", error.message, error.advice)) from error


def _stated(tables: Mapping[str, MatingFeature], name: str | None) -> Stated:
    from fmopt.geometry.fit.find import Stated

    kinds = {table.kind for table in tables.values()} or {kind for own, kind in FOUND.items() if own == name}
    frames = tuple(_pose(table) for table in tables.values() if table.at is not None)
    return Stated(kinds.pop() if len(kinds) == 1 else None, frames if len(frames) == len(tables) else ())


def _pose(table: MatingFeature) -> Pose:
    return Pose.from_vector([*(table.at or (0.0, 0.0, 0.0)), *table.turn])


def _said(tables: Mapping[str, MatingFeature], kind: Kind, fit: FoundFit) -> tuple[str, MatingFeature | None]:
    """The name of the feature that was found, and what is stated of it."""
    point = (fit.solid if kind == "solid" else fit.hollow).p
    own = [(name, table) for name, table in tables.items() if table.kind == kind]
    near = sorted(own, key=lambda one: _HERE if one[1].at is None else float(np.linalg.norm(_pose(one[1]).p - point)))
    return near[0] if near else (next(name for name in FOUND if FOUND[name] == kind), None)


def _frames(fit: FoundFit, said: Mapping[Kind, MatingFeature | None]) -> dict[Kind, Pose]:
    """The frames of both features in their models: as stated, or such that the goal has them on one axis."""
    tables = said["solid"], said["hollow"]
    solid, hollow = (None if table is None or table.at is None else _pose(table) for table in tables)
    if solid is not None and hollow is not None:
        return {"solid": solid, "hollow": hollow}
    if hollow is not None:
        below = float(hollow.inverse().compose(fit.pose).apply(fit.solid.p)[2])
        return {"hollow": hollow, "solid": fit.pose.inverse().compose(hollow).compose(_along(below))}
    if solid is not None:
        above = float(solid.inverse().compose(fit.pose.inverse()).apply(fit.hollow.p)[2])
        return {"solid": solid, "hollow": fit.pose.compose(solid).compose(_along(above))}
    return {"solid": fit.solid, "hollow": fit.hollow}


def _along(height: float) -> Pose:
    return Pose(np.array([0.0, 0.0, height]), np.eye(3))


def _found(name: str, table: MatingFeature, model: Model) -> str:
    """A feature that was found, as it would be written in a model file."""
    at = ", ".join(f"{1e3 * value + 0.0:.9g}" for value in table.at or ())  # + 0.0: no −0
    about = ", ".join(f"{math.degrees(angle) + 0.0:.9g}" for angle in table.turn)
    through = ", through" if table.through else ""
    return (
        f"found: [features.{name}] of the {model.kind}, {table.kind}, at = [{at}] mm, turn = [{about}] deg, "
        f"length = {1e3 * (table.length or 0.0):.9g} mm{through}"
    )


def _doubts(part: Part, frame: Pose, fit: FoundFit, kind: Kind) -> Iterator[str]:
    """What speaks against the way in that was found, as warnings."""
    from fmopt.geometry.fit.search import lies

    if kind == "hollow":
        if fit.alike > 1:
            yield f"warning: {part.name} has {fit.alike} openings that fit alike, of which one was taken"
        return
    if lies(part.polyhedron, frame.R[:, 2]):
        yield f"warning: {part.name} goes in across its longest axis, lying down, where it fits the closest"
    elif frame.R[2, 2] < -_UPSIDE_DOWN:
        yield f"warning: {part.name} goes in with the end first that is up in its file"


def _seated(file: ProblemFile, models: Mapping[str, Model]) -> Pose | None:
    """The pose of the moving part's frame in that of the fixed one, where both are bodies of one file."""
    from fmopt.geometry.body_names import chosen

    paths = {model.source.path for model in models.values()}
    which = [file.operand(side).body for side in SIDES]
    if len(paths) > 1 or any(model.given for model in models.values()) or None in which:
        return None
    found = bodies_of(paths.pop(), file.operand("moving").unit)
    moving, fixed = (found[chosen([body.name for body in found], str(name))] for name in which)
    return fixed.pose.inverse().compose(moving.pose)
