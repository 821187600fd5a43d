"""The command line: `fmopt solve`, `verify`, `check`, `execute`, `export`, `study`, `schema`; heavy imports wait."""

# These are imported for their commands, which they add to `app`.
from fmopt.cli import planning, studying, using
from fmopt.cli.entry import EXIT, app, main

__all__ = ["EXIT", "app", "main", "planning", "studying", "using"]
