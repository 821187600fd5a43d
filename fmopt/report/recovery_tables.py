"""What a plan says of failing and of larger errors: contacts made first, ways back, tolerated errors and their cost."""

import math
from collections.abc import Sequence
from itertools import groupby

from fmopt.plan import MoveRecovery, Plan
from fmopt.plan.position_force import AXES
from fmopt.report.moves import verdict
from fmopt.report.naming import binding_words, box_words, degrees, meeting_words, millimetres, signed
from fmopt.report.shell import bullets, paragraph, table

# One step more of each tolerance: of a length (m) or a share, and of an angle (rad).
_ONE = {"start": (1e-4, math.radians(0.1)), "velocity": (0.01, 0.01), "clearance": (1e-5, 1e-5)}
_WORDS = {"clearance": "clearance on each side"}
_LARGE = 9.95e-5  # m: from here on whole micrometres are said
_LEAST = 5e-9  # m: smaller changes of the margin are called none


def recovery_words(plan: Plan) -> list[str]:
    """What to do when a move fails, in a sentence or two; nothing where the plan does not say."""
    found = plan.recovery
    if found is None:
        return []
    if found.lift is None:
        return [f"When a move fails there is no way back that is known to be free: {found.why}."]
    lifted = [move.move + 1 for move in found.moves if move.back_off]
    others = [move.move + 1 for move in found.moves if not move.back_off]
    words = f"When a move fails the part can be lifted straight out of the hole in {_listed('move', lifted)}"
    above = f"only while the part's lowest point lies above z = {millimetres(found.lift.above)} mm"
    words += f", in {_listed('move', others)} {above}" if others else ""
    said = [f"{words}."]
    if not found.retries:
        return [*said, f"It is not to be tried again: {found.why}."]
    box, covers = plan.start_box, found.covers
    # Starts are shifted along x and y alone.
    wider = [f"{axis} ±{millimetres(covers[k])} mm" for k, axis in enumerate(AXES[:2]) if covers[k] > box[k]]
    count = sum(any(shift) for shift in found.retries)  # a shift of nothing is the same start once more
    if not count:
        return [*said, "It may be tried again from the same start."]
    return [*said, f"Tried again from {count} starts aside, the plan holds for start errors of {', '.join(wider)}."]


def _listed(noun: str, numbers: Sequence[int]) -> str:
    """Numbers as people list them: "moves 1 to 3 and 5"."""
    # Consecutive numbers are all ahead of their places by the same.
    runs = [[number for _, number in run] for _, run in groupby(enumerate(numbers), lambda one: one[1] - one[0])]
    words = [word for run in runs for word in ([f"{run[0]} to {run[-1]}"] if len(run) > 2 else map(str, run))]
    text = " and ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else "".join(words)
    return f"{noun}{'s' if len(numbers) > 1 else ''} {text}"


def recovery_chapter(plan: Plan) -> str:
    """What errors do first and what then, as HTML; nothing where the plan does not say."""
    found = plan.recovery
    if found is None:
        return ""
    rows = [row for move in found.moves for row in _rows(plan, move)]
    note = (
        "Figures of the planner, of first order: by which factor all start errors have to grow, or one alone, for a "
        "contact that is not planned to become possible. The angle is between its friction cone and that of the "
        "contact that is wanted, apart from the contacts that are held."
    )
    head = ("move", "contact", "all errors", "one alone", "angle", "felt apart")
    text = paragraph(*recovery_words(plan), note) + table("Contacts that errors would make first", head, rows, "n.nnn.")
    if found.retries:
        shifts = [(str(k), *map(millimetres, shift[:2])) for k, shift in enumerate(found.retries, start=1)]
        text += table("Shifts of the start, in mm", ("number", "x", "y"), shifts, "nnn")
        orders = [
            (str(move.move + 1), *(", ".join(str(k + 1) for k in order) for order in (move.early, move.late)))
            for move in found.moves
        ]
        text += table("In which order they are tried", ("move", "felt too early", "not felt"), orders, "n..")
    return text + bullets(found.not_covered, "Not covered:")


def _rows(plan: Plan, move: MoveRecovery) -> list[tuple[str, ...]]:
    rows = []
    for one in plan.diagnostics.unplanned:
        if one.move == move.move:
            alone = "–" if one.axis_factor is None else f"{one.axis}: {one.axis_factor:.3g}"
            angle = "–" if one.angle is None else f"{math.degrees(one.angle):.1f}°"
            rows.append((meeting_words(plan, one), f"{one.factor:.3g}", alone, angle, "yes" if one.told else "no"))
    return [(str(move.move + 1), *row) for row in rows or [("none found", "–", "–", "–", "–")]]


def tolerated_words(plan: Plan) -> str:
    """How far all start errors may grow together, in a sentence; nothing where the plan does not say."""
    if (found := plan.diagnostics.tolerated) is None:
        return ""
    if found.factor <= 0.0:
        words = "This motion has no positive margin, however small the start errors."
    elif not any(found.start_box):
        return "The problem states no start error."
    else:
        sizes = box_words(found.start_box)
        words = f"This motion keeps a positive margin up to {found.factor:.3g} times the start errors: {sizes}."
    if (end := found.end) is not None:
        words += f" What ends it is move {end.move + 1}: {end.reason or binding_words(plan, end.binding)}."
    if verdict(plan).proved:
        return words + " Only the stated errors are certified; the larger ones are the planner's own figure."
    return words + " That is the planner's own figure, and not proved."


def rates(plan: Plan) -> list[tuple[str, str, str]]:
    """For each tolerance its name, its value and what one more step of it does to the margin, the costliest first."""
    found = plan.diagnostics.tolerated
    rows = []
    for entry in found.sensitivities if found else ():
        kind, _, axis = entry.name.partition(".")
        turns = axis.startswith("r") and kind == "start"  # "rotation" of velocity begins with r, too
        one = _ONE[kind][turns]
        if entry.change is None:
            gain, words = -math.inf, "the motion fails"  # the costliest of all, listed first
        else:
            gain = entry.change / entry.step * one
            form = "+.2g" if abs(gain) < _LARGE else "+.0f"
            words = "no change" if abs(gain) < _LEAST else f"{signed(1e6 * gain, form)} µm"
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
    return paragraph(words, note) + table("What each tolerance costs", head, rates(plan), ".n.")


def _value(kind: str, axis: str, value: float) -> str:
    if kind == "velocity":
        return f"{100 * value:.3g} %"
    size = f"{degrees(value)}°" if axis.startswith("r") else f"{millimetres(value)} mm"
    return size if kind == "clearance" else f"±{size}"
