"""How far the applied wrenches of a plan may turn before friction on the held contacts can balance them, in words."""

from __future__ import annotations

import math
import re
from html import escape

import numpy as np

from fmopt.plan import Hybrid, JamFree, Plan
from fmopt.report.moves import moves
from fmopt.report.naming import direction
from fmopt.report.tables import table
from fmopt.values import Array

_AXIS = re.compile(r"(position|force)_axes\[(\d{1,3})\]", re.ASCII)
_WIDE = math.radians(90.0)  # a range beyond that on both sides is not worth a word


def jamming_table(plan: Plan) -> str:
    """The worst piece of every move, how many may jam, and what the numbers mean; nothing where none is stated."""
    rows = []
    for move in moves(plan):
        stated = [
            (k, piece.hybrid, free)
            for k, piece in enumerate(move.segments, start=1)
            if (free := piece.hybrid.jam_free) is not None
        ]
        if not stated:
            continue
        k, worst, free = min(stated, key=lambda item: _room(item[2]))
        jamming = sum(not free.angle > 0.0 for _, _, free in stated)
        several = len(stated) > 1
        name = f"{move.number}, piece {k}" if several else str(move.number)
        count = f"{jamming} of {len(stated)} pieces" if jamming and several else "may jam" if jamming else "none"
        rows.append((name, *jamming_cells(worst, free, plan.rho), count))
    head = ("move", "push", "angle in any direction", "narrow ranges", "may jam")
    words = (
        "<p>Friction on the held contacts, of the stated coefficient, cannot balance the wrench that is applied to the "
        "part: it has to move. The angles say how far that wrench may turn from the bias before it could, with torques "
        "counted by ρ; each is proved by a twist in the plan. Where no angle is given, contact forces exist that leave "
        "the part where it is: it may jam there, and a servo has to push harder than the bias does. Shown is the worst "
        "piece of each move.</p>\n"
    )
    said = f"<p>Of this plan, {escape(jamming_words(plan))}.</p>\n"
    return words + said + table("Directions in which the applied wrench cannot jam", head, rows) if rows else ""


def jamming_words(plan: Plan) -> str:
    """Which pieces may jam and what push that takes, and how far the wrenches of the others turn; "" if unstated."""
    stated = [
        (move.number, free)
        for move in moves(plan)
        for piece in move.segments
        if (free := piece.hybrid.jam_free) is not None
    ]
    if not stated:
        return ""
    angles = [item.angle for _, item in stated if item.angle > 0.0]
    words = f"friction cannot balance the bias of {len(angles)} of {len(stated)} pieces that hold contacts"
    words += f", turned by up to {_degrees(min(angles))}" if angles else ""
    jamming = [(number, item) for number, item in stated if not item.angle > 0.0]
    if not jamming:
        return words
    names = [str(number) for number in dict.fromkeys(number for number, _ in jamming)]
    words += f"; the others, of move{'s' if len(names) > 1 else ''} {', '.join(names)}, may jam"
    pairs = [(item.push, item.least_push) for _, item in jamming if item.least_push is not None]
    if pairs:
        push, least = max(pairs, key=lambda pair: pair[1] - pair[0])
        words += f": where most is missing, the push is {_newtons(push)} and friction can take {_newtons(least)}"
    return words


def jamming_cells(hybrid: Hybrid, free: JamFree, rho: float) -> tuple[str, str, str]:
    """Of a strategy: the push and what it takes, the angle in any direction, and the narrow ranges."""
    least = free.least_push
    takes = "no push is shown to be enough" if least is None else f"friction can take {_newtons(least)}"
    push = f"{_newtons(free.push)}, {takes}"
    if not free.twists:
        return push, "may wedge", "–"
    if not free.angle > 0.0:
        return push, "may jam", "–"
    narrow = [
        f"{_degrees(away)} from, {_degrees(to)} to {_towards(hybrid, name, rho)}"
        for name, (away, to) in free.planes
        if min(away, to) < _WIDE
    ]
    return push, _degrees(free.angle), "; ".join(narrow) or "none below 90°"


def _towards(hybrid: Hybrid, name: str, rho: float) -> str:
    """What a plane is named after, in words."""
    named = _AXIS.fullmatch(name)
    positions = named is not None and named[1] == "position"
    axes = hybrid.position_axes if positions else hybrid.force_axes
    if named is None or int(named[2]) >= len(axes):
        return name
    turns: Array = np.array([1.0, 1.0, 1.0, *[rho if positions else 1.0 / rho] * 3])
    return f"{named[1]} axis {direction(axes[int(named[2])], turns)}"


def _degrees(angle: float) -> str:
    """An angle (rad) in degrees, two digits of it below 10°."""
    degrees = math.degrees(angle)
    return f"{degrees:.2g}°" if degrees < 10.0 else f"{degrees:.0f}°"


def _newtons(force: float) -> str:
    """A force to hundredths of a newton."""
    return f"{force:.2f} N"


def _room(free: JamFree) -> tuple[float, float]:
    """What orders ranges from the worst: those that may jam by how much push is missing."""
    return free.angle, free.push - (math.inf if free.least_push is None else free.least_push)
