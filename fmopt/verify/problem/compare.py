"""Whether a plan is of a problem as its files stand now: everything that its claims rest on, held against them.

The characteristic length of a mating: half the diagonal of the peg's section where it passes the hole closest.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

from fmopt.verify.arithmetic.rational import number, vector
from fmopt.verify.parts.rows import pose
from fmopt.verify.problem.parts import Chord, Reader, part_beside_its_model
from fmopt.verify.problem.problem import Problem, load_problem
from fmopt.verify.problem.sources import WORLD, by_frame, total
from fmopt.verify.reading.document import Body, Plan

SAME = 1e-12  # m, rad: between numbers that went the same way
SEATED = 1e-6  # m, rad: walls of rounded numbers seat a part a little off the pose of its goal
LEAST_LEVER = 2.0**-10  # m: what ρ is at least, where the problem does not state it
STARTED = 1e-9  # m: between the lowest point at the start and the height that it has by the problem
SIDES = ("moving", "fixed")

_SIDES = 128  # of the polygon in a ball's section
_ON, _APART, _TIE = 1e-12, 1e-9, 1e-11  # m: on a plane; two heights; two gaps that are the same

Flat = tuple[float, float]
Outline = tuple[Flat, ...]


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
        reader: the planner's reading of the parts, for files that the check cannot read; None to leave those out.

    Raises:
        ProblemError: the problem or one of its files cannot be read.
    """
    chosen = {side: mated for side in SIDES if (mated := plan.parts[side].found) is not None}
    problem = load_problem(path, data, chosen)
    # The digest is told first, and taken last, as others say better which key of a file is wrong.
    parts = {side: part_beside_its_model(plan.parts[side], problem, side, reader) for side in SIDES}
    found = [*_task(plan, problem), *_errors(plan, problem, {side: part.chord for side, part in parts.items()})]
    found += [line for side in SIDES for line in (*_declared(plan, problem, side), *parts[side].differences)]
    remarks = [line for side in SIDES for line in parts[side].remarks]
    if problem.depth is None:
        remarks.append(f"the goal is {-plan.goal[2]!r} m deep by the plan, as deep as the features that it found allow")
    if problem.approach is None:
        remarks.append("the height of the start is the planner's choice, as the problem states none")
    return Held((*_digest(plan, problem), *found), tuple(remarks))


def _digest(plan: Plan, problem: Problem) -> Iterator[str]:
    if plan.problem != problem.sha256:
        yield (
            "problem.sha256: the plan belongs to another problem, or the problem's files have changed since: "
            f"{plan.problem[:12]}… stands where the files give {problem.sha256[:12]}…"
        )


def _declared(plan: Plan, problem: Problem, side: str) -> Iterator[str]:
    own = plan.parts[side].declared_clearance
    wanted = problem.declared_clearance
    if (own is None) != (wanted is None) or not _same(own or (), wanted or ()):
        stated, given = (None if pair is None else list(pair) for pair in (own, wanted))
        yield (
            f"parts.{side}.declared_clearance: the plan states another declared clearance: {stated} stands where "
            f"the problem gives {given}"
        )


def _task(plan: Plan, problem: Problem) -> Iterator[str]:
    """Goal, start and specification."""
    # Not x and y, which are where walls seat the part.
    stated, wanted = plan.goal[2], plan.goal[2] if problem.depth is None else -problem.depth
    if abs(stated - wanted) > SEATED:
        yield f"goal: the plan ends at another depth: z is {stated!r} m, by the problem {wanted!r} m"
    if max(map(abs, plan.goal[3:])) > SEATED:
        yield f"goal: the plan ends in another orientation: {list(plan.goal[3:])} rad, by the problem 0"
    if plan.segments:  # presses begin where the planner chose: nothing of them is proved
        yield from _begin(plan, problem)
    own, given = _specification(plan), problem.specification
    for name in dict.fromkeys((*given, *own)):
        if not _equal(own.get(name), given.get(name)):
            yield (
                f"specification.{name}: the plan is for another specification: {own.get(name)!r} stands where the "
                f"problem gives {given.get(name)!r}"
            )


