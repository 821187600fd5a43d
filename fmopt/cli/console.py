"""What people see in a terminal: progress on standard error, a table of the moves, the verdict in words."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn
from rich.table import Table
from rich.text import Text

from fmopt.cli.entry import duration
from fmopt.runtime.escape import one_line

if TYPE_CHECKING:
    from fmopt.plan import Plan

_KNOWN = 3  # runs that tell what the rest takes
_WIDE = 120  # columns that the whole table of moves needs


@contextmanager
def stages(silent: bool) -> Iterator[Callable[[str], None]]:
    """Progress of a long command: one changing line, on a terminal only, and warnings."""
    console = Console(stderr=True)
    with console.status("") if console.is_terminal and not silent else nullcontext() as bar:

        def say(doing: str) -> None:
            if doing.startswith("warning: ") and not silent:  # a warning stays to be seen
                console.print(one_line(doing), markup=False, highlight=False, soft_wrap=True)
            elif bar is not None:
                bar.update(_shown(doing))

        yield say


@contextmanager
def runs(title: str, silent: bool) -> Iterator[Callable[[Any], None]]:
    """Progress of a study: one bar with rate and time left, on a terminal only."""
    console, told = Console(stderr=True), silent
    # The description is the name of a file, whose brackets are no markup.
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.fields[words]}"))
    with Progress(*columns, console=console, disable=silent or not console.is_terminal) as bar:
        task = bar.add_task(one_line(title), total=None, words="")

        def show(tally: Any) -> None:
            nonlocal told
            failed = f", {tally.failed} failed" if tally.failed else ""
            pace = f", {tally.rate:.3g} a second, {duration(tally.left)} left" if tally.fresh else ""
            words = f"{tally.done} of {tally.total}{failed}{pace}"
            bar.update(task, total=tally.total, completed=tally.done, words=words)
            if tally.fresh >= _KNOWN and tally.left > 0.0 and not told:
                told = True
                words = f"the other runs take about {duration(tally.left)}; Ctrl-C stops, the same command goes on"
                console.print(words, highlight=False)

        yield show


@contextmanager
def trials(total: int, silent: bool) -> Iterator[Callable[[int], None]]:
    """Progress of trials: a bar on a terminal, told how many more are done."""
    console = Console(stderr=True)
    with Progress(console=console, disable=silent or not console.is_terminal) as bar:
        yield partial(bar.advance, bar.add_task("trials", total=total))


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


def print_solved(plan: "Plan", findings: Sequence[str], folder: Path, report: bool) -> None:
    """Prints the outcome of `fmopt solve`: the moves or the first attempt's presses, and what is said of them."""
    from fmopt.report.moves import summary_rows
    from fmopt.report.presses import ENDINGS, HEAD, OUTCOMES, PLACED, ROWS, outcome_rows, placed_rows, press_rows
    from fmopt.report.sections import statements

    console = Console(highlight=False)
    head: Sequence[str]
    if plan.press_plan is not None:
        head, rows, few = HEAD, press_rows(plan.press_plan.attempts[0]), (0, 1, 3)
    else:
        (head, *rows), few = summary_rows(plan), (0, 1, 5)
    columns = range(len(head)) if console.width >= _WIDE else few
    console.print(_table(plan.title, head, rows, columns))
    if plan.press_plan is not None and plan.description.placed:
        rows, wide = placed_rows(plan.press_plan.attempts[0], plan.description.placed[0]), console.width >= _WIDE
        console.print(_table(PLACED, ROWS, rows, range(len(ROWS)) if wide else (0, 1, 3, 4)))
    if plan.trials is not None and plan.press_plan is not None:
        console.print(_table(OUTCOMES, ENDINGS, outcome_rows(plan, plan.trials), range(len(ENDINGS))))
    for name, words in statements(plan):
        console.print(_shown(f"{name}: {words}"))
        if name == plan.verdict != "CERTIFIED":
            for finding in findings[:5]:
                console.print(_shown(f"  {finding}"))
    console.print(_shown(f"wrote {folder / 'plan.json'}" + (f", {folder / 'report.html'}" if report else "")))


def _table(title: str, head: Sequence[str], rows: Sequence[Sequence[str]], columns: Sequence[int]) -> Table:
    table = Table(title=_shown(title), title_justify="left")
    for k in columns:
        table.add_column(head[k], justify="right" if "margin" in head[k] else "left")
    for row in rows:
        table.add_row(*(_shown(row[k]) for k in columns))
    return table


def _shown(words: str) -> Text:
    """Words that may come from a file, on one line and without markup, so that nothing in them steers the terminal."""
    return Text(one_line(words))
