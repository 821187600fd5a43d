"""How much error a plan tolerates, and what each tolerance costs its margin, in words and as a table."""

from __future__ import annotations

import math
from html import escape

from fmopt.plan import Plan, Tolerated, ToleratedEnd
from fmopt.report.moves import verdict
from fmopt.report.naming import AXES, binding_words, degrees, millimetres, signed
from fmopt.report.tables import table

_ONE = {"start": (1e-4, math.radians(0.1)), "velocity": (0.01, 0.01), "clearance": (1e-5, 1e-5)}
_WORDS = {"clearance": "clearance on each side"}
_LARGE = 9.95e-5  # m: from here on whole micrometres are said
_LEAST = 5e-9  # m: smaller changes of the margin are called none


def tolerated_words(plan: Plan) -> str:
    """How far all start errors may grow together, in a sentence; nothing where the plan does not say."""
    found = _tolerated(plan)
    if found is None:
        return ""
    box = [(name, value) for name, value in zip(AXES, found.start_box, strict=True) if value > 0.0]
    if found.factor <= 0.0:
        words = "This motion has no positive margin, however small the start errors."
    elif not box:
        return "The problem states no start error."
    else:
        sizes = ", ".join(f"{name} ±{_size(name, value)}" for name, value in box)
        words = f"This motion keeps a positive margin up to {found.factor:.3g} times the start errors: {sizes}."
    words += _end_words(plan, found.end)
    if verdict(plan).proved:
        return words + " Only the stated errors are certified; the larger ones are the planner's own figure."
    return words + " That is the planner's own figure, and not proved."


def _tolerated(plan: Plan) -> Tolerated | None:
    return None if plan.diagnostics is None else plan.diagnostics.tolerated


def _end_words(plan: Plan, end: ToleratedEnd | None) -> str:
    """What fails first beyond that, as a sentence."""
    if end is None:
        return ""
    return f" What ends it is move {end.move + 1}: {end.reason or binding_words(plan, end.binding)}."


def rates(plan: Plan) -> list[tuple[str, str, str]]:
    """For each tolerance its name, its value and what one more step of it does to the margin, the costliest first."""
    found = _tolerated(plan)
    rows = []
    for entry in () if found is None else found.sensitivities:
        kind, _, axis = entry.name.partition(".")
        turns = axis.startswith("r") and kind == "start"
        one = _ONE[kind][turns]
        if entry.change is None:
            gain, words = -math.inf, "the motion fails"
        else:
            gain = entry.change / entry.step * one
            words = (
                "no change"
                if abs(gain) < _LEAST
                else f"{signed(1e6 * gain, '+.2g' if abs(gain) < _LARGE else '+.0f')} µm"
            )
        step = {"start": "0.1°" if turns else "0.1 mm", "velocity": "1 %", "clearance": "0.01 mm"}[kind]
        name = _WORDS.get(kind, f"{'error' if kind == 'start' else 'velocity error,'} {axis}")
        rows.append((-abs(gain), (name, _value(kind, axis, entry.value), f"{step} more: {words}")))
    return [row for _, row in sorted(rows, key=lambda pair: pair[0])]


def tolerance_chapter(plan: Plan) -> str:
    """Tolerated errors and sensitivities as HTML; nothing where the plan does not have them."""
    words = tolerated_words(plan)
    if not words:
        return ""
    note = "Each is the same motion certified anew with that tolerance a fiftieth larger, the change scaled."
    head = ("tolerance", "as stated", "what more of it does to the margin")
    return f"<p>{escape(words)}</p>\n<p>{note}</p>\n" + table("What each tolerance costs", head, rates(plan), ".n.")


def _size(name: str, value: float) -> str:
    return f"{degrees(value)}°" if name.startswith("r") else f"{millimetres(value)} mm"


def _value(kind: str, axis: str, value: float) -> str:
    if kind == "velocity":
        return f"{100 * value:.3g} %"
    return f"{'' if kind == 'clearance' else '±'}{_size(axis, value)}"
