"""The report of a study: one page of HTML that holds everything and opens offline."""

import re
from collections import Counter
from collections.abc import Sequence

import numpy as np

from fmopt.report import shell
from fmopt.report.scene import resource
from fmopt.report.shell import Chapter, chaptered, facts, figure, paragraph, table
from fmopt.study.results.figures import binding
from fmopt.study.results.shares import Bin, Estimate, bins, difference, rank_correlation, share, sobol_indices, trials
from fmopt.study.results.table import Varied
from fmopt.study.results.view import View, answer_label, axis_label, ticks
from fmopt.study.sampling import CUBES

_NUMBER = re.compile(r"(?<![\w])-?\d+(?:\.\d+)?(?:e-?\d+)?")  # none within a name, as in v3-f1
_COMPARED = 100  # runs that are held against the first one
_LISTED = 6  # numbers of runs that a group of failures names


def page(view: View, figures: dict[str, tuple[str, str]]) -> str:
    """The report: a page without any reference to something outside it."""
    shares, tried = (view.goodness, "runs"), ("succeeded", "trials")
    mixed = view.free if view.done.any() and not view.good[view.done].all() else ()
    chapters = [
        ("outcome", "What came out", _outcome(view)),
        ("figures", "Over the axes", "".join(picture(*figures[name]) for name in figures)),
        ("share", f"How often {view.goodness}", "".join(_bin_table(view, a, bins(view, a), shares) for a in mixed)),
        ("success", "How often it succeeds", "".join(_bin_table(view, a, trials(view, a), tried) for a in view.free)),
        ("differences", "Run by run", _differences(view)),
        ("sensitivity", "What matters", _correlations(view) + _sobol(view)),
        ("binding", "What binds", _binding(view)),
        ("failures", "What failed", _failures(view)),
        ("provenance", "Where this comes from", _provenance(view)),
    ]
    return framed("Study", view.results.facts.get("title", "study"), chapters)


def framed(kind: str, title: str, chapters: Sequence[Chapter]) -> str:
    """A page of chapters, those without a text left out."""
    return shell.page(title, resource("page.css"), chaptered(kind, title, chapters))


def picture(words: str, svg: str) -> str:
    """A figure in the page, with what it shows in words."""
    return figure(svg, words, words)


def _outcome(view: View) -> str:
    total, done, good = len(view.results.lines), int(view.done.sum()), int(view.good.sum())
    waiting = sum(line["outcome"] is None for line in view.results.lines)
    words = f"{total} runs: {done} with answers, {total - done - waiting} failed, {waiting} not done yet."
    if done:
        words += f" {good} of {done} are {view.goodness}: {_interval(share(good, done), 100.0)} %."
    rows = [(kind, str(count)) for kind, count in sorted(Counter(view.kinds).items())]
    ranges = []
    for name in view.answers:
        values = view.answer(name)[np.isfinite(view.answer(name))]
        ranges.append((answer_label(name), *(f"{v:.4g}" for v in (values.min(), np.median(values), values.max()))))
    return (
        paragraph(words)
        + table("What became of the runs", ("verdict, or kind of failure", "runs"), rows, "tn")
        + table("Answers", ("answer", "least", "median", "greatest"), ranges, "tnnn")
    )


def _interval(found: Estimate, scale: float = 1.0) -> str:
    value, low, high = (f"{scale * number:.3g}".replace("-", "−") for number in (found.value, found.low, found.high))
    return f"{value} ({low} to {high})"


def _places(view: View, axis: Varied, spans: Sequence[tuple[float, float]]) -> list[str]:
    """Ranges of an axis in words, all told in as many digits."""
    bounds = np.unique(np.array(spans))
    words = [view.words(axis)[int(b)] for b in bounds] if axis.unit == "word" else ticks(bounds)
    said = dict(zip(bounds.tolist(), words, strict=True))
    return [" to ".join(dict.fromkeys((said[low], said[high]))) for low, high in spans]


def _bin_table(view: View, axis: Varied, found: Sequence[Bin], words: tuple[str, str]) -> str:
    places = _places(view, axis, [(b.low, b.high) for b in found])
    rows = [(p, str(b.good), str(b.total), _interval(b.share, 100.0)) for p, b in zip(places, found, strict=True)]
    return table(f"Over {axis_label(axis)}", (axis_label(axis), *words, "% (95 % interval)"), rows, "nnnn")


