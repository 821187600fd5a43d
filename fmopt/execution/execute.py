"""`fmopt execute`: trials of a plan into a folder, with their summary."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fmopt import plan
from fmopt.execution.scene import engine
from fmopt.execution.summary import summary
from fmopt.execution.trials import Trials, run_all


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
    engine()
    document = plan.read(file)
    plan.prepare(folder)
    records = run_all(document, trials, folder / "trials.jsonl", workers or len(os.sched_getaffinity(0)), advance)
    found = {"plan": document["sha256"], "trials": len(records), **summary(records)}
    plan.save((json.dumps(found, indent=1) + "\n").encode(), folder / "summary.json")
    return found
