"""A problem file as the check reads it: everything of it that a plan's claims rest on."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from fmopt.verify.arithmetic.rational import dot, number, vector
from fmopt.verify.problem.model import Feature, Model, load_model, overrides_of
from fmopt.verify.problem.quantities import ANGLE, FORCE, LENGTH, MASS, RATIO, SPEED, STIFFNESS, TORQUE, Dimension
from fmopt.verify.problem.solids import Frame, Tree, frame, tree_of
from fmopt.verify.problem.sources import HAND, HOLE, TILT, WORLD, Boxed, Point, Pose, Sources, total
from fmopt.verify.problem.tables import LARGEST_MESH, ProblemError, Table, read, read_bytes, spelled_out, with_units
from fmopt.verify.reading.document import Found

_ZERO = (0.0, 0.0, 0.0)
_INNER = 1e-6  # m: how far inside a peg whose length is found its axis is looked at
_LEAST = 1e-9  # m and rad: the least start error where velocity adds none
_LEAST_HEIGHT = 1e-3  # m: of the lowest point at the start where the errors come from sources
# What holds where the file says nothing.
_USUAL_DRIFT, _USUAL_TILT = 0.01, math.radians(25.0)
_USUAL = {"speed": 0.02, "contact_force": 20.0, "torque_limit": 1.0, "friction": 0.3, "termination_force": 2.0}
_PAIRS = ("cylindrical", "prismatic", "planar", "screw", "spherical", "revolute")
_TURNING = ("cylindrical", "revolute")
_SPECIFIED: tuple[tuple[str, Dimension], ...] = (
    *(("speed", SPEED), ("contact_force", FORCE), ("torque_limit", TORQUE), ("friction", RATIO)),
    ("termination_force", FORCE),
)
_IMPACT: tuple[tuple[str, Dimension], ...] = (
    *(("impact_force", FORCE), ("apparent_mass", MASS), ("contact_stiffness", STIFFNESS)),
)


@dataclass(frozen=True)
class Problem:
    """A problem file and its two models.

    The moving part is the one with the peg, also where the hole is in the hand and the operands are exchanged.

    Attributes:
        table: the file, its short forms spelled out.
        said: what stands in it.
        models: by the side that the file gives them, "moving" and "fixed".
        names: of the features that mate, by the same, where the file names them.
        found: how they mate where the files do not say it, by side of the plan, as the plan states it.
    """

    table: Table
    said: Mapping[str, Any]
    models: Mapping[str, Model]
    names: Mapping[str, str | None]
    found: Mapping[str, Found]

    @cached_property
    def exchanged(self) -> bool:
        """Whether the hole is in the hand."""
        return self._feature("moving").kind == "hollow"

    def model(self, side: str) -> Model:
        """The model of a side of the plan."""
        return self.models[self._given(side)]

    def feature(self, side: str) -> Feature:
        """The feature by which a side of the plan mates."""
        return self._feature(self._given(side))

    def framed(self, side: str) -> bool:
        """Whether the frame of a side's feature is known: from its model, or from the plan."""
        return not self.feature(side).found or (side in self.found and self.found[side].frame is not None)

    def _given(self, side: str) -> str:
        other = {"moving": "fixed", "fixed": "moving"}
        return other[side] if self.exchanged else side

    def _feature(self, side: str) -> Feature:
        """The feature by which the part of a table mates."""
        model, name = self.models[side], self.names[side]
        chosen = next(((own, choice) for own, choice in self.found.items() if choice.side == side), None)
        if name is None and chosen is not None:
            name = chosen[1].feature
        stated = model.features.get(name or "")
        if (stated is None or stated.found) and chosen is not None and chosen[1].frame is not None:
            return self._framed(side, chosen, stated)
        if not model.features and not model.planar and name is not None:
            # Found by the planner, which calls pegs "peg" and holes "hole".
            return Feature("hollow" if name.startswith("hole") else "solid", _ZERO, _ZERO, math.inf, (), found=True)
        if name is None:
            raise self.table.table(side).error("feature", "is not stated, and the plan does not say what was found")
        if name not in model.features:
            raise self.table.table(side).error("feature", f"the model has no feature {name!r}")
        return model.features[name]

    def _framed(self, side: str, chosen: tuple[str, Found], stated: Feature | None) -> Feature:
        """A feature in the frame that the plan states, where the model leaves it to be found."""
        x, y, z, *turn = chosen[1].frame or (*_ZERO, *_ZERO)
        kind = "solid" if chosen[0] == "moving" else "hollow"
        if stated is None:
            if self.models[side].features or self.models[side].planar:
                raise self.table.table(side).error("feature", f"the model has no feature {chosen[1].feature!r}")
            return Feature(kind, (x, y, z), tuple(turn), math.inf, (), found=True)
        if stated.kind != kind:
            message = "states another kind of feature than the plan"
            raise self.models[side].table.table("features").error(chosen[1].feature, message)
        return replace(stated, at=(x, y, z), turn=tuple(turn))

    @cached_property
    def planar(self) -> bool:
        """Whether both parts move in a plane."""
        planar = [self.models[side].planar for side in ("moving", "fixed")]
        if planar[0] != planar[1]:
            raise self.table.table("fixed").error("model", "one part is a profile, the other one is a body")
        return planar[0]

    @cached_property
    def sha256(self) -> str:
        """Digest of what the files say: their data in one canonical form, meshes byte by byte."""
        content: dict[str, Any] = {"problem": self.said, "models": {}, "meshes": {}}
        for side, model in self.models.items():
            # A file that the problem names itself has no model beside it.
            if model.given:
                content["models"][side] = model.table.data
            if model.mesh is not None:
                table, key = (model.table.table("mesh"), "file") if model.given else (model.table, "model")
                mesh = read_bytes(model.mesh.path, table, key, LARGEST_MESH)
                content["meshes"][side] = hashlib.sha256(mesh).hexdigest()
        try:
            # To the letter as the planner writes it: else no digest would fit.
            text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
        except (TypeError, ValueError):
            raise ProblemError(str(self.table.file), "", "holds a date, or a number that is not finite") from None
        return hashlib.sha256(text.encode()).hexdigest()

    @cached_property
    def depth(self) -> float | None:
        """How far the peg's leading face goes below the mouth, m; None where features that were found decide it."""
        goal = self._maybe("goal")
        deepest = min(self.feature(side).length for side in ("moving", "fixed"))
        if not goal.has("depth") or goal.value("depth") in ("full", "free"):
            features = [self.feature(side) for side in ("moving", "fixed")]
            return None if any(one.found or math.isinf(one.length) for one in features) else deepest
        depth = goal.number("depth", LENGTH, _LEAST)
        if depth > deepest:
            raise goal.error("depth", f"is deeper than hole and peg allow, {deepest!r} m")
        return depth

    @cached_property
    def turn(self) -> float:
        """Angle of the peg about the axis of the hole at the goal, by which its mating frame is turned, rad."""
        goal = self._maybe("goal").only("depth", "turn", "attachment")
        if not self.framed("moving"):
            return 0.0  # its frame is found, however it is turned
        stated = goal.text("attachment", _PAIRS) if goal.has("attachment") else None
        pair = stated or ("cylindrical" if self.is_round else "prismatic")
        if goal.has("turn") and goal.value("turn") != "free":
            angle = goal.number("turn", ANGLE, -6.3, 6.3)
            return -angle if self.exchanged else angle  # seen from the hole in the hand, the peg turns back
        chosen = next(iter(self.found.values()), None)
        if chosen is not None and chosen.turn != 0.0 and not goal.has("turn"):
            return chosen.turn
        if pair not in _TURNING or not (goal.has("turn") or self.is_round):
            return 0.0
        twist = self._twist
        return -twist if self.exchanged else twist

    @property
    def _twist(self) -> float:
        """The twist about z of the orientation in which the nominal trajectory begins, rad."""
        turn = self._maybe("start").vector("turn", ANGLE, _ZERO)
        angle = math.hypot(*turn)
        if angle == 0.0:
            return 0.0
        # Swing and twist: of the quaternion (w, x, y, z) the twist about z is 2 atan2(z, w), w not negative.
        along, real = turn[2] / angle * math.sin(0.5 * angle), math.cos(0.5 * angle)
        return 2.0 * math.atan2(along if real >= 0.0 else -along, abs(real))

    @cached_property
    def is_round(self) -> bool:
        """Whether what the peg is made of are solids of revolution about its axis."""
        feature, solid = self.feature("moving"), self.model("moving").solid
        if solid is None:
            return False
        at = frame(feature.at, feature.turn).inverse
        middle = vector((0.0, 0.0, _INNER if math.isinf(feature.length) else 0.5 * feature.length))
        found = []
        for (name, round_), tree in zip(_convex(solid), _leaves(tree_of(solid, at)), strict=True):
            # Where it does not say, it is made of what its axis goes through halfway.
            if name in feature.solids if feature.solids else _holds(tree, middle):
                found.append(round_ and _is_about_axis(tree))
        return bool(found) and all(found)

    def frame(self, side: str) -> Frame:
        """Where points of a side's model go in its mating frame."""
        feature = self.feature(side)
        inward = frame(feature.at, feature.turn).inverse
        return frame(_ZERO, (0.0, 0.0, self.turn)).after(inward) if side == "moving" and self.turn else inward

    @cached_property
    def approach(self) -> float | None:
        """Height of the tilted part's lowest point above the mouth at the start, m; None where the planner chose it."""
        return self._maybe("start").only("height", "at", "turn").maybe("height", LENGTH, 1e-9)

    @cached_property
    def declared_clearance(self) -> tuple[float, float] | None:
        """Clearance on each side along x and y, m; None where none is declared."""
        if not self.table.has("clearance"):
            return None
        table = self.table.table("clearance").only("x", "y")
        x, y = table.number("x", LENGTH), table.maybe("y", LENGTH)
        return x, (0.0 if self.planar else x) if y is None else y

    @cached_property
    def velocity_error(self) -> tuple[float, float]:
        """Shares of translation and of rotation."""
        uncertainty = self.table.table("uncertainty")
        if not uncertainty.has("velocity"):
            return _USUAL_DRIFT, _USUAL_DRIFT
        table = uncertainty.table("velocity").only("translation", "rotation")
        across, turning = (table.maybe(name, RATIO, 0.0, 1.0) for name in ("translation", "rotation"))
        return _USUAL_DRIFT if across is None else across, _USUAL_DRIFT if turning is None else turning

    @cached_property
    def specification(self) -> dict[str, float]:
        """What is given of speed, forces and friction, by name."""
        table = self._maybe("specification").only(*(name for name, _ in (*_SPECIFIED, *_IMPACT)))
        found = {
            name: max(table.interval(name, kind, 0.0, 1e12)) if table.has(name) else _USUAL[name]
            for name, kind in _SPECIFIED
        }
        return found | {name: table.number(name, kind, 0.0, 1e12) for name, kind in _IMPACT if table.has(name)}

    @cached_property
    def characteristic_length(self) -> float | None:
        """The length that weighs rotation, m, where it is stated."""
        return self.settings.maybe("characteristic_length", LENGTH, 1e-9)

    @cached_property
    def settings(self) -> Table:
        """The table [settings]."""
        known = "method placement max_tilt characteristic_length reduce_errors time_limit evidence min_rate draws seed"
        return self._maybe("settings").only(*known.split())

    def _maybe(self, key: str) -> Table:
        """A table that may be missing, which is then empty."""
        if self.table.has(key):
            return self.table.table(key)
        return replace(self.table, key=key, data={})

    def start_boxes(self, moving: Sequence[Point], fixed: Sequence[Point], chords: Mapping[str, float]) -> list[Boxed]:
        """What adds up to the half-widths of the start error, with the frame in which each is fixed.

        Args:
            moving, fixed: corners of the parts in their mating frames, m.
            chords: how far the true surfaces lie from the facets of meshes, by side of the plan, m.
        """
        table = self.table.table("uncertainty").only("start", "sources", "trapezoid", "velocity")
        if table.has("start") == table.has("sources"):
            raise table.error("start", "give either [uncertainty.start] or [uncertainty.sources]")
        if table.has("sources"):
            if self.exchanged:
                raise table.error("sources", "the hollow part is in the hand: give [uncertainty.start]")
            sources = Sources(table.table("sources"), moving, fixed)
            found = sources.boxes(self._pose(sources, moving))
        else:
            found = [self._stated(table.table("start"))]
        found += [
            Boxed(HAND if self._given(side) == "moving" else HOLE, (off, off, off, 0.0, 0.0, 0.0))
            for side, off in chords.items()
            if off > 0.0
        ]
        # Not where velocity has an error: that adds to all directions anyway.
        lacking = tuple(max(_LEAST - half, 0.0) for half in total(found))
        if any(lacking) and not any(self.velocity_error):
            found.append(Boxed(WORLD, lacking))
        if self.planar:
            kept = (1.0, 0.0, 1.0, 0.0, 1.0, 0.0)  # x, z and ry
            found = [Boxed(b.frame, tuple(x * k for x, k in zip(b.box, kept, strict=True))) for b in found]
        # With the hole in the hand, it is the peg that stands in the world.
        return [Boxed(HOLE if b.frame == HAND else HAND, b.box) for b in found] if self.exchanged else found

    def _stated(self, table: Table) -> Boxed:
        table.only("frame", "position", "angle", "x", "y", "z", "rx", "ry", "rz")
        frame_ = table.text("frame", (WORLD, HOLE, HAND)) if table.has("frame") else WORLD
        shift, tilt = table.maybe("position", LENGTH), table.maybe("angle", ANGLE, 0.0, TILT)
        lengths = [table.maybe(axis, LENGTH) if table.has(axis) else shift for axis in ("x", "y", "z")]
        angles = [table.maybe(axis, ANGLE, 0.0, TILT) if table.has(axis) else tilt for axis in ("rx", "ry", "rz")]
        for name, value, asked in zip(("x", "y", "z", "rx", "ry", "rz"), (*lengths, *angles), "101010", strict=True):
            if value is None and (asked == "1" or not self.planar):
                raise table.error(name, "this key is missing")
        return Boxed(frame_, tuple(value or 0.0 for value in (*lengths, *angles)))

    def _pose(self, sources: Sources, moving: Sequence[Point]) -> Pose:
        """Where the part may start at most: leaning by 1.3 times the tilts, a few errors beside the axis."""
        tilt = self.settings.maybe("max_tilt", ANGLE, 0.0, TILT)
        # √2, as the tilt is about each of two axes.
        lean = min(1.3 * math.sqrt(2.0) * (_USUAL_TILT if tilt is None else tilt), 0.5 * math.pi)
        radius = max((math.hypot(x, y) for x, y, z in moving if abs(z) <= 1e-9), default=0.0)
        height = (_LEAST_HEIGHT if self.approach is None else self.approach) + radius * math.sin(lean)
        upright = total(sources.boxes(Pose(height, 0.0, lean)))
        swing = radius * math.hypot(*upright[3:])
        return Pose(height, 7.0 * upright[0] + 3.0 * swing + radius * (1.0 - math.cos(lean)), lean)


