"""What people see in a terminal: progress on standard error, a table of the moves, the verdict in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from rich.console import Console
from rich.table import Table
from rich.text import Text

from fmopt.runtime.escape import one_line

if TYPE_CHECKING:
    from fmopt.plan import Plan
    from fmopt.plan.press import PressPlan

_KNOWN = 3  # runs that tell what the rest takes
_WIDE = 120  # columns that the whole table of moves needs


class _Progress:
    """What a terminal shows while a command runs, from when it is entered until it is left."""

    _bar: Any  # of rich; None where nothing is shown

    def __enter__(self) -> Self:
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(self, *raised: object) -> None:
        if self._bar is not None:
            self._bar.stop()


class Stages(_Progress):
    """Progress of a long command: one changing line, on a terminal only, and warnings."""

    def __init__(self, silent: bool) -> None:
        self._console, self._silent = Console(stderr=True), silent
        self._bar = None if silent or not self._console.is_terminal else self._console.status("")

    def __call__(self, doing: str) -> None:
        """Says what is being done; a warning stays to be seen."""
        if doing.startswith("warning: ") and not self._silent:
            self._console.print(one_line(doing), markup=False, highlight=False, soft_wrap=True)
        elif self._bar is not None:
            self._bar.update(_shown(doing))


class Runs(_Progress):
    """Progress of a study: one bar with rate and time left, on a terminal only."""

    def __init__(self, title: str, silent: bool) -> None:
        from rich.progress import BarColumn, Progress, TextColumn

        console = Console(stderr=True)
        # The description is the name of a file, whose brackets are no markup.
        columns = (TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.fields[words]}"))
        self._bar = Progress(*columns, console=console, disable=silent or not console.is_terminal)
        self._task = self._bar.add_task(one_line(title), total=None, words="")
        self._forecast = silent

    def __call__(self, tally: Any) -> None:
        """Shows how far a study is."""
        failed = f", {tally.failed} failed" if tally.failed else ""
        pace = f", {tally.rate:.3g} a second, {duration(tally.left)} left" if tally.fresh else ""
        words = f"{tally.done} of {tally.total}{failed}{pace}"
        self._bar.update(self._task, total=tally.total, completed=tally.done, words=words)
        if tally.fresh >= _KNOWN and not self._forecast and tally.left > 0.0:
            self._forecast = True
            words = f"the other runs take about {duration(tally.left)}; Ctrl-C stops, the same command goes on"
            self._bar.console.print(words, highlight=False)


def duration(seconds: float) -> str:
    """A time as people say it."""
    for size, name in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.3g} {name}"
    return f"{seconds:.3g} s"


class Trials(_Progress):
    """Progress of trials: a bar on a terminal."""

    def __init__(self, total: int, silent: bool) -> None:
        from rich.progress import Progress

        console = Console(stderr=True)
        self._bar = Progress(console=console, disable=silent or not console.is_terminal)
        self._task = self._bar.add_task("trials", total=total)

    def advance(self, done: int) -> None:
        """So many more trials are done."""
        self._bar.advance(self._task, done)


def print_compared(rows: list[dict[str, Any]]) -> None:
    """Prints the table of `fmopt compare`: a row a fit, a column a method."""
    table = Table("fit", *rows[0]["methods"])
    for row in rows:
        table.add_row(_shown(row["title"]), *(_compared(part) for part in row["methods"].values()))
    Console(width=max(Console().width, 100)).print(table)


def _compared(part: dict[str, Any]) -> str:
    low, high = (100.0 * share for share in part["interval"])
    seconds = part["seconds"].get("median")
    return f"{100.0 * part['share']:.1f} %\n{low:.1f} to {high:.1f} %" + (f"\n{seconds:.1f} s" if seconds else "")


def print_solved(plan: Plan, findings: Sequence[str], folder: Path, report: bool) -> None:
    """Prints the outcome of `fmopt solve`: the moves or the first attempt's presses, and what is said of them."""
    from fmopt.report.moves import summary_rows
    from fmopt.report.presses import ENDINGS, HEAD, OUTCOMES, outcome_rows, press_rows

    console = Console(highlight=False)
    head: tuple[str, ...]
    if plan.press_plan is not None:
        head, rows, few = HEAD, press_rows(plan.press_plan.attempts[0]), (0, 1, 3)
        words = _press_words(plan, plan.press_plan, findings)
    else:
        (head, *rows), few = summary_rows(plan), (0, 1, 5)
        words = _solved_words(plan, findings)
    columns = range(len(head)) if console.width >= _WIDE else few
    console.print(_table(plan.title, head, rows, columns))
    if plan.press_plan is not None and plan.trials is not None:
        console.print(_table(OUTCOMES, ENDINGS, outcome_rows(plan, plan.trials), range(len(ENDINGS))))
    for line in filter(None, words):
        console.print(_shown(line))
    console.print(_shown(f"wrote {folder / 'plan.json'}" + (f", {folder / 'report.html'}" if report else "")))


