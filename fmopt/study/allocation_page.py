"""The report of a tolerance allocation: what each tolerance becomes, what that saves, and what was checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from fmopt.report.tables import table
from fmopt.study.figures import changes
from fmopt.study.page import framed, picture
from fmopt.study.view import READ


def allocation_page(answer: Mapping[str, Any]) -> str:
    """The report of an answer as its file holds it; a page without any reference to something outside it."""
    chapters = [
        ("outcome", "What came out", _outcome(answer) + _figure(answer["tolerances"])),
        ("tolerances", "The tolerances", _tolerances(answer["tolerances"])),
        ("checked", "What was checked", _checked(answer)),
        ("provenance", "How it was found", _found(answer)),
    ]
    return framed("Tolerance allocation", str(answer["title"]), chapters)


def _outcome(answer: Mapping[str, Any]) -> str:
    before, after, bound = (answer[name] for name in ("cost_before", "cost_after", "cost_bound"))
    words = f"The cost is {after:.4g}, {100.0 * (1.0 - after / before):.3g} % less than the {before:.4g} before; "
    words += "no bound is known" if bound is None else f"for the last motion it is at least {bound:.4g}"
    words += ", as its margins are not concave." if bound is None else " where margins are concave."
    return f"<p>{escape(words)}</p>\n<p>{escape('What binds: ' + str(answer['binding']))}.</p>\n"


def _figure(tolerances: Sequence[Mapping[str, Any]]) -> str:
    return picture("tolerances as multiples of what they were", changes(tolerances))


def _tolerances(tolerances: Sequence[Mapping[str, Any]]) -> str:
    rows = []
    for t in tolerances:
        scale, unit = READ.get(str(t["unit"]), (1.0, str(t["unit"])))
        values = [f"{scale * float(t[name]):.4g} {unit}".rstrip() for name in ("now", "after", "low", "high")]
        rows.append((str(t["name"]), *values, f"{float(t['after']) / float(t['now']):.3g}", f"{float(t['weight']):g}"))
    head = ("tolerance", "present", "new", "tightest allowed", "loosest allowed", "new/present", "weight")
    return table("Half-widths", head, rows, "tnnnnnn")


def _checked(answer: Mapping[str, Any]) -> str:
    rows = []
    for name, words in (("same_motion", "the same motion"), ("planned_anew", "planned anew")):
        margin = answer[name]["margin"]
        rows.append((words, str(answer[name]["verdict"]), "" if margin is None else f"{1e6 * float(margin):.2f} µm"))
    required = f"The margin asked for is {1e6 * float(answer['margin_required']):.2f} µm."
    return f"<p>{required}</p>\n" + table("At the new tolerances", ("motion", "verdict", "least margin"), rows, "ttn")


def _found(answer: Mapping[str, Any]) -> str:
    names = {
        "motions": "motions held fixed in turn",
        "rounds": "convex programs for the last",
        "certificates_computed": "certificates for the last",
    }
    return table("", ("", ""), [(words, str(answer[name])) for name, words in names.items()])
