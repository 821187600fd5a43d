"""Whether a plan is of a problem as its files stand now: everything that its claims rest on, held against them."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from fmopt.errors import FmoptError
from fmopt.geometry.clearance import Clearance
from fmopt.geometry.part import Part
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.spatial.se3 import Pose
from fmopt.task.pairing import Mated
from fmopt.task.problem import Problem
from fmopt.task.sizes import IMPACT, characteristic_length, measured_clearance
from fmopt.verify.reading.document import Body, Found, StatedPlan
from fmopt.verify.reading.document import StatedPart as Stated

_OF_ROBOT = ("stiffness", "mass", "limits", "delay", "noise")
REMARK = "the problem's files were read by the planner's own reader"
_SAME = 1e-12  # m, rad: between numbers that went the same way
_SEATED = 1e-6  # m, rad: walls of rounded numbers seat a part a little off the pose of its goal
_STARTED = 1e-9  # m: between the lowest point at the start and the height that it has by the problem


def differences(plan: StatedPlan, problem: Problem) -> tuple[str, ...]:
    """What a plan states otherwise than a problem, in words with place and both values; none if they agree."""
    own, given = (plan.moving, plan.fixed), (problem.moving, problem.fixed)
    parts = [
        line
        for side, stated, part, mated in zip(("moving", "fixed"), own, given, problem.mated, strict=True)
        for line in (
            *_part(side, stated, part, problem, pieces=bool(plan.presses)),
            *_mating(side, stated.found, mated),
        )
    ]
    found = [*_digest(plan, problem), *_task(plan, problem), *_errors(plan, problem), *parts]
    # Other parts have another clearance, which is not told again.
    return (*found, *(() if parts else _measured(plan, problem)))


def _other(key: str, words: str, own: object, given: object) -> str:
    """A difference in words: the key of the plan, how it differs, and both values."""
    return f"{key}: the plan {words}: {own} stands where the problem gives {given}"


def _digest(plan: StatedPlan, problem: Problem) -> Iterator[str]:
    if plan.problem != problem.sha256:
        yield (
            "problem.sha256: the plan belongs to another problem, or the problem's files have changed since: "
            f"{plan.problem[:12]}… stands where the files give {problem.sha256[:12]}…"
        )


def _part(side: str, stated: Stated, part: Part, problem: Problem, pieces: bool) -> Iterator[str]:
    """A part of a plan beside that of its file: its surface, which the check holds its pieces against."""
    declared = problem.declared_clearance
    if not _same(stated.declared_clearance or (), declared or ()):
        key, words = f"parts.{side}.declared_clearance", "states another declared clearance"
        yield _other(key, words, stated.declared_clearance, declared)
    another = f"the plan is for another {side} part than {part.name!r}"
    if (off := _off(stated.body, part.polyhedron)) is not None:
        yield f"parts.{side}: {another}: {off}"
    elif pieces and (len(stated.pieces) != len(part.pieces) or any(map(_off, stated.pieces, part.pieces))):
        yield f"parts.{side}.pieces: {another}: its convex pieces are not those of the file"
    if part.form > stated.form:
        yield (
            f"parts.{side}.form: the plan allows for {stated.form!r} m between its {side} part and the surface of its "
            f"file, which lies up to {part.form!r} m off"
        )


def _off(own: Body, given: Polyhedron) -> str | None:
    """How a body differs from that of a file, in words; None where it does not."""
    if sorted(own.balls) != sorted(given.balls):
        return "its balls are not those of the file"
    vertices = np.array(own.vertices)
    if vertices.shape == given.vertices.shape and own.faces == tuple(face.loops for face in given.faces):
        most = float(np.abs(vertices - given.vertices).max(initial=0.0))
        return None if most <= _SAME else f"its corners lie up to {1e3 * most:.6g} mm off those of the file"
    counts = f"{len(vertices)} corners and {len(own.faces)} faces where the file has"
    return f"{counts} {len(given.vertices)} and {len(given.faces)}"


def _task(plan: StatedPlan, problem: Problem) -> Iterator[str]:
    """Goal, start and specification."""
    # Not x and y of guarded moves, which are where walls seat the part.
    if plan.presses and not _same(plan.goal[:2], problem.goal[:2].tolist()):
        yield _other("goal", "ends beside the goal", f"{list(plan.goal[:2])} m", problem.goal[:2].tolist())
    depth = float(problem.goal[2])
    if abs(plan.goal[2] - depth) > _SEATED:
        yield f"goal: the plan ends at another depth: z is {plan.goal[2]!r} m, by the problem {depth!r} m"
    if float(np.abs(np.array(plan.goal[3:]) - problem.goal[3:]).max()) > _SEATED:
        yield (
            f"goal: the plan ends in another orientation: {list(plan.goal[3:])} rad, by the problem "
            f"{problem.goal[3:].tolist()}"
        )
    if plan.segments:  # presses begin where the planner chose: nothing of them is proved
        begin, body = Pose.from_vector(plan.segments[0].start), problem.moving.polyhedron
        lowest = float((begin.apply(body.vertices)[:, 2] - body.radii).min())
        if abs(lowest - problem.approach) > _STARTED:
            yield (
                f"segments[0].start: the part's lowest point starts {lowest!r} m above the mouth, by the problem "
                f"{problem.approach!r} m"
            )
    described = getattr(plan, "description", None)
    if described is not None and not _same(described.tcp, problem.tcp.tolist()):
        yield (
            f"description.tcp: the plan is for another tool: its centre point is at {list(described.tcp)} where the "
            f"problem has it at {problem.tcp.tolist()}"
        )
    own, given = _specification(plan), problem.specification.record()
    for name in dict.fromkeys((*given, *own)):
        if not _same(*([value] if (value := of.get(name)) is not None else [] for of in (own, given))):
            yield _other(f"specification.{name}", "is for another specification", own.get(name), given.get(name))


def _specification(plan: StatedPlan) -> dict[str, Any]:
    own = plan.specification
    names = ("speed", "contact_force", "torque_limit", "friction", "termination_force")
    found = {name: getattr(own, name) for name in names}
    return found if own.impact is None else found | dict(zip(IMPACT, own.impact, strict=True))


def _errors(plan: StatedPlan, problem: Problem) -> Iterator[str]:
    """Start errors, the frames that they are fixed in, and velocity errors."""
    wanted, velocity = problem.start_box.tolist(), problem.velocity_error
    if not _same(plan.start_box, wanted):
        share = _share(plan.start_box, wanted)
        part = "" if share is None else f", {share:.0%} of them"
        yield _other("uncertainty.start_box", f"is for other start errors{part}", list(plan.start_box), wanted)
    stated = dict(plan.sources) or {"world": plan.start_box}
    for frame, box in zip(("hole", "hand", "world"), problem.framing.parts(problem.start_box), strict=True):
        if not _same(stated.get(frame, (0.0,) * 6), box.tolist()):
            words = f"takes other errors for fixed in the {frame}"
            yield _other("uncertainty.sources", words, list(stated.get(frame, ())), box.tolist())
    rates = [velocity.translation, velocity.rotation]
    if not _same(plan.velocity_error, rates):
        yield _other("uncertainty.velocity_error", "is for another velocity error", list(plan.velocity_error), rates)


def _presses(plan: StatedPlan, problem: Problem, clearance: Clearance) -> Iterator[str]:
    """What trials of presses rest on: the seat, the robot, what they are drawn from, and the rate asked for."""
    presses, evidence = (getattr(plan, name, None) for name in ("press_plan", "trials"))
    if presses is None:
        return
    from fmopt.planning.press.solve import conditions_of, robot_for
    from fmopt.planning.press.task import PressTask

    task = PressTask(problem, problem.moving, problem.fixed, clearance, problem.start_box)
    robot = robot_for(task)
    pairs = [
        ("seat", presses.seat, task.seat),
        *((f"robot.{name}", getattr(presses.robot, name), getattr(robot, name)) for name in _OF_ROBOT),
    ]
    if evidence is not None:
        pairs += [
            ("evidence.conditions", evidence.conditions, conditions_of(problem)),
            ("evidence.min_rate", evidence.min_rate, problem.settings.min_rate),
            ("evidence.max_time", evidence.max_time, problem.settings.max_time),
        ]
    if presses.cell != problem.cell:
        yield "presses.cell: the plan's trials are of another problem: tool or obstacles are not those of its files"
    yield from (
        f"{name}: the plan's trials are of another problem: {own} stands where the problem gives {wanted}"
        for name, own, wanted in pairs
        if own != wanted
    )


def _mating(side: str, stated: Found | None, mated: Mated | None) -> Iterator[str]:
    """How a plan says that a part mates, beside what is found on its file."""
    alike = stated is None and mated is None
    if stated is not None and mated is not None:
        names = (stated.side, stated.feature) == (mated.side, mated.feature)
        alike = names and _same(stated.frame or (), mated.frame or ())
    if not alike:
        yield f"parts.{side}.found: the plan has the {side} part mate otherwise than is found on its file"


def _measured(plan: StatedPlan, problem: Problem) -> Iterator[str]:
    """What is measured on the parts: the clearance, and the length that weighs rotation."""
    try:
        clearance = measured_clearance(problem)
    except FmoptError as error:
        yield f"parts: the clearance of the problem's parts cannot be measured: {error.message}"
        return
    length = characteristic_length(problem, clearance)
    if not _same([plan.rho], [length]):
        yield _other("uncertainty.rho", "weighs rotation by another length", f"{plan.rho!r} m", f"{length!r} m")
    yield from _presses(plan, problem, clearance)


def _share(stated: Sequence[float], wanted: Sequence[float]) -> float | None:
    """The share of the problem's errors that a plan states, where it is one and the same for all of them."""
    shares = [a / b for a, b in zip(stated, wanted, strict=True) if b]
    if not shares or any(a for a, b in zip(stated, wanted, strict=True) if not b):
        return None
    return shares[0] if max(shares) - min(shares) <= 1e-9 else None


def _same(a: Sequence[float], b: Sequence[float]) -> bool:
    return len(a) == len(b) and all(math.isclose(x, y, rel_tol=_SAME, abs_tol=_SAME) for x, y in zip(a, b, strict=True))
