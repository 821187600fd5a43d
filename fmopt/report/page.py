"""The report of a plan: one page of HTML that holds everything, opens offline and prints in black and white."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping
from html import escape
from typing import Any

from fmopt.report import control_tables, sections
from fmopt.report.budget_view import budget_table
from fmopt.report.figures import catalogue
from fmopt.report.moves import Verdict, smallest_margin, verdict
from fmopt.report.planar_tables import possible_contacts
from fmopt.report.scene import resource, scene
from fmopt.report.tolerance_tables import tolerance_chapter

_POLICY = (
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'; "
    "base-uri 'none'; form-action 'none'"
)


def report_page(plan: Mapping[str, Any], figures: Mapping[str, str]) -> str:
    """The report: verdict first, then what was asked, the motion, why it holds, and what was not checked.

    Args:
        plan: a plan document.
        figures: its figures as SVG by name, as `fmopt.report.figures.figures` gives them; those left out are not shown.

    Returns:
        A page without any reference to something outside it; everything from the plan is escaped.
    """
    found = verdict(plan)
    shown = _shown(plan, figures)
    title = str(plan.get("problem", {}).get("title") or "insertion")
    chapters = [
        ("asked", "What was asked", sections.asked(plan)),
        ("motion", "The motion", scene(plan) + shown.get("cut", "")),
        ("moves", "The moves", sections.move_table(plan)),
        ("states", "Contact states, and why this sequence", _states(plan, shown)),
        ("margins", "Margins and what binds them", sections.margin_words_of(plan) + shown.get("margin", "")),
        ("errors", "The errors on the way", sections.error_table(plan) + shown.get("tube", "")),
        ("budget", "Uncertainty budget", budget_table(plan) + shown.get("budget", "") + sections.taken(plan)),
        ("tolerance", "Tolerated errors and sensitivities", tolerance_chapter(plan)),
        ("plane", "Possible contacts in the plane", _plane(plan, shown)),
        ("trajectory", "Position and force over time", _nominal(plan, shown)),
        ("hybrid", "Hybrid strategies", control_tables.hybrid_table(plan)),
        ("limits", "What was not checked", sections.not_covered(plan)),
        ("provenance", "Where this comes from", sections.provenance(plan)),
    ]
    chapters = [(name, heading, body) for name, heading, body in chapters if body]
    links = "\n".join(f'<li><a href="#{name}">{escape(heading)}</a></li>' for name, heading, _ in chapters)
    body = "\n".join(_chapter(*chapter) for chapter in chapters)
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{_POLICY}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="icon" href="data:,">
<title>{escape(title)}: {escape(found.word.lower())}</title>
<style>
{resource("page.css")}</style>
</head>
<body>
<header>
<p class="kind">Insertion plan</p>
<h1>{escape(title)}</h1>
{_verdict_box(plan, found)}
</header>
<nav aria-label="chapters">
<ol>
{links}
</ol>
</nav>
<main>
{body}
</main>
</body>
</html>
"""


def _chapter(name: str, heading: str, text: str) -> str:
    head = f'<h2 id="{name}-head">{escape(heading)}</h2>'
    return f'<section id="{name}" aria-labelledby="{name}-head">\n{head}\n{text}\n</section>'


def _verdict_box(plan: Mapping[str, Any], found: Verdict) -> str:
    kind = "proved" if found.proved else "unproved"
    limits = ' Under the assumptions listed in <a href="#limits">what was not checked</a>.' if found.proved else ""
    text = f'<div class="verdict {kind}">\n<p class="word">{escape(found.word)}</p>\n'
    text += f"<p>{escape(found.sentence)}{limits}</p>\n"
    margin = smallest_margin(plan)
    if margin is not None:
        text += f"<p>{escape(sections.worst_move(plan))}</p>\n"
    return text + "</div>"


def _plane(plan: Mapping[str, Any], shown: Mapping[str, str]) -> str:
    return possible_contacts(plan) + shown.get("sets", "") + shown.get("surfaces", "")


def _states(plan: Mapping[str, Any], shown: Mapping[str, str]) -> str:
    drawings = "".join(shown[name] for name in shown if name == "states" or name.startswith("states-"))
    return sections.why(plan) + drawings + sections.contact_table(plan) + sections.critical_table(plan)


def _nominal(plan: Mapping[str, Any], shown: Mapping[str, str]) -> str:
    return shown.get("diagrams", "") + shown.get("trajectory", "") + control_tables.force_table(plan)


def _shown(plan: Mapping[str, Any], figures: Mapping[str, str]) -> dict[str, str]:
    """The figures as pictures with what they show in words."""
    made = {}
    for name, figure in catalogue(plan).items():
        if name in figures:
            source = f'src="data:image/svg+xml;base64,{b64encode(figures[name].encode()).decode()}"'
            width, height = (round(96 * inches) for inches in figure.size)
            picture = f'<img {source} alt="{escape(figure.alt)}" width="{width}" height="{height}">'
            made[name] = f"<figure>\n{picture}\n<figcaption>{escape(figure.title)}</figcaption>\n</figure>\n"
    return made
