"""Trials: errors drawn for each by its own number.

A trial is its seed: what is drawn for it depends on the seed and its number alone, not on chunks, cores or the other
trials, so that runs can be interrupted, resumed and compared bit by bit.

Parts grown to the sides: interference fits, which must fail, out of fits that go together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fmopt.errors import PlanFormatError, SettingsError
from fmopt.execution.attempt import ReferenceCourse, carried_out
from fmopt.execution.baselines import BASELINES
from fmopt.execution.engines.catalogue import ENGINES
from fmopt.execution.engines.engine import Bodies, Setup
from fmopt.execution.noise import Noise
from fmopt.execution.press_controller import begun
from fmopt.execution.press_trials import press_records
from fmopt.execution.program import Program, planned
from fmopt.execution.recovery import Recovery
from fmopt.execution.rig import Rig
from fmopt.execution.robot import Robot
from fmopt.execution.summary import Fit, Log
from fmopt.plan import Body, Plan
from fmopt.plan.contact_geometry import contacts
from fmopt.plan.guarded_moves import moves
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array

METHODS: dict[str, Callable[[Plan, Robot], Program]] = {"plan": planned, **BASELINES}
RANGES = {  # of what is given by hand, with units; less or more than that is a slip
    "reach": (1.0, 100.0, ""),
    "time_step": (1e-6, 0.1, " s"),
    "friction": (0.0, 10.0, ""),
    "growth": (-0.1, 0.1, " m"),
    "offset": (-1.0, 1.0, " m"),
}
LATER = ("engine",)  # what older files of trials do not name: the engine, which was MuJoCo

_SIDEWAYS = 0.5  # |z| of the unit normal up to which a face looks sideways
_SAME = 1e-9  # m between vertices that are one


@dataclass(frozen=True)
class Trials:
    """What is to be run.

    Raises:
        SettingsError: a number is out of range.
    """

    inside: int
    beyond: int = 0
    reach: float = 2.0
    seed: int = 0
    time_step: float | None = None  # of the physics, s; None for what the clearance asks for
    friction: float | None = None  # coefficient; None for the plan's, which is the most that it allows for
    method: str = "plan"
    growth: float = 0.0  # of the moving part to each side, m; more than the clearance makes an interference fit
    offset: float = 0.0  # of each start along x, m, that nobody knows of
    recovery: bool = True  # whether a plan that says so backs off and tries again when a move fails
    covered: bool = False  # whether trials beyond have errors uniform in what the plan's retries cover, instead
    engine: str = "mujoco"

    def __post_init__(self) -> None:
        for name, (least, most, unit) in RANGES.items():
            value = getattr(self, name)
            if value is not None and not least <= value <= most:
                advice = f"give a number from {least:g} to {most:g}{unit}"
                raise SettingsError(f"{name.replace('_', ' ')} of {value:g}{unit}", advice)


@dataclass(frozen=True)
class Draw:
    """Errors of one trial: of the start pose (6,), its size in boxes, and of the velocity of each move (m, 6)."""

    start: Array
    size: float
    drift: Array


def draw(what: Plan, program: Program, trials: Trials, number: int) -> Draw:
    """The errors of a trial, counted from 0 through all of them; its own stream, whatever the others draw.

    Raises:
        PlanFormatError: errors are asked for that retries cover, or that are beyond the box, and there are none.
    """
    random = np.random.default_rng([trials.seed, number])
    box = np.array(what.start_box)
    share = random.uniform(-1.0, 1.0, 6)
    if number >= trials.inside and trials.covered:
        factors = _covered(what, box)
        share *= factors
        # Drawn again until it is outside of the box: uniform in what retries alone cover.
        while _size(share, box) <= 1.0:
            share = factors * random.uniform(-1.0, 1.0, 6)
    elif number >= trials.inside:
        if not box.any():
            raise PlanFormatError("the plan has no start error that others could be beyond", "leave out --beyond")
        # Sizes are uniform: of places that are, most would have nearly the greatest size.
        share *= random.uniform(1.0, trials.reach) / _size(share, box)
    size = _size(share, box)
    t, r = what.velocity_error
    count = max(step.move for step in program.steps) + 1
    rates = t * program.speed, r * program.speed / program.rho
    drift = np.hstack([rate * _ball(random, count) for rate in rates])
    start = share * box
    # After the size was taken: what nobody knows of is no error that is counted.
    start[0] += trials.offset
    return Draw(start, size, drift + _askew(what, program, share))


def _size(share: Array, box: Array) -> float:
    """How many boxes (6,) errors of a share (6,) of it take; 0 where the box is none."""
    return float(np.abs(share[box > 0.0]).max(initial=0.0))


def _askew(what: Plan, program: Program, share: Array) -> Array:
    """What errors that are fixed in the hole and in the hand add to the velocity of each move (m, 6), at full speed.

    In a hole that is askew by h every motion is seen turned by it; a part that is off by g in the hand swings by ω × g.
    Errors of a trial have the same share in all of their frames, and the sign that adds them up.
    """
    boxes = dict(what.sources)
    none = (0.0,) * 6
    hole, hand = share * boxes.get("hole", none), share * boxes.get("hand", none)
    # Backwards, so that of the pieces of a move the first one stays; so with the steps below. The steps of a baseline
    # are none of the plan's, though they have numbers, too: it goes as the part stands at the start.
    first = {segment.move: segment for segment in reversed(what.segments)} if program.name == "plan" else {}
    found = np.zeros((max(step.move for step in program.steps) + 1, 6))
    for step in reversed(program.steps):
        size = float(np.linalg.norm(step.twist * np.repeat([1.0, program.rho], 3)))
        if size > 0.0:
            v, w = np.reshape(step.twist * program.speed / size, (2, 3))
            here = Pose.from_vector(first[step.move].start) if step.move in first else program.start
            # Stated at the start in axes of B, it has turned with the part since.
            off = here.R @ program.start.R.T @ hand[:3]
            found[step.move] = np.concatenate([np.cross(hole[3:], v) + np.cross(w, off), np.cross(hole[3:], w)])
    return found


def _covered(what: Plan, box: Array) -> Array:
    """What a plan's retries cover, as factors (6,) of its start box."""
    covers = box if what.recovery is None else np.array(what.recovery.covers)
    if not (covers > box).any():
        raise PlanFormatError("the plan has no retries that cover more than its set", "leave out --covered")
    return np.asarray(np.where(box > 0.0, covers / np.where(box > 0.0, box, 1.0), 1.0))