def _begin(plan: Plan, problem: Problem) -> Iterator[str]:
    """The height at which the motion starts."""
    begin = pose(plan.segments[0].start)
    radii = dict(plan.moving.body.balls)
    corners = enumerate(plan.moving.body.vertices)
    lowest = min(number(begin.apply(vector(corner))[2]) - radii.get(n, 0.0) for n, corner in corners)
    if problem.approach is not None and abs(lowest - problem.approach) > STARTED:
        yield (
            f"segments[0].start: the part's lowest point starts {lowest!r} m above the mouth, by the problem "
            f"{problem.approach!r} m"
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
    pieces = [(*plan.parts[side].pieces, *plan.parts[side].balls) for side in SIDES]
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


@dataclass(frozen=True)
class _Slice:
    height: float
    side: int
    outlines: tuple[Outline, ...]


def half_diagonals(moving: Sequence[Body], fixed: Sequence[Body], depth: float) -> tuple[float, ...]:
    """Half the diagonals of the peg's sections that pass a section of the hole closest, m; most often all the same.

    Sections are taken at both ends and the middle of each stretch between levels of vertices.

    Args:
        depth: of the insertion, m.
    """
    # Heights in each part's own frame: z is 0 at the peg's leading face and at the hole's mouth.
    pegs, holes = _slices(moving, 0.0, depth), _slices(fixed, -depth, 0.0)
    gaps: dict[tuple[tuple[Outline, ...], tuple[Outline, ...]], float] = {}
    found: list[tuple[float, float]] = []
    for peg in pegs:
        half = 0.5 * max((math.dist(p, q) for p, q in combinations(_hull_points(peg.outlines), 2)), default=0.0)
        for hole in holes:
            # This section ends at peg.height − depth: on its way it passes what of the hole is above that.
            ahead = hole.height - (peg.height - depth)
            if ahead > _APART or (abs(ahead) <= _APART and not peg.side > hole.side):
                key = peg.outlines, hole.outlines
                if key not in gaps:
                    gaps[key] = _least_gap(*key)
                found.append((gaps[key], half))
    least = min((gap for gap, _ in found), default=0.0)
    return tuple(half for gap, half in found if gap <= least + _TIE)


def _slices(pieces: Sequence[Body], low: float, high: float) -> list[_Slice]:
    levels = sorted({min(max(p[2], low), high) for piece in pieces for p in piece.vertices} | {low, high})
    heights = levels[:1] + [b for a, b in pairwise(levels) if b - a > _APART]
    found = []
    for bottom, top in pairwise(heights):
        for z, side in ((bottom, 1), (0.5 * (bottom + top), 1), (top, -1)):
            outlines = tuple(outline for piece in pieces if len(outline := _outline(piece, z, side)) >= 3)
            if outlines:
                found.append(_Slice(z, side, outlines))
    return found


def _outline(piece: Body, z: float, side: int) -> Outline:
    """The section of a convex piece at a height, as its limit from above (1) or below (−1): corners in order.

    Of a ball's section, a polygon in it that has its diameter.
    """
    for n, radius in piece.balls:
        x, y, height = piece.vertices[n]
        if abs(height - z) >= radius:
            return ()
        wide = math.sqrt(radius**2 - (height - z) ** 2)
        turns = [2.0 * math.pi * k / _SIDES for k in range(_SIDES)]
        return tuple((x + wide * math.cos(turn), y + wide * math.sin(turn)) for turn in turns)
    heights = [0.0 if abs(p[2] - z) <= _ON else p[2] - z for p in piece.vertices]
    if not any(side * h > 0.0 for h in heights):
        return ()
    points = {(p[0], p[1]) for p, h in zip(piece.vertices, heights, strict=True) if h == 0.0}
    for (loop,) in piece.faces:
        for a, b in zip(loop, loop[1:] + loop[:1], strict=True):
            if a < b and heights[a] * heights[b] < 0.0:
                s = heights[a] / (heights[a] - heights[b])
                p, q = piece.vertices[a], piece.vertices[b]
                points.add((round(p[0] + s * (q[0] - p[0]), 16), round(p[1] + s * (q[1] - p[1]), 16)))
    return _hull(points)


def _hull(points: set[Flat]) -> Outline:
    """The corners of the convex hull, counter-clockwise."""
    ordered = sorted(points)
    halves = []
    for run in (ordered, ordered[::-1]):
        chain: list[Flat] = []
        for p in run:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], p) <= 0.0:
                chain.pop()
            chain.append(p)
        halves.append(chain[:-1])
    return tuple(halves[0] + halves[1])


def _hull_points(outlines: Sequence[Outline]) -> Outline:
    return _hull({p for outline in outlines for p in outline})


def _turn(a: Flat, b: Flat, c: Flat) -> float:
    return (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])


def _least_gap(peg: Sequence[Outline], hole: Sequence[Outline]) -> float:
    """The distance of two sections; pairs of outlines whose boxes are farther apart than that are passed over."""
    least = math.inf
    pairs = sorted(((_box_gap(one, two), one, two) for one in peg for two in hole), key=lambda pair: pair[0])
    for apart, one, two in pairs:
        if apart >= least:
            break
        least = min(least, _gap(one, two))
    return least


def _box_gap(one: Outline, two: Outline) -> float:
    (a, b), (c, d), (e, f), (g, h) = (
        (pick(p[0] for p in outline), pick(p[1] for p in outline)) for outline in (one, two) for pick in (min, max)
    )
    return math.hypot(max(e - c, a - g, 0.0), max(f - d, b - h, 0.0))


def _gap(one: Outline, two: Outline) -> float:
    """The distance of two convex polygons; 0 where they overlap."""
    if _overlap(one, two):
        return 0.0
    return min(_nearest(one, two), _nearest(two, one))


def _nearest(points: Outline, sides: Outline) -> float:
    return min(_distance(p, a, b) for a, b in zip(sides, sides[1:] + sides[:1], strict=True) for p in points)


def _distance(p: Flat, a: Flat, b: Flat) -> float:
    ux, uy, wx, wy = b[0] - a[0], b[1] - a[1], p[0] - a[0], p[1] - a[1]
    size = ux * ux + uy * uy
    s = min(max((wx * ux + wy * uy) / size, 0.0), 1.0) if size else 0.0
    return math.hypot(wx - s * ux, wy - s * uy)


def _overlap(one: Outline, two: Outline) -> bool:
    """Whether no side of either polygon has all of the other one beyond it."""
    for outline, other in ((one, two), (two, one)):
        for a, b in zip(outline, outline[1:] + outline[:1], strict=True):
            if all(_turn(a, b, p) <= 0.0 for p in other):
                return False
    return True
