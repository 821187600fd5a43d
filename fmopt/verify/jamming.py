"""Whether the stated twists prove the stated jam-free range of a segment's applied wrench.

Contact forces inside the friction cones cannot balance a wrench F where a twist v has power on it, v·F > 0, and opens
every held contact more steeply than friction holds it, vₙ > μ |vₜ| at the contact's point: then v·k ≥ 0 for each of
their forces k, and F + Σ k = 0 would leave 0 > 0. Every stated twist must open all the contacts so, by more than
double arithmetic can be off, which also tells that their forces cannot hold each other. What the best of them proves is
derived again from F and the axes, in the metric of ρ: angles are between wrenches (f, τ/ρ).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from fmopt.verify.document import Hybrid, JamFree, Numbers, Specification
from fmopt.verify.doubles import cross, dot, doubles
from fmopt.verify.findings import RELATIVE, Notes
from fmopt.verify.rational import sub
from fmopt.verify.reach import Contact
from fmopt.verify.rows import pose

_STRICT = 1e-9  # of unit twists, by which each contact must be opened beyond friction
_ROUNDING = 1e-9  # rad, or relative


def check_jam_free(
    hybrid: Hybrid,
    held: Sequence[Contact],
    along: Numbers,
    scale: Numbers,
    goal: Numbers,
    *,
    made: bool,
    asked: Specification,
    notes: Notes,
) -> None:
    """Judges what a strategy says of the directions in which its wrench may turn.

    Args:
        hybrid: the strategy.
        held: contacts that touch at the goal.
        along: scaled unit wrench (6,) along the motion; zero where all of it is stopped.
        scale: factors (6,) that make twists comparable.
        goal: pose (6,) of the segment's end.
        made: whether a contact ends the move.
        asked: friction, and the push where none does.
        notes: takes what is wrong.
    """
    stated = hybrid.jam_free
    if stated is None:
        return
    if not held or not any(along):
        notes.add("jam_free", "is stated although nothing is held, or nothing can be pushed")
        return
    push = hybrid.push if made else asked.contact_force
    if not abs(stated.push - push) <= RELATIVE * abs(push):
        notes.add("jam_free.push", f"is stated as {stated.push!r}, but follows as {push!r}")
    for k, twist in enumerate(stated.twists):
        if not _opens(twist, held, scale, asked.friction):
            notes.add("jam_free.twists", f"twist {k} does not open every held contact beyond friction")
            return
    twists = [tuple(x * s for x, s in zip(twist, scale, strict=True)) for twist in stated.twists]
    rest = tuple(x / s - hybrid.push * u for x, s, u in zip(hybrid.bias, scale, along, strict=True))
    _range(stated, twists, rest, along, _directions(hybrid, along, scale, goal), notes)


def _opens(twist: Numbers, held: Sequence[Contact], scale: Numbers, friction: float) -> bool:
    size = math.hypot(*(x * s for x, s in zip(twist, scale, strict=True)))
    for contact in held:
        opening = dot(contact.wrench, twist) - friction * contact.sliding(twist)
        if not opening > _STRICT * size:
            return False
    return True


def _range(
    stated: JamFree,
    twists: Sequence[Numbers],
    rest: Numbers,
    along: Numbers,
    directions: dict[str, Numbers],
    notes: Notes,
) -> None:
    """That the least push and the angles follow; `rest` is the scaled bias without its push."""
    freeing = [max(-dot(v, rest) / power, 0.0) for v in twists if (power := dot(v, along)) > 0.0]
    if stated.least_push is not None and not stated.least_push >= min(freeing, default=math.inf) * (1.0 - _ROUNDING):
        notes.add("jam_free.least_push", f"{stated.least_push!r} N do not follow from the twists")
    applied = tuple(x + stated.push * u for x, u in zip(rest, along, strict=True))
    size = math.hypot(*applied)
    a = tuple(x / size for x in applied) if size > 0.0 else applied
    sine = max((dot(v, a) / math.hypot(*v) for v in twists), default=0.0)
    if stated.angle > 0.0 and not stated.angle <= math.asin(min(max(sine, 0.0), 1.0)) + _ROUNDING:
        notes.add("jam_free.angle", f"{stated.angle!r} rad do not follow from the twists")
    powers = [(power, v) for v in twists if (power := dot(v, a)) > 0.0]
    for name, angles in stated.planes:
        if name not in directions:
            notes.add("jam_free.planes", f"{name!r} is nothing that the wrench could turn to")
            continue
        for angle, proved in zip(angles, _turned(a, directions[name], powers), strict=True):
            if not angle <= proved + _ROUNDING:
                notes.add("jam_free.planes", f"{angle!r} rad to {name} do not follow from the twists")


def _turned(a: Numbers, direction: Numbers, powers: Sequence[tuple[float, Numbers]]) -> tuple[float, float]:
    """How far the unit wrench a turns from and to a direction while one of the twists keeps power on it, rad.

    Args:
        a: the wrench.
        direction: the direction.
        powers: twists that have power on the wrench, each after that power.
    """
    part = dot(a, direction)
    d = [x - part * y for x, y in zip(direction, a, strict=True)]
    size = math.hypot(*d)
    if not size > _ROUNDING * math.hypot(*direction):
        return 0.0, 0.0
    across = [(power, dot(v, d) / size) for power, v in powers]
    away, to = ([math.atan2(power, side * x) for power, x in across] for side in (1.0, -1.0))
    return max(away, default=0.0), max(to, default=0.0)


def _directions(hybrid: Hybrid, along: Numbers, scale: Numbers, goal: Numbers) -> dict[str, Numbers]:
    """Scaled wrenches by their names; for a position axis the one that does most power on it."""
    frame, at = pose(hybrid.frame), pose(goal)
    R, arm = frame.in_doubles[1], doubles(sub(frame.p, at.p))
    found = {"push": along}
    for k, axis in enumerate(hybrid.position_axes):
        v, w = (tuple(dot(line, part) for line in R) for part in (axis[:3], axis[3:]))
        moved = tuple(x + y for x, y in zip(v, cross(arm, w), strict=True))
        found[f"position_axes[{k}]"] = tuple(x * s for x, s in zip((*moved, *w), scale, strict=True))
    for k, axis in enumerate(hybrid.force_axes):
        f, t = (tuple(dot(line, part) for line in R) for part in (axis[:3], axis[3:]))
        moved = tuple(x + y for x, y in zip(t, cross(arm, f), strict=True))
        found[f"force_axes[{k}]"] = tuple(x / s for x, s in zip((*f, *moved), scale, strict=True))
    return found
