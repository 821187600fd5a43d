"""Trials of a plan in a physics engine, from Python: how many seated, with what certainty, and what went wrong."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fmopt import plan as files

if TYPE_CHECKING:
    from fmopt.execution.trials import Trials as Wanted
    from fmopt.notebook.plan import Plan


@dataclass(frozen=True, eq=False)
class Trials:
    """What trials of a plan came to.

    Args:
        summary: inside and beyond the certified set: trials, successes, share with its 95 % interval, forces (N), times
            (s) and penetration (m); failures by their first departure from the plan.
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


def carried_out(plan: Plan, wanted: Wanted, folder: Path | None, workers: int | None, unverified: bool) -> Trials:
    """Trials of a plan; see `fmopt.notebook.plan.Plan.execute`.

    Args:
        folder: of the results; beside others in `out` if None.
        workers: processes; one for each processor if None.
        unverified: whether a plan that is not certified is run, too.
    """
    from fmopt.execution.execute import Settled, execute
    from fmopt.notebook.checking import admitted

    name = f"trials-{plan.stated.sha256[:12]}"
    other = "" if wanted.engine == type(wanted).engine else f"-{wanted.engine}"  # of the class: the usual engine
    there = folder if folder is not None else Path("out") / f"{name}{other}"
    read = files.parsed(plan.document)
    caution = admitted(read, unverified)
    files.write(plan.document, there / "plan.json")
    return Trials(execute(read, wanted, Settled(there, workers), caution), there)
