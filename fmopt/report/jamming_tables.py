"""How far the applied wrenches of a plan may turn before friction on the held contacts can balance them, in words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from fmopt.report.moves import characteristic_length, moves
from fmopt.report.naming import direction
from fmopt.report.tables import table
from fmopt.values import Array

Plan = Mapping[str, Any]

_WIDE = math.radians(90.0)  # a range beyond that on both sides is not worth a word


def jamming_table(plan: Plan) -> str:
    """The worst piece of every move, how many may jam, and what the numbers mean; nothing where none is stated."""
    rows, rho = [], characteristic_length(plan)
    for move in moves(plan):
        stated = [(k, piece) for k, piece in enumerate(move.segments, start=1) if _stated(piece)]
        if not stated:
            continue
        k, worst = min(stated, key=lambda item: _room(_stated(item[1])))
        jamming = sum(not _stated(piece)["angle"] > 0.0 for _, piece in stated)
        several = len(stated) > 1
        name = f"{move.number}, piece {k}" if several else str(move.number)
        count = f"{jamming} of {len(stated)} pieces" if jamming and several else "may jam" if jamming else "none"
        rows.append((name, *jamming_cells(worst, rho), count))
    head = ("move", "push", "angle in any direction", "narrow ranges", "may jam")
    words = (
        "<p>Friction on the held contacts, of the stated coefficient, cannot balance the wrench that is applied to the "
        "part: it has to move. The angles say how far that wrench may turn from the bias before it could, with torques "
        "counted by ρ; each is proved by a twist in the plan. Where no angle is given, contact forces exist that leave "
        "the part where it is: it may jam there, and a servo has to push harder than the bias does. Shown is the worst "
        "piece of each move.</p>\n"
    )
    return words + table("Directions in which the applied wrench cannot jam", head, rows) if rows else ""


def jamming_cells(piece: Plan, rho: float) -> tuple[str, str, str]:
    """Of a segment that states it: the push and what it takes, the angle in any direction, and the narrow ranges."""
    free = _stated(piece)
    least = free.get("least_push")
    takes = "no push is shown to be enough" if least is None else f"friction can take {least:.3g} N"
    push = f"{free['push']:.3g} N, {takes}"
    if not free.get("twists"):
        return push, "may wedge", "–"
    if not free["angle"] > 0.0:
        return push, "may jam", "–"
    narrow = [_range_words(piece, plane, rho) for plane in free["planes"] if min(plane["angles"]) < _WIDE]
    return push, f"{math.degrees(free['angle']):.2g}°", "; ".join(narrow) or "none below 90°"


def _range_words(piece: Plan, plane: Plan, rho: float) -> str:
    away, to = (f"{math.degrees(angle):.2g}°" for angle in plane["angles"])
    return f"{away} from, {to} to {_towards(piece['hybrid'], plane['towards'], rho)}"


def _towards(hybrid: Plan, name: str, rho: float) -> str:
    """What a plane is named after, in words."""
    kind, _, number = name.rstrip("]").partition("[")
    if not number:
        return name
    turns: Array = np.array([1.0, 1.0, 1.0, *[rho if kind == "position_axes" else 1.0 / rho] * 3])
    return f"{kind.split('_')[0]} axis {direction(hybrid[kind][int(number)], turns)}"


def _stated(piece: Plan) -> Plan:
    return piece.get("hybrid", {}).get("jam_free") or {}


def _room(free: Plan) -> tuple[float, float]:
    """What orders ranges from the worst: those that may jam by how much push is missing."""
    least = free.get("least_push")
    return float(free["angle"]), float(free["push"]) - (math.inf if least is None else float(least))
