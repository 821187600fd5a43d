"""Studies: the work itself beside the same work in one worker, with every row durable, and in two."""

from __future__ import annotations

from pathlib import Path

import pytest
import study_evaluations as evaluations
from pytest_benchmark.fixture import BenchmarkFixture

from fmopt.study.running import Options, run

RUNS = 200  # of 20 ms


@pytest.mark.benchmark(group="study")
def test_work_itself(benchmark: BenchmarkFixture, tmp_path: Path) -> None:
    work = evaluations.work(RUNS)
    assert len(benchmark.pedantic(lambda: [evaluations.busy(run, tmp_path) for run in work.runs], rounds=3)) == RUNS


@pytest.mark.benchmark(group="study")
@pytest.mark.parametrize("jobs", [1, 2])
def test_as_a_study(benchmark: BenchmarkFixture, tmp_path: Path, jobs: int) -> None:
    work, number = evaluations.work(RUNS), iter(range(100))

    def study() -> int:
        return run(work, tmp_path / str(next(number)), evaluations.busy, Options(jobs)).fresh

    assert benchmark.pedantic(study, rounds=3) == RUNS
