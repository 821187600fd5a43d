"""Tolerance allocation: which tolerances can be loosened, at given weights, with the insertion still certified.

The motion is planned for the present tolerances and then held fixed: its certificate is computed again for any
others, which is cheap, and the cheapest that keep its margins are found. At the answer, rounded down, the same motion
is certified and checked independently, and the problem is planned anew. The new motion is then the one held fixed, as
long as it leaves room for more.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fmopt.certificate.error_set import ErrorSet
from fmopt.errors import InfeasibleError, SearchError
from fmopt.plan import parsed
from fmopt.planning.pipeline import certified_motion, planned, proved
from fmopt.planning.placement.sequence_program import Placed
from fmopt.planning.posed import Stages, under_errors
from fmopt.planning.robustness.error_tolerance import CertifiedMotion
from fmopt.report.shell import facts, paragraph, table
from fmopt.spatial.values import Array
from fmopt.study.allocation.cheapest import Cheapest, cheapest
from fmopt.study.allocation.tolerances import Question
from fmopt.study.results.figures import changes
from fmopt.study.results.page import framed, picture
from fmopt.study.results.view import READ
from fmopt.task.problem import Problem
from fmopt.task.toml.units import ANGLE, LENGTH, Dimension, in_words

_DIGITS = 3  # that an answer is rounded down to
_MOTIONS = 6  # that are held fixed at most, each planned for the tolerances that the one before leaves


@dataclass(frozen=True, eq=False)
class Allocation:
    """The answer, with the least margins of the fixed motion and of one planned anew, m; None where there is none."""

    question: Question
    found: Cheapest
    values: tuple[float, ...]
    cost: float
    before: float
    margin: float
    document: Mapping[str, Any]
    replanned: str
    replanned_margin: float | None
    motions: int
    anew: CertifiedMotion | None

    def record(self) -> dict[str, Any]:
        """The answer as JSON, SI units."""
        rows = zip(self.question.tolerances, self.values, strict=True)
        return {
            "title": self.question.file.title,
            "margin_required": self.question.file.margin,
            "tolerances": [{**a.record(), "after": value} for a, value in rows],
            "cost_before": self.before,
            "cost_after": self.cost,
            "cost_bound": self.found.bound,
            "binding": self.found.binding,
            "motions": self.motions,
            "rounds": self.found.rounds,
            "certificates_computed": self.found.evaluations,
            "same_motion": {"verdict": self.document["verdict"], "margin": self.margin},
            "planned_anew": {"verdict": self.replanned, "margin": self.replanned_margin},
        }

    def words(self) -> list[str]:
        """The answer for people."""
        answer, lines = self.record(), list[str]()
        for allowed, value in zip(self.question.tolerances, self.values, strict=True):
            before, after = (in_words(x, allowed.dimension) for x in (allowed.now, value))
            # Scaling to mm or degrees and back may cost the last digits.
            end = ", the loosest allowed" if value >= allowed.high * (1.0 - 1e-9) else ""
            lines.append(f"  {allowed.name}: {before} -> {after} ({value / allowed.now:.3g} times{end})")
        checked = [": ".join((name, ", least margin ".join(filter(None, rest)))) for name, *rest in _checked(answer)]
        return [f"{answer['title']}: {_outcome(answer)}", *lines, *checked, f"what binds: {self.found.binding}"]


def allocate(question: Question, progress: Callable[[str], None] = lambda _: None) -> Allocation:
    """Answers a question."""
    now = [allowed.now for allowed in question.tolerances]
    answer = _with_motion(question, certified_motion(question.problem(now), Stages(progress)), 1, progress)
    while answer.replanned == "CERTIFIED" and answer.motions < _MOTIONS:
        assert answer.anew is not None
        progress(f"cost {answer.cost:.4g} after {answer.motions} motions")
        try:
            other = _with_motion(question, answer.anew, answer.motions + 1, progress)
        except InfeasibleError:  # the new motion leaves less than is asked for: the answer before it stands
            break
        if other.cost > (1.0 - question.file.gap) * answer.cost or other.document["verdict"] != "CERTIFIED":
            break
        answer = other
    return answer


def _with_motion(question: Question, done: CertifiedMotion, number: int, progress: Callable[[str], None]) -> Allocation:
    """The answer for one motion, with a plan made anew at it."""
    tolerances = question.tolerances
    now = np.array([allowed.now for allowed in tolerances])
    counted = [0]

    def margins(u: Array) -> Mapping[str, float] | str:
        counted[0] += 1
        progress(f"motion {number}, certificate {counted[0]}")
        placed = _certified(done, question.problem((u * now).tolist()))
        return placed if isinstance(placed, str) else _margins(placed)

    weights = np.array([allowed.weight for allowed in tolerances])
    low, high = (np.array([getattr(a, name) / a.now for a in tolerances]) for name in ("low", "high"))
    found = cheapest(margins, weights, low, high, question.file.margin, question.file.gap)
    values = tuple(_down(float(u) * a.now, a.dimension) for u, a in zip(found.u, tolerances, strict=True))
    problem = question.problem(values)
    placed = _certified(done, problem)
    if isinstance(placed, str):
        raise InfeasibleError(f"with the answer rounded down, {placed}", advice="lower the digits, or state low")
    # The motion was found for other errors; the plan states those that it is certified for now.
    errors = ErrorSet.of(problem.start_box, problem.framing)
    same = replace(done, errors=errors, tolerance=under_errors(done, problem).tolerance, placed=placed)
    progress("checking the same motion")
    document, _ = planned(problem, same)
    anew, verdict, margin = _anew(problem, progress)
    before, cost = float(weights.sum()), float(np.sum(weights * now / np.array(values)))
    return Allocation(question, found, values, cost, before, placed.margin, document, verdict, margin, number, anew)


def _certified(done: CertifiedMotion, problem: Problem) -> Placed | str:
    """The motion with the errors of a problem, or in words why it cannot be followed."""
    try:
        return under_errors(done, problem).placed()
    except InfeasibleError as error:
        return error.message


def _margins(placed: Placed) -> dict[str, float]:
    """All margins of a motion by name."""
    found: dict[str, float] = {}
    for n, claim in enumerate(placed.reached.claims, start=1):
        for i, j, kept in claim.separations:
            found[f"segment {n}: pieces {i}/{j}"] = kept.margin
        for contact in claim.contacts:
            found[f"segment {n}: {contact.contact.id} inside"] = contact.margin
        if claim.early is not None:
            found[f"segment {n}: next contact too early"] = claim.early
    return found


def _anew(problem: Problem, progress: Callable[[str], None]) -> tuple[CertifiedMotion | None, str, float | None]:
    """A plan made anew: its motion, verdict and least margin."""
    try:
        done = certified_motion(problem, Stages(progress))
        document, verdict = proved(problem, done)
        margin = min(segment.margin for segment in parsed(document).segments)
    except SearchError:
        return None, "NOT_FOUND", None
    except InfeasibleError as error:
        return None, f"INFEASIBLE ({error.message})", None
    return done, str(verdict.verdict), margin


def _down(value: float, dimension: Dimension) -> float:
    """The value rounded down to a few digits in mm, degrees, or the unit of SI."""
    scale = {LENGTH: 1e-3, ANGLE: math.pi / 180.0}.get(dimension, 1.0)
    read = value / scale
    size = 10.0 ** (math.floor(math.log10(read)) - _DIGITS + 1)
    # The share keeps a number of few digits that is a hair short in binary; no value ends above what was found.
    return min(float(f"{math.floor(read / size * (1.0 + 1e-9)) * size:.{_DIGITS}g}") * scale, value)


def allocation_page(answer: Mapping[str, Any]) -> str:
    """The report of an answer as its file holds it; a page without any reference to something outside it."""
    words = "tolerances as multiples of what they were"
    outcome = paragraph(f"{_outcome(answer)}.", f"What binds: {answer['binding']}.")
    required = paragraph(f"The margin asked for is {1e6 * float(answer['margin_required']):.2f} µm.")
    head = ("motion", "verdict", "least margin")
    names = {
        "motions": "motions held fixed in turn",
        "rounds": "convex programs for the last",
        "certificates_computed": "certificates for the last",
    }
    chapters = [
        ("outcome", "What came out", outcome + picture(words, changes(answer["tolerances"]))),
        ("tolerances", "The tolerances", _tolerances(answer["tolerances"])),
        ("checked", "What was checked", required + table("At the new tolerances", head, _checked(answer), "ttn")),
        ("provenance", "How it was found", facts("", [(words, str(answer[name])) for name, words in names.items()])),
    ]
    return framed("Tolerance allocation", str(answer["title"]), chapters)


def _outcome(answer: Mapping[str, Any]) -> str:
    before, after, bound = (answer[name] for name in ("cost_before", "cost_after", "cost_bound"))
    words = f"cost {before:.4g} before, {after:.4g} after, {100.0 * (1.0 - after / before):.3g} % less; "
    if bound is None:
        return f"{words}no bound is known, as margins of the last motion are not concave"
    return f"{words}at least {bound:.4g} for the last motion where margins are concave"


def _tolerances(tolerances: Sequence[Mapping[str, Any]]) -> str:
    rows = []
    for t in tolerances:
        scale, unit = READ.get(str(t["unit"]), (1.0, str(t["unit"])))
        values = [f"{scale * float(t[name]):.4g} {unit}".rstrip() for name in ("now", "after", "low", "high")]
        rows.append((str(t["name"]), *values, f"{float(t['after']) / float(t['now']):.3g}", f"{float(t['weight']):g}"))
    head = ("tolerance", "present", "new", "tightest allowed", "loosest allowed", "new/present", "weight")
    return table("Half-widths", head, rows, "tnnnnnn")


def _checked(answer: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Verdict and least margin with the new tolerances: of the same motion, and of one planned anew."""
    pairs = (("the same motion", answer["same_motion"]), ("planned anew", answer["planned_anew"]))
    margins = ["" if found["margin"] is None else f"{1e6 * float(found['margin']):.2f} µm" for _, found in pairs]
    return [(words, str(found["verdict"]), margin) for (words, found), margin in zip(pairs, margins, strict=True)]
