"""`fmopt execute` and `fmopt compare`: trials of plans into a folder, with their summary."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from fmopt import output, plan
from fmopt.execution.record import run_all
from fmopt.execution.summary import summary
from fmopt.execution.trials import ENGINES, METHODS, Trials


def execute(
    file: Path, trials: Trials, folder: Path, workers: int | None, advance: Callable[[int], None]
) -> dict[str, Any]:
    """Runs trials of a plan and writes `trials.jsonl` and `summary.json`.

    Args:
        file: plan file.
        trials: what is to be run.
        folder: for the results; what an interrupted run left there is used.
        workers: processes; None for one a core.
        advance: told how many trials are done, each time some are.

    Returns:
        The summary.

    Raises:
        FmoptError: the plan cannot be read or run, the extra is missing, or the results cannot be written.
    """
    ENGINES[trials.engine].library()
    read = plan.read(file)
    output.prepare(folder)
    found = {"verdict": read.verdict, **_summed(read, trials, folder / "trials.jsonl", workers, advance)}
    output.save((json.dumps(found, indent=1) + "\n").encode(), folder / "summary.json")
    return found


def compare(
    files: Sequence[Path], trials: int, seed: int, folder: Path, workers: int | None, advance: Callable[[int], None]
) -> list[dict[str, Any]]:
    """Runs plans and the baselines with the same errors, and writes `comparison.json`.

    Args:
        files: plan files.
        trials: of each method, inside the certified set.
        seed: of all that is drawn.
        folder, workers, advance: as for `execute`.

    Returns:
        A row for each plan: its title, and for each method the success inside the certified set.

    Raises:
        FmoptError: as for `execute`.
    """
    ENGINES[Trials.engine].library()
    output.prepare(folder)
    rows = []
    for file in files:
        read, parts = plan.read(file), {}
        for method in METHODS:
            kept = folder / f"{read.sha256[:12]}_{method}.jsonl"
            found = _summed(read, Trials(trials, seed=seed, method=method), kept, workers, advance)
            parts[method] = found["inside"]
        rows.append({"title": read.title, "plan": read.sha256, "methods": parts})
    output.save((json.dumps(rows, indent=1) + "\n").encode(), folder / "comparison.json")
    return rows


def _summed(
    read: plan.Plan, trials: Trials, file: Path, workers: int | None, advance: Callable[[int], None]
) -> dict[str, Any]:
    records = run_all(read, trials, file, workers or len(os.sched_getaffinity(0)), advance)
    asked = read.specification.contact_force
    return {"plan": read.sha256, "trials": len(records), "contact_force": asked, **summary(records)}
