"""`fmopt execute` and `fmopt compare`: trials of plans into a folder, with their summary."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fmopt import output
from fmopt.execution.record import run_all
from fmopt.execution.summary import summary
from fmopt.execution.trials import ENGINES, METHODS, Trials
from fmopt.plan import Plan


@dataclass(frozen=True)
class Settled:
    """Where and how trials run.

    Args:
        folder: for the results; what an interrupted run left there is used.
        workers: processes; None for one a core.
        advance: told how many trials are done, each time some are.
    """

    folder: Path
    workers: int | None = None
    advance: Callable[[int], None] = lambda _: None


def execute(what: Plan, trials: Trials, settled: Settled, caution: str = "") -> dict[str, Any]:
    """Runs trials of a plan and writes `trials.jsonl` and `summary.json`.

    Args:
        what: the plan.
        trials: what is to be run.
        settled: where and how.
        caution: what is to be said of the plan, if anything.

    Returns:
        The summary.

    Raises:
        FmoptError: the plan cannot be run, the extra is missing, or the results cannot be written.
    """
    ENGINES[trials.engine].library()
    output.prepare(settled.folder)
    warned = {"caution": caution} if caution else {}
    found = {"verdict": what.verdict, **warned, **_summed(what, trials, settled.folder / "trials.jsonl", settled)}
    output.save((json.dumps(found, indent=1) + "\n").encode(), settled.folder / "summary.json")
    return found


def compare(plans: Sequence[Plan], trials: int, seed: int, settled: Settled) -> list[dict[str, Any]]:
    """Runs plans and the baselines with the same errors, and writes `comparison.json`.

    Args:
        plans: in the order of the rows.
        trials: of each method, inside the certified set.
        seed: of all that is drawn.
        settled: where and how.

    Returns:
        A row for each plan: its title, and for each method the success inside the certified set.

    Raises:
        FmoptError: as for `execute`.
    """
    ENGINES[Trials.engine].library()
    output.prepare(settled.folder)
    rows = []
    for read in plans:
        parts = {}
        for method in METHODS:
            kept = settled.folder / f"{read.sha256[:12]}_{method}.jsonl"
            found = _summed(read, Trials(trials, seed=seed, method=method), kept, settled)
            parts[method] = found["inside"]
        rows.append({"title": read.title, "plan": read.sha256, "methods": parts})
    output.save((json.dumps(rows, indent=1) + "\n").encode(), settled.folder / "comparison.json")
    return rows


def _summed(read: Plan, trials: Trials, file: Path, settled: Settled) -> dict[str, Any]:
    records = run_all(read, trials, file, settled.workers or len(os.sched_getaffinity(0)), settled.advance)
    asked = read.specification.contact_force
    return {"plan": read.sha256, "trials": len(records), "contact_force": asked, **summary(records)}
