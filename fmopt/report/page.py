"""The report of a plan: one page of HTML that holds everything, opens offline and prints in black and white."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

from fmopt.plan import Plan
from fmopt.report import control_tables, sections
from fmopt.report.budget_view import budget_table
from fmopt.report.figures import catalogue
from fmopt.report.jamming_tables import jamming_table
from fmopt.report.moves import Verdict, verdict
from fmopt.report.planar_tables import possible_contacts
from fmopt.report.recovery_tables import recovery_chapter
from fmopt.report.scene import resource, scene
from fmopt.report.shell import chaptered, figure, page
from fmopt.report.tolerance_tables import tolerance_chapter


def report_page(plan: Plan, figures: Mapping[str, str]) -> str:
    """The report: verdict first, then the motion, why it holds, what it tolerates, and what was not checked.

    Args:
        plan: the plan.
        figures: its figures as SVG by name, as `fmopt.report.figures.figures` gives them; those left out are not shown.

    Returns:
        A page without any reference to something outside it; everything from the plan is escaped.
    """
    found = verdict(plan)
    shown = _shown(plan, figures)
    title = plan.title or "insertion"
    chapters = [
        ("motion", "The motion", scene(plan) + shown.get("cut", "")),
        ("moves", "The moves", sections.move_table(plan)),
        ("states", "Contact states, and why this sequence", _states(plan, shown)),
        ("margins", "Margins and what binds them", sections.margin_words_of(plan) + shown.get("margin", "")),
        ("budget", "Uncertainty budget", _budget(plan, shown)),
        ("plane", "Possible contacts in the plane", _plane(plan, shown)),
        ("trajectory", "Position and force over time", _nominal(plan, shown)),
        ("hybrid", "Hybrid strategies", control_tables.hybrid_table(plan) + jamming_table(plan)),
        ("tolerance", "Tolerated errors and sensitivities", tolerance_chapter(plan)),
        ("recovery", "When a move fails", recovery_chapter(plan)),
        ("limits", "What was not checked", sections.not_covered(plan)),
        ("asked", "What was asked", sections.asked(plan)),
        ("provenance", "Where this comes from", sections.provenance(plan)),
    ]
    body = chaptered("Insertion plan", title, chapters, f"{_verdict_box(plan, found)}\n")
    return page(f"{title}: {found.word.lower()}", resource("page.css"), body, scripts=True)


def _verdict_box(plan: Plan, found: Verdict) -> str:
    kind = "proved" if found.proved else "unproved"
    limits = ' Under the assumptions listed in <a href="#limits">what was not checked</a>.' if found.proved else ""
    text = f'<div class="verdict {kind}">\n<p class="word">{escape(found.word)}</p>\n'
    text += f"<p>{escape(found.sentence)}{limits}</p>\n"
    text += f"<p>{escape(sections.worst_move(plan))}</p>\n"
    text += f'<p>{escape(sections.asked_words(plan))} More under <a href="#asked">what was asked</a>.</p>\n'
    return text + "</div>"


def _budget(plan: Plan, shown: Mapping[str, str]) -> str:
    """Where the start errors come from, what becomes of them on the way, and what they take of the clearance."""
    sources = budget_table(plan) + shown.get("budget", "")
    return sources + sections.error_table(plan) + shown.get("tube", "") + sections.taken(plan)


def _plane(plan: Plan, shown: Mapping[str, str]) -> str:
    return possible_contacts(plan) + shown.get("sets", "") + shown.get("surfaces", "")


def _states(plan: Plan, shown: Mapping[str, str]) -> str:
    drawings = "".join(shown[name] for name in shown if name == "states" or name.startswith("states-"))
    return sections.why(plan) + drawings + sections.contact_table(plan) + sections.critical_table(plan)


def _nominal(plan: Plan, shown: Mapping[str, str]) -> str:
    return shown.get("diagrams", "") + shown.get("trajectory", "") + control_tables.force_table(plan)


def _shown(plan: Plan, figures: Mapping[str, str]) -> dict[str, str]:
    """The figures as pictures with what they show in words."""
    drawn = {name: drawing for name, drawing in catalogue(plan).items() if name in figures}
    return {name: figure(figures[name], d.alt, d.title, d.size) for name, d in drawn.items()}
