"""What a plan says of failing: which contact an error would make first and what to do then, in words and tables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

from fmopt.plan import MoveRecovery, Plan, Recovery
from fmopt.report.naming import AXES, meeting_words, millimetres
from fmopt.report.tables import table


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
    if others:
        words += (
            f", in {_listed('move', others)} only while the part's lowest point lies above "
            f"z = {millimetres(found.lift.above)} mm"
        )
    said = [f"{words}."]
    if not found.retries:
        return [*said, f"It is not to be tried again: {found.why}."]
    box, covers = plan.start_box, found.covers
    wider = [f"{axis} ±{millimetres(covers[k])} mm" for k, axis in enumerate(AXES[:2]) if covers[k] > box[k]]
    count = sum(any(shift) for shift in found.retries)
    if not count:
        return [*said, "It may be tried again from the same start."]
    return [*said, f"Tried again from {count} starts aside, the plan holds for start errors of {', '.join(wider)}."]


def _listed(noun: str, numbers: Sequence[int]) -> str:
    """Numbers as people list them: "moves 1 to 3 and 5"."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    words = [word for run in runs for word in ([f"{run[0]} to {run[-1]}"] if len(run) > 2 else map(str, run))]
    text = " and ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else "".join(words)
    return f"{noun}{'s' if len(numbers) > 1 else ''} {text}"


def recovery_chapter(plan: Plan) -> str:
    """What errors do first and what then, as HTML; nothing where the plan does not say."""
    found = plan.recovery
    if found is None:
        return ""
    text = "".join(f"<p>{escape(words)}</p>\n" for words in recovery_words(plan))
    rows = [row for move in found.moves for row in _rows(plan, move)]
    note = (
        "Figures of the planner, of first order: by which factor all start errors have to grow, or one alone, for a "
        "contact that is not planned to become possible. The angle is between its friction cone and that of the "
        "contact that is wanted, apart from the contacts that are held."
    )
    head = ("move", "contact", "all errors", "one alone", "angle", "felt apart")
    text += f"<p>{note}</p>\n" + table("Contacts that errors would make first", head, rows, "n.nnn.")
    if found.retries:
        text += table("Shifts of the start, in mm", ("number", "x", "y"), _shifts(found), "nnn")
        text += table("In which order they are tried", ("move", "felt too early", "not felt"), _orders(found), "n..")
    items = "\n".join(f"<li>{escape(words)}</li>" for words in found.not_covered)
    return f"{text}<p>Not covered:</p>\n<ul>\n{items}\n</ul>\n"


def _rows(plan: Plan, move: MoveRecovery) -> list[tuple[str, ...]]:
    number = str(move.move + 1)
    if not move.first:
        return [(number, "none found", "–", "–", "–", "–")]
    return [
        (
            number,
            meeting_words(plan, first),
            f"{first.factor:.3g}",
            "–" if first.axis_factor is None else f"{first.axis}: {first.axis_factor:.3g}",
            "–" if first.angle is None else f"{math.degrees(first.angle):.1f}°",
            "yes" if first.told else "no",
        )
        for first in move.first
    ]


def _shifts(found: Recovery) -> list[tuple[str, ...]]:
    return [(str(k + 1), *(millimetres(v) for v in shift[:2])) for k, shift in enumerate(found.retries)]


def _orders(found: Recovery) -> list[tuple[str, ...]]:
    return [
        (str(move.move + 1), *(", ".join(str(k + 1) for k in order) for order in (move.early, move.late)))
        for move in found.moves
    ]