def _table(title: str, head: Sequence[str], rows: Sequence[Sequence[str]], columns: Sequence[int]) -> Table:
    table = Table(title=_shown(title), title_justify="left")
    for k in columns:
        table.add_column(head[k], justify="right" if "margin" in head[k] else "left")
    for row in rows:
        table.add_row(*(_shown(row[k]) for k in columns))
    return table


def _press_words(plan: Plan, presses: PressPlan, findings: Sequence[str]) -> Iterator[str]:
    """What is said of a plan of presses below its table, line by line."""
    from fmopt.report.naming import pose_words
    from fmopt.report.presses import conditions_words, evidence_words
    from fmopt.report.sections import clearance_words

    yield f"clearance a side: measured {clearance_words(plan, 'measured')}"
    yield f"starts at {pose_words(presses.attempts[0].start)}"
    if others := presses.attempts[1:]:
        yield f"{len(others)} further attempts where it fails: {', '.join(attempt.source for attempt in others)}"
    yield f"{plan.verdict}: {evidence_words(plan)}"
    yield from (f"  {finding}" for finding in findings[:5])
    if plan.trials is not None:
        yield f"drawn from: {conditions_words(plan.trials)}; force up to {plan.trials.peak_force:.1f} N"
    yield "not covered: " + "; ".join(plan.not_covered)


def _solved_words(plan: Plan, findings: Sequence[str]) -> Iterator[str]:
    """What is said of a plan below its table, line by line."""
    from fmopt.report.control_tables import jamming_words
    from fmopt.report.naming import binding_words
    from fmopt.report.presses import carried_words
    from fmopt.report.recovery_tables import rates, recovery_words, tolerated_words
    from fmopt.report.sections import clearance_words
    from fmopt.report.views.tube_view import ends_words

    sides = [f"{kind} {words}" for kind in ("measured", "declared") if (words := clearance_words(plan, kind))]
    yield f"clearance a side: {'; '.join(sides)}"
    least = min(plan.segments, key=lambda segment: segment.margin)
    margin = f"{1e6 * least.margin:.2f} µm ({binding_words(plan, least.binding)})"
    if plan.verdict == "CERTIFIED":
        yield f"CERTIFIED: least margin {margin}, checked independently; {carried_words(plan)}"
    else:
        yield f"{plan.verdict}: least computed margin {margin}, not proved"
        yield from (f"  {finding}" for finding in findings[:5])
    yield from (ends_words(plan), jamming_words(plan), tolerated_words(plan))
    yield "; ".join(": ".join((row[0], row[2])) for row in rates(plan)[:4])
    yield " ".join(recovery_words(plan))
    yield from () if plan.description.diagnostics is None else plan.description.diagnostics.imported
    yield "not covered: " + "; ".join(plan.not_covered)


def _shown(words: str) -> Text:
    """Words that may come from a file, on one line and without markup, so that nothing in them steers the terminal."""
    return Text(one_line(words))
