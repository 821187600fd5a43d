"""Batch studies: the same function over many problems, resumable, on one machine or a cluster."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import polars


def frame(folder: str | PathLike[str]) -> polars.DataFrame:
    """The results of a study as a data frame: a line for each run, axes and answers as columns, SI units.

    Args:
        folder: where the study's results are; it may still be running.

    Raises:
        InputError: there is no study in this folder.
        ResourceError: the store cannot be read, or polars is not installed.
    """
    from fmopt.study import table

    return table.frame(table.results(Path(folder)))
