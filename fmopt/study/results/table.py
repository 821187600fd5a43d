"""The table of a study: one line for each run of the design, in its order, the same bytes for the same results."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fmopt.errors import ResourceError
from fmopt.runtime import escape
from fmopt.study.running.store import Recorded, Scalar, recorded

if TYPE_CHECKING:
    import polars


@dataclass(frozen=True)
class Varied:
    """An axis as the table has it: its column, its SI unit ("word" for choices), and whether it is even in the log."""

    name: str
    unit: str
    linked: int | None
    log: bool


@dataclass(frozen=True)
class Results:
    """What a folder holds: what the study says of itself, its axes, columns and lines.

    Args:
        lines: values by column, None where a run has none; "outcome" is None for runs that are not done yet.
    """

    facts: Mapping[str, str]
    axes: tuple[Varied, ...]
    columns: tuple[str, ...]
    lines: tuple[Mapping[str, Scalar], ...]

    @property
    def sampling(self) -> Mapping[str, Any]:
        """How the axes were sampled: method, runs and seed."""
        found: Mapping[str, Any] = json.loads(self.facts["sampling"])
        return found


def results(folder: Path) -> Results:
    """The results in a folder; a study that is running may be read, too."""
    facts, records = recorded(folder)
    # From the store, as the study file may be gone, or have changed since.
    columns = tuple(json.loads(facts["columns"]))
    axes = tuple(Varied(a["name"], a["unit"], a["linked"], a["log"]) for a in json.loads(facts["axes"]))
    return Results(facts, axes, columns, tuple(_line(record, columns) for record in records))


def _line(record: Recorded, columns: Sequence[str]) -> dict[str, Scalar]:
    values: dict[str, Scalar] = {"number": record.run.number, **record.run.point}
    if record.row is not None:
        values |= {"outcome": record.row.outcome, "reason": record.row.reason or None, **record.row.answers}
    return {column: values.get(column) for column in columns}


def csv_text(found: Results) -> str:
    """The table as CSV: SI units, shortest numbers that read back exactly, nothing for what is missing.

    Texts on one line each, with an apostrophe before those that a spreadsheet would take for a formula.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")  # the module's own would be \r\n
    writer.writerow([escape.csv_text(column) for column in found.columns])
    for line in found.lines:
        writer.writerow([_cell(line[column]) for column in found.columns])
    return text.getvalue()


def _cell(value: Scalar) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return escape.csv_text(value) if isinstance(value, str) else repr(value)


def frame(found: Results) -> polars.DataFrame:
    """The table as a data frame.

    Raises:
        ResourceError: polars is not installed.
    """
    try:
        import polars
    except ImportError as error:
        raise ResourceError("data frames need polars", "install fmopt with its extra 'frame'") from error
    columns = {column: _typed([line[column] for line in found.lines]) for column in found.columns}
    return polars.DataFrame(columns, strict=False)


def _typed(values: list[Scalar]) -> list[Scalar]:
    """A column of one type: whole numbers among others become floating."""
    if any(isinstance(value, float) for value in values):
        return [float(v) if isinstance(v, int) and not isinstance(v, bool) else v for v in values]
    return values


def parquet(found: Results) -> bytes:
    """The table as a Parquet file."""
    content = io.BytesIO()
    frame(found).write_parquet(content, compression="zstd")
    return content.getvalue()
