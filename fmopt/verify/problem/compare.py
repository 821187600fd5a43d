"""Whether a plan is of a problem as its files stand now: everything that its claims rest on, held against them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fmopt.verify.document import Plan
from fmopt.verify.problem.parts import Chord, Reader, part_beside_its_model
from fmopt.verify.problem.problem import Problem, load_problem
from fmopt.verify.problem.section import half_diagonals
from fmopt.verify.problem.sources import WORLD, by_frame, total
from fmopt.verify.rational import number, vector
from fmopt.verify.rows import pose

SAME = 1e-12  # m, rad: between numbers that went the same way
SEATED = 1e-6  # m, rad: walls of rounded numbers seat a part a little off the pose of its goal
LEAST_LEVER = 2.0**-10  # m: what ρ is at least, where the problem does not state it
STARTED = 1e-9  # m: between the lowest point at the start and the height that it has by the problem
SIDES = ("moving", "fixed")


@dataclass(frozen=True)
class Held:
    """A plan held against a problem: differences, and what was taken as the planner has it, each in words."""

    differences: tuple[str, ...]
    remarks: tuple[str, ...]


def differences(plan: Plan, path: Path) -> list[str]:
    """What a plan states otherwise than the problem of a file, in words with place and both values; none if they agree.

    Raises:
        ProblemError: the problem or one of its files cannot be read.
    """
    return list(held(plan, path).differences)


def held(plan: Plan, path: Path, data: Mapping[str, Any] | None = None, reader: Reader | None = None) -> Held:
    """A plan held against the problem of a file.

    Args:
        plan: of a form that the check accepts.
        path: the problem file.
        data: what it holds, where that is something else by now.
        reader: the planner's reading of the parts, for files that the check cannot read; None to leave those out.

    Raises:
        ProblemError: the problem or one of its files cannot be read.
    """
    problem = load_problem(path, data)
    # The digest is told first, and taken last, as others say better which key of a file is wrong.
    parts = {side: part_beside_its_model(plan.parts[side], problem, side, reader) for side in SIDES}
    found = [*_task(plan, problem), *_errors(plan, problem, {side: part.chord for side, part in parts.items()})]
    found += [line for side in SIDES for line in (*_declared(plan, problem, side), *parts[side].differences)]
    remarks = [line for side in SIDES for line in parts[side].remarks]
    if problem.depth is None:
        remarks.append(f"the goal is {-plan.goal[2]!r} m deep by the plan, as deep as the features that it found allow")
    return Held((*_digest(plan, problem), *found), tuple(remarks))


def _digest(plan: Plan, problem: Problem) -> Iterator[str]:
    if plan.problem != problem.sha256:
        yield (
            "problem.sha256: the plan belongs to another problem, or the problem's files have changed since: "
            f"{plan.problem[:12]}… stands where the files give {problem.sha256[:12]}…"
        )


def _declared(plan: Plan, problem: Problem, side: str) -> Iterator[str]:
    own = plan.parts[side].declared_clearance
    if not _same(own, problem.declared_clearance):
        yield (
            f"parts.{side}.declared_clearance: the plan states another declared clearance: {list(own)} stands where "
            f"the problem gives {list(problem.declared_clearance)}"
        )


def _task(plan: Plan, problem: Problem) -> Iterator[str]:
    """Goal, start and specification."""
    stated, wanted = plan.goal[2], plan.goal[2] if problem.depth is None else -problem.depth
    if abs(stated - wanted) > SEATED:
        yield f"goal: the plan ends at another depth: z is {stated!r} m, by the problem {wanted!r} m"
    if max(map(abs, plan.goal[3:])) > SEATED:
        yield f"goal: the plan ends in another orientation: {list(plan.goal[3:])} rad, by the problem 0"
    begin = pose(plan.segments[0].start)
    lowest = min(number(begin.apply(vector(corner))[2]) for corner in plan.moving.body.vertices)
    if abs(lowest - problem.approach) > STARTED:
        yield (
            f"segments[0].start: the part's lowest point starts {lowest!r} m above the mouth, by the problem "
            f"{problem.approach!r} m"
        )
    own, given = _specification(plan), problem.specification
    for name in dict.fromkeys((*given, *own)):
        if not _equal(own.get(name), given.get(name)):
            yield (
                f"specification.{name}: the plan is for another specification: {own.get(name)!r} stands where the "
                f"problem gives {given.get(name)!r}"
            )


def _specification(plan: Plan) -> dict[str, float]:
    own = plan.specification
    found = {
        "speed": own.speed,
        "contact_force": own.contact_force,
        "torque_limit": own.torque_limit,
        "friction": own.friction,
        "termination_force": own.termination_force,
    }
    names = ("impact_force", "apparent_mass", "contact_stiffness")
    return found if own.impact is None else found | dict(zip(names, own.impact, strict=True))


def _errors(plan: Plan, problem: Problem, chords: Mapping[str, Chord]) -> Iterator[str]:
    """Start errors, velocity errors, and the length that weighs rotation."""
    corners = {side: plan.parts[side].body.vertices for side in SIDES}
    least = problem.start_boxes(corners["moving"], corners["fixed"], {side: chords[side].least for side in SIDES})
    most = problem.start_boxes(corners["moving"], corners["fixed"], {side: chords[side].most for side in SIDES})
    wanted, above = total(least), total(most)
    if not _between(plan.start_box, wanted, above):
        share = _share(plan.start_box, wanted)
        part = "" if share is None else f", {share:.0%} of them"
        yield (
            f"uncertainty.start_box: the plan is for other start errors{part}: {list(plan.start_box)} stands where the "
            f"problem gives {list(wanted)}"
        )
    yield from _frames(plan, by_frame(least), by_frame(most))
    if not _same(plan.velocity_error, problem.velocity_error):
        yield (
            f"uncertainty.velocity_error: the plan is for another velocity error: {list(plan.velocity_error)} stands "
            f"where the problem gives {list(problem.velocity_error)}"
        )
    stated = problem.characteristic_length
    depth = -plan.goal[2] if problem.depth is None else problem.depth
    pieces = [plan.parts[side].pieces for side in SIDES]
    halves = half_diagonals(pieces[0], pieces[1], depth) if stated is None else ()
    lengths = [max(half, LEAST_LEVER) for half in halves] if stated is None else [stated]
    if not any(abs(plan.rho - length) <= SAME for length in lengths):
        wanted_ = " or ".join(dict.fromkeys(f"{length!r} m" for length in lengths)) or "none"
        yield (
            f"uncertainty.rho: the plan weighs rotation by another length: {plan.rho!r} m stands where the problem "
            f"gives {wanted_}"
        )


def _frames(plan: Plan, wanted: Mapping[str, Sequence[float]], most: Mapping[str, Sequence[float]]) -> Iterator[str]:
    """In which frame each part of the start errors is fixed."""
    stated = dict(plan.sources) or {WORLD: plan.start_box}
    for frame, box in wanted.items():
        own = stated.get(frame, (0.0,) * 6)
        if not _between(own, box, most[frame]):
            yield (
                f"uncertainty.sources: the plan takes other errors for fixed in the {frame}: {list(own)} stands where "
                f"the problem gives {list(box)}"
            )


def _share(stated: Sequence[float], wanted: Sequence[float]) -> float | None:
    """The share of the problem's errors that a plan states, where it is one and the same for all of them."""
    shares = [a / b for a, b in zip(stated, wanted, strict=True) if b]
    if not shares or any(a for a, b in zip(stated, wanted, strict=True) if not b):
        return None
    return shares[0] if max(shares) - min(shares) <= 1e-9 else None


def _between(x: Sequence[float], least: Sequence[float], most: Sequence[float]) -> bool:
    return all(a - SAME <= value <= b + SAME for value, a, b in zip(x, least, most, strict=True))


def _same(a: Sequence[float], b: Sequence[float], off: float = SAME) -> bool:
    return len(a) == len(b) and all(abs(x - y) <= off for x, y in zip(a, b, strict=True))


def _equal(a: float | None, b: float | None) -> bool:
    return a == b or (a is not None and b is not None and abs(a - b) <= SAME * max(abs(a), abs(b)))
