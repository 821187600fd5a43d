"""What the controller is told, as tables: freedoms and forces over time, and the hybrid strategy of every piece."""

from __future__ import annotations

from itertools import groupby

import numpy as np

from fmopt.plan import Plan, Segment
from fmopt.report.moves import moves, turn_of, way_of
from fmopt.report.naming import AXES, combination, direction, quantity, signed
from fmopt.report.tables import table
from fmopt.report.trajectory_view import STOPS
from fmopt.values import Array

_TURNS = 1e-3  # rad/s, a rate worth a word


def force_table(plan: Plan) -> str:
    """S(t) and Fa(t) by interval."""
    rows = []
    for item in plan.position_force or ():
        time = item.interval
        bound = [f"{axis} {STOPS[s]}" for axis, s in zip(AXES, time.s, strict=True) if s]
        either = [AXES[axis] for axis in item.either_sign]
        force = combination(item.fa, "N", "N·m") + (f"; {', '.join(either)} of either sign" if either else "")
        rows.append((f"{time.start:.3g} to {time.end:.3g} s", ", ".join(bound) or "all free", force))
    return table("Freedoms and reaction forces by time", ("time", "S(t)", "Fa(t)"), rows)


def hybrid_table(plan: Plan) -> str:
    """The control strategy of every piece; pieces of a move that share theirs share a row."""
    rows = []
    for move in moves(plan):
        last = move.segments[-1]
        cells = [hybrid_cells(piece, piece is last, plan.rho) for piece in move.segments]
        for alike, run in groupby(enumerate(cells, start=1), key=lambda item: item[1]):
            numbers = [number for number, _ in run]
            several = f", pieces {numbers[0]}–{numbers[-1]}" if len(numbers) > 1 else f", piece {numbers[0]}"
            name = str(move.number) + ("" if len(numbers) == len(cells) else several)
            rows.append((name, *alike))
    head = ("move", "position-controlled", "force-controlled", "velocity", "bias wrench", "end")
    words = (
        "<p>Position axes are twists, force axes wrenches, both in the compliance frame; velocity and wrenches in axes "
        "of B about the moving part's reference point. Turns and torques are counted with ρ. The bias is applied to "
        "the moving part; what ends a move is a reaction on it. Ways in the last column count turns with ρ, too: they "
        "are those of the motion without errors, and beyond what is called a fault something is not as planned.</p>\n"
    )
    return words + _impact_words(plan) + table("Hybrid position/force strategy of every piece", head, rows)


def _impact_words(plan: Plan) -> str:
    """Which moves are slowed so that their contacts are met softly, where the impact is limited."""
    asked = plan.specification
    if asked.impact is None:
        return ""
    force, mass, stiffness = asked.impact
    slow = [
        f"move {move.number} to {1e3 * min(speeds):.3g} mm/s"
        for move in moves(plan)
        if (speeds := [piece.hybrid.speed for piece in move.segments if piece.hybrid.impact is not None])
        and min(speeds) < asked.speed * (1.0 - 1e-9)
    ]
    met = max((met[1] for piece in plan.segments if (met := piece.hybrid.impact) is not None), default=0.0)
    done = f"slowed for that: {', '.join(slow)}" if slow else "no move had to be slowed for that"
    return (
        f"<p>Contacts are to be met with at most {force:.3g} N, by {mass:.3g} kg on {1e-3 * stiffness:.3g} "
        f"N/mm, on top of the push; {done}. With every error they are met with at most {met:.3g} N.</p>\n"
    )


def hybrid_cells(piece: Segment, last: bool, rho: float) -> tuple[str, ...]:
    """The strategy of a piece in words: position axes, force axes, velocity, bias wrench, end.

    Args:
        piece: a segment of a plan.
        last: whether its move ends with it.
        rho: characteristic length, m, with which turns and torques are counted.
    """
    hybrid = piece.hybrid
    twists, wrenches = np.array([1.0, 1.0, 1.0, rho, rho, rho]), np.array([1.0, 1.0, 1.0, 1 / rho, 1 / rho, 1 / rho])
    velocity = direction(hybrid.velocity, twists) + f" at {1e3 * hybrid.speed:.3g} mm/s"
    rate = hybrid.speed * float(np.linalg.norm(hybrid.velocity[3:]))
    velocity += f", turning at {rate:.3g} rad/s" if rate >= _TURNS else ""
    if hybrid.impact is not None:
        velocity += f", a contact met with at most {hybrid.impact[1]:.3g} N"
    return (
        "; ".join(direction(axis, twists) for axis in hybrid.position_axes) or "none",
        "; ".join(direction(axis, wrenches) for axis in hybrid.force_axes) or "none",
        velocity,
        combination(hybrid.bias, "N", "N·m"),
        _end_words(piece, last, twists, wrenches),
    )


def _end_words(piece: Segment, last: bool, twists: Array, wrenches: Array) -> str:
    """When a piece ends without errors, and apart from that beyond what it is a fault."""
    stop = piece.hybrid
    way = quantity(float(np.linalg.norm(np.concatenate([way_of(piece), turn_of(piece)]) * twists)))
    felt = any(stop.wrench)
    if not last:
        return f"goes on after {way}" + ("; a contact felt before ends the move" if felt else "")
    ends = f"ends after {way}"
    if felt:
        reached = f"reaches {signed(stop.threshold, '.3g')} N"
        ends = f"ends when reaction along {direction(stop.wrench, wrenches)} {reached}, nominally after {way}"
    return f"{ends}; a fault beyond {quantity(stop.max_travel)} or {stop.timeout:.3g} s"
