"""Problems, plans and segments as tables of HTML, for notebooks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from fmopt.plan.position_force import AXES
from fmopt.report.control_tables import hybrid_cells, jamming_cells
from fmopt.report.moves import summary_rows
from fmopt.report.moves import verdict as spoken
from fmopt.report.naming import pose_words
from fmopt.report.presses import ENDINGS, HEAD, OUTCOMES, PLACED, ROWS, outcome_rows, placed_rows, press_rows
from fmopt.report.sections import statements as statements_of_plan
from fmopt.report.shell import bullets, facts, table
from fmopt.task.explain import statements

if TYPE_CHECKING:
    from fmopt.notebook.plan import Plan, Segment
    from fmopt.notebook.problem import Problem
    from fmopt.verify import Verdict

# Notebooks centre captions and set cells to the right; what is read as words starts on the left.
_STYLE = (
    "<style>.fmopt-sheet td, .fmopt-sheet th, .fmopt-sheet caption { text-align: left !important; } "
    ".fmopt-sheet td.number, .fmopt-sheet th.number { text-align: right !important; } "
    ".fmopt-sheet caption { font-weight: bold; white-space: nowrap; }</style>"
)


def problem_sheet(problem: Problem) -> str:
    """What a problem asks for, line by line, and its parts."""
    from fmopt.errors import InterferenceError
    from fmopt.notebook.drawing import show

    try:
        rows = statements(problem, problem.measured)
    except InterferenceError as error:
        rows = [("infeasible", str(error))]
    return _sheet(facts(problem.title, rows) + show(problem, "parts")._repr_html_())


def plan_sheet(plan: Plan) -> str:
    """A plan: verdict in words, moves, and the motion in three dimensions."""
    found = spoken(plan.stated)
    text = f"<p><strong>{escape(found.word)}</strong>: {escape(plan.stated.title)}<br>{escape(found.sentence)}</p>"
    if plan.presses is not None:
        text += table("Presses", HEAD, press_rows(plan.presses.attempts[0]))
        for attempt, placed in zip(plan.presses.attempts[:1], plan.stated.description.placed, strict=False):
            text += table(PLACED, ROWS, placed_rows(attempt, placed))
        if plan.evidence is not None:
            text += table(OUTCOMES, ENDINGS, outcome_rows(plan.stated, plan.evidence))
    else:
        head, *rows = summary_rows(plan.stated)
        worst = min(range(len(rows)), key=lambda k: plan.moves[k].margin)
        kinds = "".join("n" if name in ("move", "travel", "turn") or "margin" in name else "." for name in head)
        text += table("Moves", head, rows, kinds, worst)
    return _sheet(text + facts("Beside them", statements_of_plan(plan.stated)) + plan.scene()._repr_html_())


def segment_sheet(segment: Segment) -> str:
    """A segment: where it goes, what it keeps, what it leaves, and how it is controlled."""
    rows = [
        ("from", pose_words(segment.record.start)),
        ("to", pose_words(segment.record.goal)),
        ("keeps", ", ".join(segment.state) or "nothing"),
        ("ends with", ", ".join(segment.goal_state) or "nothing"),
        ("margin", f"{1e6 * segment.margin:.2f} µm, {segment.binds}"),
    ]
    names = ("position axes", "force axes", "velocity", "bias wrench", "end")
    # Progress comes to 1 with the last piece of a move.
    rows += zip(names, hybrid_cells(segment.record, segment.record.progress[1] == 1.0, segment.rho), strict=True)
    if segment.hybrid.jam_free is not None:
        of_jamming = ("push", "cannot jam within", "narrow ranges")
        rows += zip(of_jamming, jamming_cells(segment.hybrid, segment.hybrid.jam_free, segment.rho), strict=True)
    return _sheet(facts(f"segments[{segment.number}], of move {segment.move}", rows))


def pose_sheet(pose: Any) -> str:
    """A pose as a table of its six coordinates."""
    values = [float(value) for value in pose.vector()]
    cells = [f"{1e3 * v:.6g} mm" for v in values[:3]] + [f"{math.degrees(v):.6g}°" for v in values[3:]]
    return _sheet(table("Pose", ("", *AXES), [("", *cells)], ".nnnnnn"))


def freedom_sheet(freedoms: Sequence[Any]) -> str:
    """S(t): a line for each interval, a column for each axis."""
    rows = [(f"{i.start:.4g} to {i.end:.4g} s", *(f"{s:+d}" if abs(s) == 1 else str(s) for s in i.s)) for i in freedoms]
    return _sheet(table("S(t): 0 free, ±1 stopped on one side, 2 on both", ("t", *AXES), rows, ".nnnnnn"))


def verdict_sheet(verdict: Verdict) -> str:
    """The outcome of the independent check, with what stands in its way, as `fmopt verify` prints it."""
    first, *lines = verdict.lines()
    return _sheet(f"<strong>{escape(first)}</strong>{bullets(lines)}")


def _sheet(text: str) -> str:
    return f'<div class="fmopt-sheet">{_STYLE}{text}</div>'


def segment_row(segment: Segment) -> dict[str, Any]:
    """A segment as a row of a table of numbers, by column."""
    ends = {"start": segment.record.start, "goal": segment.record.goal}
    return {
        "segment": segment.number,
        "move": segment.move,
        **{name: " ".join(getattr(segment, name)) for name in ("state", "goal_state", "leaving")},
        **{name: getattr(segment, name) for name in ("margin", "clearance", "binds")},
        **{name: getattr(segment.hybrid, name) for name in ("speed", "push", "threshold", "max_travel", "timeout")},
        **{f"{end}_{name}": x for end, pose in ends.items() for name, x in zip(AXES, pose, strict=True)},
    }
