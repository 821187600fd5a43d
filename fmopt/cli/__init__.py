"""The command line: `fmopt solve`, `verify`, `check`, `execute`, `export`, `study`, `schema`; heavy imports wait."""

from fmopt.cli import planning, studying, using
from fmopt.cli.entry import EXIT, app, main

__all__ = ["EXIT", "app", "main", "planning", "studying", "using"]
