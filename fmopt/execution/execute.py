"""`fmopt execute` and `fmopt compare`: trials of plans into a folder, with their summary.

The file of trials: run in chunks on all cores, kept as they end, gone on with where it was left.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from fmopt.errors import Interruption, PlanFormatError, ResourceError
from fmopt.execution.engines.catalogue import ENGINES
from fmopt.execution.summary import summary
from fmopt.execution.trials import LATER, METHODS, Trials, run
from fmopt.plan import Plan
from fmopt.runtime import output
from fmopt.runtime.pool import share_out
from fmopt.runtime.process import cores

CHUNK = 125  # trials that run together; more make each cheaper
_FEWEST = 10  # trials that are worth a process
_PAUSE = 1.0  # s between two writings of the file
_SHARE = 20.0  # times that the pause is longer than what writing takes


@dataclass(frozen=True)
class TrialSettings:
    """Where and how trials run; workers are processes, None for one a core."""

    folder: Path
    workers: int | None = None
    advance: Callable[[int], None] = lambda _: None


def execute(what: Plan, trials: Trials, settled: TrialSettings, caution: str = "") -> dict[str, Any]:
    """Runs trials of a plan, writes `trials.jsonl` and `summary.json`, and gives the summary.

    Raises:
        FmoptError: the plan cannot be run, the extra is missing, or the results cannot be written.
    """
    # First of all: where the extra is missing, no folder is left behind.
    ENGINES[trials.engine].library()
    output.prepare(settled.folder)
    warned = {"caution": caution} if caution else {}
    found = {"verdict": what.verdict, **warned, **_summed(what, trials, settled.folder / "trials.jsonl", settled)}
    output.save((json.dumps(found, indent=1) + "\n").encode(), settled.folder / "summary.json")
    return found


def compare(plans: Sequence[Plan], trials: int, seed: int, settled: TrialSettings) -> list[dict[str, Any]]:
    """Run plans and the baselines with the same errors, and write `comparison.json`: for each plan a row of successes.

    Raises:
        PlanFormatError: a plan has presses.
        FmoptError: as for `execute`.
    """
    ENGINES[Trials.engine].library()
    for read in plans:
        if read.press_plan is not None:
            raise PlanFormatError(f"{read.title}: a plan of presses has no guarded moves to compare", "leave it out")
    output.prepare(settled.folder)
    rows = []
    for read in plans:
        parts = {}
        for method in METHODS:
            # By digest: titles may be the same, and a plan that has changed begins anew.
            kept = settled.folder / f"{read.sha256[:12]}_{method}.jsonl"
            found = _summed(read, Trials(trials, seed=seed, method=method), kept, settled)
            parts[method] = found["inside"]
        rows.append({"title": read.title, "plan": read.sha256, "methods": parts})
    output.save((json.dumps(rows, indent=1) + "\n").encode(), settled.folder / "comparison.json")
    return rows


def _summed(read: Plan, trials: Trials, file: Path, settled: TrialSettings) -> dict[str, Any]:
    # Cores that this process may use, which may be fewer than the machine has.
    records = run_all(read, trials, file, settled.workers or cores(), settled.advance)
    asked = read.specification.contact_force
    return {"plan": read.sha256, "trials": len(records), "contact_force": asked, **summary(records)}


def run_all(what: Plan, trials: Trials, file: Path, workers: int, advance: Callable[[int], None]) -> list[Any]:
    """Runs what the file does not hold yet, and keeps each trial soon after it has ended.

    Raises:
        ResourceError: the file is of other trials or cannot be written, or the extra is missing.
    """
    head = _head(what, trials)
    done = _kept(file, head)
    advance(len(done))
    missing = [n for n in range(trials.inside + trials.beyond) if n not in done]
    # A chunk a worker where these are small enough; rounded down, a rest of a few trials would be one more.
    size = min(max(-(-len(missing) // workers), _FEWEST), CHUNK)
    chunks = [missing[k : k + size] for k in range(0, len(missing), size)]
    written, due = len(done), time.monotonic() + _PAUSE

    def keep() -> None:
        """Writes what the file does not hold yet."""
        nonlocal written, due
        began = time.monotonic()
        if len(done) > written:
            _keep(file, head, done)
            written = len(done)
        now = time.monotonic()
        # The whole file is written each time, and grows: that takes less than a twentieth of the time.
        due = now + max(_PAUSE, _SHARE * (now - began))

    def take(records: list[Any]) -> None:
        done.update({record["trial"]: record for record in records})
        if time.monotonic() >= due:
            keep()
        advance(len(records))

    try:
        share_out([partial(run, what, trials, chunk) for chunk in chunks], workers, take)
    except (KeyboardInterrupt, Interruption) as error:
        # What the note says is kept is written in `finally`, whatever it is that ends the run.
        total = trials.inside + trials.beyond
        error.add_note(f"{len(done)} of {total} trials are done, and kept in {file}; run it again to go on")
        raise
    finally:
        keep()
    return [done[number] for number in sorted(done)]


def _head(what: Plan, trials: Trials) -> dict[str, Any]:
    """What a file of trials begins with; of what older files do not name only what is another than theirs."""
    said = asdict(trials)
    return {"plan": what.sha256} | {k: v for k, v in said.items() if k not in LATER or v != getattr(Trials, k)}


def _kept(file: Path, head: Mapping[str, Any]) -> dict[int, Any]:
    if not file.exists():
        return {}
    try:
        # An empty file is a ValueError, too, as it has no first line to take.
        first, *rows = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    except (OSError, ValueError) as error:
        raise ResourceError(f"{file}: no file of trials: {error}", "choose another folder with --out") from error
    other = ["head"]
    if isinstance(first, Mapping):  # what differs beside the numbers of trials, on which no single trial inside depends
        keys = [key for key in {**head, **first} if key not in ("inside", "beyond")]
        other = [key.replace("_", " ") for key in keys if first.get(key) != head.get(key)]
    if other:
        raise ResourceError(f"{file}: holds trials with another {', '.join(other)}", "choose another folder with --out")
    total = head["inside"] + head["beyond"]
    # Numbers below `inside` are drawn inside: where that is another one, an earlier trial may be of the other kind.
    if any(row["trial"] >= total or (row["size"] <= 1.0) != (row["trial"] < head["inside"]) for row in rows):
        asked, held = (f"--trials {one['inside']} --beyond {one['beyond']}" for one in (head, first))
        advice = "ask for no fewer, for more inside only where none is beyond, or choose another folder with --out"
        raise ResourceError(f"{file}: holds trials that {asked} does not ask for, of {held}", advice)
    return {row["trial"]: row for row in rows}


def _keep(file: Path, head: Mapping[str, Any], done: Mapping[int, Any]) -> None:
    # In the order of numbers: the file does not tell chunks, workers or interruptions.
    rows = [head, *(done[number] for number in sorted(done))]
    output.save("".join(json.dumps(row, sort_keys=True) + "\n" for row in rows).encode(), file)
