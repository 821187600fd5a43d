"""A study from Python: carried out, or as far as it is, with its table, its figures and its report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from fmopt.study.results import table
from fmopt.study.running.store import Scalar

if TYPE_CHECKING:
    import polars

_SHOWN = 12  # lines of the table that a notebook shows


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a study's folder holds, read when it is first asked for."""

    folder: Path

    @cached_property
    def results(self) -> table.Results:
        """Axes, columns and lines, SI units.

        Raises:
            InputError: there is no study in this folder.
        """
        return table.results(self.folder)

    @property
    def lines(self) -> Sequence[Mapping[str, Scalar]]:
        """A mapping from column to value for each run, in the order of the design, SI units."""
        return self.results.lines

    def frame(self) -> polars.DataFrame:
        """The table as a data frame, SI units.

        Raises:
            ResourceError: polars, of the extra `frame`, is not installed.
        """
        return table.frame(self.results)

    @cached_property
    def figures(self) -> Mapping[str, tuple[str, str]]:
        """The figures by name: what each shows, and its SVG."""
        from fmopt.study.results.figures import figures
        from fmopt.study.results.view import View

        return figures(View(self.results))

    def report(self) -> tuple[Path, ...]:
        """Writes report, table and, with polars, Parquet beside the results, and names the files.

        Raises:
            ResourceError: a file cannot be written.
        """
        # It loads all that computes; who only looks at results goes without.
        from fmopt.study.command import report

        return tuple(report(self.folder))

    def __repr__(self) -> str:
        done = sum(line["outcome"] is not None for line in self.lines)
        return f"<fmopt study in {self.folder}: {done} of {len(self.lines)} runs done>"

    def _repr_html_(self) -> str:
        from fmopt.report.shell import figure
        from fmopt.report.shell import table as as_table

        columns = self.results.columns
        rows = [[_cell(line.get(name)) for name in columns] for line in self.lines[:_SHOWN]]
        more = len(self.lines) - _SHOWN
        said = as_table(f"{self.folder}" + (f", {more} runs more" if more > 0 else ""), columns, rows)
        drawn = "".join(figure(svg, words, words) for words, svg in self.figures.values())
        return f"<div>{said}{drawn}</div>"


def study(
    file: str | PathLike[str],
    out: str | PathLike[str] | None = None,
    *,
    jobs: int | None = None,
    limit: int | None = None,
    retry_failed: bool = False,
    cluster: str | None = None,
) -> Outcome:
    """Starts a study or goes on with it, and gives its results; as `fmopt.study(…)`.

    Args:
        out: folder for the results; out/<study> when not given. What is done there already is not done again.

    Raises:
        InputError: the file cannot be used.
        ResourceError: the folder, the workers or the cluster cannot be had.
    """
    from fmopt.study.command import carry_out
    from fmopt.study.running.running import Options

    folder = Path(out) if out is not None else Path("out") / Path(file).stem
    carry_out(Path(file), folder, Options(jobs, limit, retry_failed, cluster), lambda _: None)
    return Outcome(folder)


def _cell(value: Scalar) -> str:
    return "" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)
