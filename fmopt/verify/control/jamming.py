"""Whether the stated twists prove the stated jam-free range of a segment's applied wrench.

Contact forces inside the friction cones cannot balance a wrench F where a twist v has power on it, v·F > 0, and opens
every held contact more steeply than friction holds it, vₙ > μ |vₜ| at the contact's point: then v·k ≥ 0 for each of
their forces k, and F + Σ k = 0 would leave 0 > 0. Every stated twist must open all the contacts so, by more than
double arithmetic can be off, which also tells that their forces cannot hold each other. What the best of them proves is
derived again from F and the axes, in the metric of ρ: angles are between wrenches (f, τ/ρ).

Whether held contacts stay closed as a move meets its new contacts, under what the plan says they do.

With the wrenches wᵢ of held contacts, the normal forces fᵢ that the bias presses them with, and the wrenches wⱼ of the
new ones for unit forces, the held contacts stay closed where there are gᵢ ≥ 0 and kⱼ ≥ 0 with

    Σ gᵢ wᵢ = Σ fᵢ wᵢ − Π Σ kⱼ wⱼ,    Σ gᵢ ≤ contact force,

Π onto the space that the wᵢ span; under the whole push, "push", its power −Σ kⱼ wⱼ·V = b u·V goes into the new
contacts, and under the reaction that ends the move, "stop", Σ kⱼ is its threshold. Whether there are such forces is
decided by least squares over non-negative numbers, after Lawson and Hanson: their residual is zero, or there are none.
"none" claims nothing.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from fmopt.verify.arithmetic.rational import doubles, sub
from fmopt.verify.findings import RELATIVE, Notes
from fmopt.verify.parts.reach import PosedContact, cross, dot
from fmopt.verify.parts.rows import pose
from fmopt.verify.reading.document import Hybrid, JamFree, StatedSpecification
from fmopt.verify.reading.reader import Numbers

_STRICT = 1e-9  # of unit twists, by which each contact must be opened beyond friction
_ROUNDING = 1e-9  # rad, or relative
_EXACT = 1e-7  # of the contact force, by which forces may fail to balance
_TINY = 1e-12  # of a unit column, below which it depends on others


class Drive(NamedTuple):
    """The twist of a segment and the contacts at its end.

    `twist` is the unit twist V (6,); `along` the scaled unit wrench (6,) along the motion, zero where all of it is
    stopped; `scale` has factors (6,) that make twists comparable.
    """

    held: Sequence[PosedContact]
    made: Sequence[PosedContact]
    twist: Numbers
    along: Numbers
    rows: Sequence[Numbers]
    scale: Numbers

    @property
    def wrench(self) -> Numbers:
        """u, the unit wrench (6,) along the motion."""
        return tuple(x * s for x, s in zip(self.along, self.scale, strict=True))


def check_jam_free(hybrid: Hybrid, drive: Drive, goal: Numbers, asked: StatedSpecification, notes: Notes) -> None:
    """Judges what a strategy says of the directions in which its wrench may turn, at the goal (6,) of its segment."""
    stated, held, along, scale = hybrid.jam_free, drive.held, drive.along, drive.scale
    if stated is None:
        return
    if not held or not any(along):
        notes.add("jam_free", "is stated although nothing is held, or nothing can be pushed")
        return
    push = hybrid.push if drive.made else asked.contact_force
    if not abs(stated.push - push) <= RELATIVE * abs(push):
        notes.add("jam_free.push", f"is stated as {stated.push!r}, but follows as {push!r}")
    for k, twist in enumerate(stated.twists):
        size = math.hypot(*(x * s for x, s in zip(twist, scale, strict=True)))
        if not all(dot(c.wrench, twist) - asked.friction * c.sliding(twist) > _STRICT * size for c in held):
            notes.add("jam_free.twists", f"twist {k} does not open every held contact beyond friction")
            return
    twists = [tuple(x * s for x, s in zip(twist, scale, strict=True)) for twist in stated.twists]
    rest = tuple(x / s - hybrid.push * u for x, s, u in zip(hybrid.bias, scale, along, strict=True))
    _range(stated, twists, rest, along, _directions(hybrid, along, scale, goal), notes)


def _range(
    stated: JamFree, twists: Sequence[Numbers], rest: Numbers, along: Numbers, towards: dict[str, Numbers], notes: Notes
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
        if name not in towards:
            notes.add("jam_free.planes", f"{name!r} is nothing that the wrench could turn to")
            continue
        for angle, proved in zip(angles, _turned(a, towards[name], powers), strict=True):
            if not angle <= proved + _ROUNDING:
                notes.add("jam_free.planes", f"{angle!r} rad to {name} do not follow from the twists")


def _turned(a: Numbers, direction: Numbers, powers: Sequence[tuple[float, Numbers]]) -> tuple[float, float]:
    """How far the unit wrench a turns from and to a direction while one of the twists keeps power on it, rad."""
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


def check_stays(hybrid: Hybrid, drive: Drive, asked: StatedSpecification, notes: Notes) -> None:
    """Judges what a strategy says its held contacts stay closed under."""
    held, made, V, _, rows, scale = drive
    if hybrid.stays == "none" or not held or (not made and hybrid.stays == "push"):
        return
    F, power = asked.contact_force, dot(drive.wrench, V)
    seen = [[dot(row, [x / s for x, s in zip(c.wrench, scale, strict=True)]) for row in rows] for c in (*held, *made)]
    pushed = hybrid.stays == "push"
    columns = [[*column, 0.0, 1.0] for column in seen[: len(held)]]
    for column, contact in zip(seen[len(held) :], made, strict=True):
        columns.append([*column, -dot(contact.wrench, V) if pushed else 1.0, 0.0])
    columns.append([0.0] * len(rows) + [0.0, 1.0])  # what is left of the contact force
    forces = [force for _, force in hybrid.pressed]
    wanted = [sum(f * column[k] for f, column in zip(forces, seen, strict=False)) for k in range(len(rows))]
    wanted += [hybrid.push * power if pushed else asked.termination_force, F * (1.0 + _EXACT)]
    if residual(columns, wanted) > _EXACT * max(F, 1e-9):
        under = "the whole push" if pushed else "the reaction that ends the move"
        notes.add("stays", f"no forces keep the held contacts closed under {under}")


def residual(columns: Sequence[Sequence[float]], wanted: Sequence[float]) -> float:
    """The least |Σ xⱼ cⱼ − d| over x ≥ 0, c the columns, of one size, and d what is wanted.

    Columns enter one by one, the one that the residual asks for most first; one whose share would become negative
    leaves. Each round makes the residual smaller, so that none comes twice.
    """
    chosen: list[int] = []
    x = [0.0] * len(columns)
    left = list(wanted)
    floor = _TINY * max(1.0, math.hypot(*wanted))
    refused: set[int] = set()
    for _ in range(4 * len(columns)):
        asks = {j: dot(column, left) for j, column in enumerate(columns) if j not in chosen and j not in refused}
        best = max(asks, key=asks.__getitem__, default=-1)
        if best < 0 or asks[best] <= floor:
            break
        solved = _solved([columns[j] for j in (*chosen, best)], wanted)
        if solved is None or solved[-1] <= 0.0:
            refused.add(best)
            continue
        chosen.append(best)
        while solved is not None and min(solved) <= 0.0:
            step, first = min((x[j] / max(x[j] - s, _TINY), j) for j, s in zip(chosen, solved, strict=True) if s <= 0.0)
            for j, s in zip(chosen, solved, strict=True):
                x[j] += step * (s - x[j])
            x[first] = 0.0
            chosen.remove(first)
            solved = _solved([columns[j] for j in chosen], wanted)
        for j, s in zip(chosen, solved or (), strict=True):
            x[j] = s
        left = [d - sum(x[j] * columns[j][k] for j in chosen) for k, d in enumerate(wanted)]
        refused.clear()
    return math.hypot(*left)


def _solved(columns: Sequence[Sequence[float]], wanted: Sequence[float]) -> list[float] | None:
    """The least-squares solution of independent columns, by orthogonal ones; None where they depend."""
    rows: list[list[float]] = []  # orthonormal
    upper: list[list[float]] = []
    for column in columns:
        rest, shares = list(column), [0.0] * len(rows)
        for _ in range(2):
            for i, row in enumerate(rows):
                part = dot(row, rest)
                shares[i] += part
                rest = [a - part * b for a, b in zip(rest, row, strict=True)]
        size = math.hypot(*rest)
        if size <= 1e-9 * math.hypot(*column):
            return None
        rows.append([a / size for a in rest])
        upper.append([*shares, size])
    found = [dot(row, wanted) for row in rows]
    for i in reversed(range(len(found))):
        found[i] /= upper[i][i]
        for k in range(i):
            found[k] -= upper[i][k] * found[i]
    return found
