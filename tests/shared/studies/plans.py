"""Plans by the thousand: how much the machinery of studies adds to the work itself, and whether memory stays flat.

python study_plans.py PROBLEM RUNS JOBS, to measure at length; the start errors vary by a tenth. With several numbers of
workers, "1,2", the plans are made anew with each, and the throughputs compared.
"""

import os
import resource
import sys
import tempfile
import time
from pathlib import Path

from fmopt.study.design import load_study
from fmopt.study.evaluation import evaluate
from fmopt.study.running.running import Options, Tally, run
from fmopt.study.running.store import efforts, recorded
from fmopt.task.toml.source import read
from fmopt.task.toml.tables import Reading, factors
from fmopt.task.toml.units import LENGTH

STUDY = """\
title = "plans by the thousand"
problem = "{problem}"
compute = ["plan", "margins"]

[units]
length = "m"
angle = "rad"

[[axes]]
name = "position_error"
low = {low}
high = {high}
sets = ["uncertainty.start.x", "uncertainty.start.y"]

[sampling]
method = "latin-hypercube"
runs = {runs}
seed = 1

[limits]
time = "900 s"
memory_mb = 8000
"""


def measured(problem: Path, runs: int, jobs: int, folder: Path) -> dict[str, float]:
    """Runs the study of so many plans in an empty folder and says what it took.

    The position error of the problem varies between nine tenths and all of what it is.
    """
    data = read(problem).data
    whole = Reading(factors(data.get("units"))).quantity(data["uncertainty"]["start"]["x"], LENGTH).value
    file = folder / "study.toml"
    file.write_text(STUDY.format(problem=problem.absolute(), runs=runs, low=0.9 * whole, high=whole))
    work, owner = load_study(file).work(), [_peak()]

    def noted(tally: Tally) -> None:
        if 4 * tally.fresh <= runs:
            owner[0] = _peak()

    began, spent, workers = time.perf_counter(), time.process_time(), _of_workers()
    tally = run(work, folder / "out", evaluate, Options(jobs), progress=noted)
    seconds, spent = time.perf_counter() - began, time.process_time() - spent
    workers = _of_workers() - workers
    rows = [entry.row for entry in recorded(folder / "out")[1]]
    assert tally.done == runs
    assert all(row is not None and row.outcome == "done" for row in rows)
    took = efforts(folder / "out")
    working = sum(effort.seconds for effort in took.values())
    peaks = [took[row.key].peak for row in rows if row is not None]
    return {
        "plans a second": runs / seconds,
        "plans a second and worker": runs / seconds / jobs,
        "plans a second of processor time": runs / workers,
        "overhead, % of the work": 100.0 * (jobs * seconds / working - 1.0),
        "processor time of the owner, % of the work": 100.0 * spent / working,
        "memory of a worker after a quarter, MB": max(peaks[: max(1, len(peaks) // 4)]) / 1e6,
        "memory of a worker at the end, MB": max(peaks) / 1e6,
        "memory of the owner after a quarter, MB": owner[0],
        "memory of the owner at the end, MB": _peak(),
        "certified, %": 100.0 * sum(row is not None and row.answers["verdict"] == "CERTIFIED" for row in rows) / runs,
    }


def _peak() -> float:
    """The most memory that this process has had, MB."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


def _of_workers() -> float:
    """Processor time of the workers that have ended, s: what others do on the machine does not count."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main(problem: Path, runs: int, numbers: list[int]) -> None:
    """Prints what the study takes with each number of workers, and how their throughputs compare."""
    rates: list[float] = []
    for jobs in numbers:
        with tempfile.TemporaryDirectory() as scratch:
            print(f"{runs} plans on {jobs} workers, {os.cpu_count()} processors")
            found = measured(problem, runs, jobs, Path(scratch))
        for name, value in found.items():
            print(f"{name}: {value:.4g}", flush=True)
        rates.append(found["plans a second"])
    for jobs, rate in zip(numbers[1:], rates[1:], strict=True):
        print(f"throughput on {jobs} workers / on {numbers[0]}: {rate / rates[0]:.3f}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), [int(jobs) for jobs in sys.argv[3].split(",")])