def _ball(random: np.random.Generator, count: int) -> Array:
    """Uniform points (count, 3) in the unit ball."""
    v = random.normal(size=(count, 3))
    return np.asarray(v / np.linalg.norm(v, axis=1, keepdims=True) * random.uniform(size=(count, 1)) ** (1.0 / 3.0))


def run(
    what: Plan,
    trials: Trials,
    numbers: Sequence[int],
    told: Callable[[list[Any]], None] = lambda _: None,
    robot: Robot | None = None,
    look: Callable[[Any], None] | None = None,
) -> list[Any]:
    """Runs some trials together, and gives one record a trial, as in the file of trials.

    Raises:
        PlanFormatError: the plan cannot be run.
        ResourceError: the extra is missing.
    """
    if what.press_plan is not None:
        if trials.method != "plan":
            raise PlanFormatError("a plan of presses has no guarded moves to compare with", "use method plan")
        records = press_records(what, Bodies.of(grown(what, trials.growth)), trials, numbers, look)
        told(records)
        return records
    robot = robot or Robot()
    program = METHODS[trials.method](what, robot)
    is_plan = program.name == "plan"
    rows, known, fit = moves(what) if is_plan else (), contacts(what), Fit.of(what)
    friction = what.specification.friction if trials.friction is None else trials.friction
    parts = grown(what, trials.growth)
    put = ENGINES[trials.engine].scene(Setup(Bodies.of(parts), fit.clearance, robot, friction, trials.time_step))
    draws = [draw(what, program, trials, number) for number in numbers]
    recovery = Recovery.of(what) if is_plan and trials.recovery else None

    def record(body: int, log: Log) -> dict[str, Any]:
        one = draws[body]
        return {"trial": numbers[body], "size": one.size, "error": one.start.tolist(), **(log.outcome or {})}

    course = ReferenceCourse(recovery, rows, known, fit, look, lambda ended: told([record(*one) for one in ended]))

    def rig(starts: tuple[Array, Array], which: Sequence[int], attempt: int) -> Rig:
        # Every attempt has the errors of its trial; only the noise is new.
        noise = Noise(trials.seed, [numbers[k] for k in which], attempt)
        return Rig(put(starts), program, robot, np.stack([draws[k].drift for k in which], axis=1), noise)

    q = begun(program.start.vector()[None], np.stack([one.start for one in draws]))
    return [record(body, log) for body, log in enumerate(carried_out(course, rig, (q[:, :3], q[:, 3:])))]


def grown(plan: Plan, growth: float) -> Plan:
    """A plan whose moving part is thicker on each side: faces that look sideways move out, balls grow.

    Only what the scene is built from changes; moves and contacts stay as they are. The growth, m, has either sign;
    without any it is the plan itself.
    """
    if growth == 0.0:
        return plan
    pieces = tuple(_piece(piece, growth) for piece in plan.moving.pieces)
    body = plan.moving.body
    body = replace(body, balls=tuple((vertex, radius + growth) for vertex, radius in body.balls))
    return replace(plan, moving=replace(plan.moving, body=body, pieces=pieces))


def _piece(piece: Body, growth: float) -> Body:
    """The convex hull with faces n·x ≤ d moved to n·x ≤ d + growth where they look sideways; vertices alone."""
    from scipy.spatial import ConvexHull, HalfspaceIntersection

    vertices = np.array(piece.vertices)
    # The hull comes in triangles: the plane of a face once for each, equal but for rounding.
    rows = np.unique(np.round(ConvexHull(vertices).equations, 12), axis=0)
    rows[:, 3] -= np.where(np.abs(rows[:, 2]) <= _SIDEWAYS, growth, 0.0)
    return Body(_merged(HalfspaceIntersection(rows, vertices.mean(axis=0)).intersections), ())


def _merged(points: Any) -> tuple[tuple[float, ...], ...]:
    kept: list[Any] = []
    for point in points:
        if all(float(np.abs(point - other).max()) > _SAME for other in kept):
            kept.append(point)
    return tuple(sorted(tuple(float(value) for value in point) for point in kept))
