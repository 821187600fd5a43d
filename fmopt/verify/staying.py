"""Whether held contacts stay closed as a move meets its new contacts, under what the plan says they do.

With the wrenches wᵢ of held contacts, the normal forces fᵢ that the bias presses them with, and the wrenches wⱼ of the
new ones for unit forces, the held contacts stay closed where there are gᵢ ≥ 0 and kⱼ ≥ 0 with

    Σ gᵢ wᵢ = Σ fᵢ wᵢ − Π Σ kⱼ wⱼ,    Σ gᵢ ≤ contact force,

Π onto the space that the wᵢ span; under the whole push, "push", its power −Σ kⱼ wⱼ·V = b u·V goes into the new
contacts, and under the reaction that ends the move, "stop", Σ kⱼ is its threshold. Whether there are such forces is
decided by least squares over non-negative numbers, after Lawson and Hanson: their residual is zero, or there are none.
"none" claims nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from fmopt.verify.document import Hybrid, Specification
from fmopt.verify.doubles import dot
from fmopt.verify.findings import Notes
from fmopt.verify.form import Numbers
from fmopt.verify.reach import Contact

_EXACT = 1e-7  # of the contact force, by which forces may fail to balance
_TINY = 1e-12  # of a unit column, below which it depends on others


def check_stays(
    hybrid: Hybrid,
    contacts: tuple[Sequence[Contact], Sequence[Contact]],
    V: Numbers,
    power: float,
    basis: tuple[Sequence[Numbers], Numbers],
    asked: Specification,
    notes: Notes,
) -> None:
    """Judges what a strategy says its held contacts stay closed under.

    Args:
        hybrid: the strategy.
        contacts: those held that touch at the goal, and those that end the move.
        V: unit twist (6,) of the motion.
        power: of the unit wrench along the motion, u·V.
        basis: orthonormal rows that span the scaled wrenches of the held contacts, and the scale (6,).
        asked: contact force and threshold.
        notes: takes what is wrong.
    """
    held, made = contacts
    if hybrid.stays == "none" or not held or (not made and hybrid.stays == "push"):
        return
    F, (rows, scale) = asked.contact_force, basis
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
    """The least |Σ xⱼ cⱼ − d| over x ≥ 0, c the columns and d what is wanted.

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
            step, leaving = min(
                (x[j] / max(x[j] - s, _TINY), j) for j, s in zip(chosen, solved, strict=True) if s <= 0.0
            )
            for j, s in zip(chosen, solved, strict=True):
                x[j] += step * (s - x[j])
            x[leaving] = 0.0
            chosen.remove(leaving)
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
