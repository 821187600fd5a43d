"""Batch studies: the same function over many problems, resumable, on one machine or a cluster."""

from __future__ import annotations

import sys
from os import PathLike
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import polars

    from fmopt.study.outcome import Outcome


class _Room(ModuleType):
    """This package as a module that can be called: `fmopt.study("study.toml")` carries the study out."""

    def __call__(self, file: str | PathLike[str], out: str | PathLike[str] | None = None, **options: Any) -> Outcome:
        """The results of a study, carried out as far as it was not; see `fmopt.study.outcome.study`."""
        from fmopt.study.outcome import study

        return study(file, out, **options)


# Importing anything from here makes `fmopt.study` this package: a function of that name would be lost.
sys.modules[__name__].__class__ = _Room


def frame(folder: str | PathLike[str]) -> polars.DataFrame:
    """The results of a study as a data frame: a line for each run, axes and answers as columns, SI units.

    Raises:
        InputError: there is no study in this folder.
        ResourceError: the store cannot be read, or polars is not installed.
    """
    from fmopt.study.results import table

    return table.frame(table.results(Path(folder)))