def _differences(view: View) -> str:
    """Runs against the first one whose draws are known: the draws are the same, so that noise is in common."""
    seats = [line.get("seats") for line in view.results.lines]
    known = [number for number, one in enumerate(seats) if isinstance(one, str)]
    first, others = known[:1], known[1 : _COMPARED + 1]
    found = [difference(str(seats[number]), str(seats[first[0]])) for number in others]
    values = [_places(view, axis, [(x, x) for x in view.axis(axis)[others].tolist()]) for axis in view.free if others]
    rows = list(zip(map(str, others), *values, (_interval(one, 100.0) for one in found), strict=True))
    head = ("run", *map(axis_label, view.free), "points of % (95 % interval)")
    return table(f"More draws that seat than in run {first[0]}" if first else "", head, rows, "n" * len(head))


def _correlations(view: View) -> str:
    """Spearman's rank correlation of each axis with each answer."""
    rows = []
    for name in view.answers:
        y = view.answer(name)
        for axis in view.free:
            x, known = view.axis(axis), np.isfinite(y)
            # Words are in the order in which they come, which means nothing.
            found = None if axis.unit == "word" else rank_correlation(x[known], y[known])
            if found is not None:
                rows.append((answer_label(name), axis_label(axis), _interval(found), str(int(known.sum()))))
    head = ("answer", "axis", "Spearman's ρ (95 % interval)", "runs")
    return table("Rank correlation: 1 rises always, −1 falls always, 0 neither", head, rows, "ttnn")


def _sobol(view: View) -> str:
    if view.results.sampling["method"] != "saltelli":
        return ""
    rows = []
    for name in view.answers:
        found = sobol_indices(view.answer(name), len(view.free)) or []
        # One for each axis, or none at all where they are not defined.
        for axis, index in zip(view.free, found, strict=False):
            rows.append((answer_label(name), axis_label(axis), _interval(index.first), _interval(index.total)))
    head = ("answer", "axis", "alone (95 % interval)", "with the others (95 % interval)")
    return table("Sobol indices: share of the variance that an axis explains", head, rows, "ttnn")


def _binding(view: View) -> str:
    """Which contact binds in how many runs, and over which ranges of the axes."""
    named = binding(view)
    mine = [np.array([other == name for other in view.bindings]) for name in named]
    columns = [[str(count) for count in named.values()]]
    for axis in view.free:
        x = view.axis(axis)
        columns.append(_places(view, axis, [(float(x[m].min()), float(x[m].max())) for m in mine]))
    rows = list(zip(named, *columns, strict=True))
    head = ("contact, or pieces of moving/fixed part", "runs", *(axis_label(axis) for axis in view.free))
    return table("The tightest inequality, run by run", head, rows, "tn")


def _failures(view: View) -> str:
    """Runs that have no answer, then those whose answer is that there is no motion, each by reason."""
    outcomes = [(n, line["outcome"], line["reason"]) for n, line in enumerate(view.results.lines)]
    failed = [n for n, outcome, _ in outcomes if outcome not in ("done", None)]
    without = [n for n, outcome, reason in outcomes if outcome == "done" and reason]
    caption = "Runs without a motion, by reason; … stands for numbers that differ"
    return _reasons(view, "Runs without answers, by reason", failed) + _reasons(view, caption, without)


def _reasons(view: View, caption: str, numbers: Sequence[int]) -> str:
    groups: dict[tuple[str, str], list[int]] = {}
    for number in numbers:
        group = view.kinds[number], _NUMBER.sub("…", str(view.results.lines[number]["reason"]))
        groups.setdefault(group, []).append(number)
    rows = []
    for (kind, reason), mine in sorted(groups.items(), key=lambda item: (-len(item[1]), item[0])):
        said = {str(view.results.lines[number]["reason"]) for number in mine}
        named = ", ".join(str(number) for number in mine[:_LISTED]) + (" …" if len(mine) > _LISTED else "")
        rows.append((kind, said.pop() if len(said) == 1 else reason, str(len(mine)), named))
    return table(caption, ("kind", "reason", "runs", "numbers"), rows, "ttnt")


def _provenance(view: View) -> str:
    stated, sampling = view.results.facts, view.results.sampling
    how = str(sampling["method"])
    if how in CUBES:
        how += f", {sampling['runs']} points, seed {sampling['seed']}"

    rows = [("problem", stated.get("problem", "")), ("sampling", how), ("program", stated.get("program", ""))]
    return facts("", [*rows, *((axis.name, f"unit {axis.unit or 'none'} in the table") for axis in view.results.axes)])
