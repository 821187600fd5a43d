"""Trials of a plan in a physics engine, from Python: how many seated, with what certainty, and what went wrong."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any


@dataclass(frozen=True, eq=False)
class Trials:
    """What trials of a plan came to.

    `summary` has, inside and beyond the certified set, trials, successes, share with its 95 % interval, forces (N),
    times (s) and penetration (m), and failures by their first departure from the plan.
    """

    summary: Mapping[str, Any]
    folder: Path

    @property
    def records(self) -> list[dict[str, Any]]:
        """Every trial: its errors (m, rad), whether the part seated, where it came to rest, and what departed."""
        lines = (self.folder / "trials.jsonl").read_text(encoding="utf-8").splitlines()
        # The first line is no trial: it names the plan and what is run.
        return [record for record in map(json.loads, lines) if "trial" in record]

    def __str__(self) -> str:
        from fmopt.execution.summary import lines

        return "\n".join(lines(dict(self.summary)))

    def __repr__(self) -> str:
        return f"<fmopt trials in {self.folder}: {self.summary['trials']} done>"

    def _repr_html_(self) -> str:
        return f"<pre>{escape(str(self))}</pre>"