def load_problem(
    path: Path, data: Mapping[str, Any] | None = None, found: Mapping[str, Found] | None = None
) -> Problem:
    """The problem of a file, or of the data that is given in its place.

    Raises:
        ProblemError: the file or one of its models cannot be read.
    """
    known = ("title", "units", "moving", "fixed", "goal", "clearance", "start", "grasp", "uncertainty")
    whole = read(path, None, "") if data is None else with_units(path, data)
    table = spelled_out(whole).only(*known, "specification", "robot", "settings")
    models, names = {}, {}
    for side in ("moving", "fixed"):
        operand = table.table(side).only("model", "unit", "body", "feature", "parameters")
        models[side] = load_model(operand, overrides_of(operand))
        names[side] = operand.text("feature") if operand.has("feature") else None
    problem = Problem(table, whole.data, models, names, found or {})
    if not any(problem.feature(side).found for side in models):
        kinds = {problem.feature(side).kind for side in ("moving", "fixed")}
        if len(kinds) == 1:
            raise table.table("moving").error("feature", f"both features are {kinds.pop()}")
    return problem


def _convex(solid: Any) -> Iterator[tuple[str, bool]]:
    """The convex solids that a solid is made of: their names, and whether they are of revolution."""
    if solid.convex is not None:
        yield solid.name, solid.convex.turned
    for part in solid.first:
        yield from _convex(part)


def _leaves(tree: Tree) -> Iterator[Tree]:
    if tree.body is not None:
        yield tree
    for part in tree.first:
        yield from _leaves(part)


def _holds(tree: Tree, point: Any) -> bool:
    return tree.body is not None and all(dot(plane.n, point) <= plane.o for plane in tree.body.planes)


def _is_about_axis(tree: Tree) -> bool:
    """Whether a body reaches equally far to all four sides of the z axis, and its box is centred on it."""
    body = tree.body
    if body is None:
        return False
    reach = [abs(number(body.low[k])) for k in (0, 1)] + [abs(number(body.high[k])) for k in (0, 1)]
    return max(reach) - min(reach) <= 1e-9 + 0.05 * max(reach)
