"""Studies: the work itself beside the same work in one worker, with every row durable, and in two."""

from pathlib import Path

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from fmopt.study.running.running import Options, run
from tests.shared.studies import evaluations
from tests.shared.studies.plans import measured
from tests.shared.studies.problems import straight

RUNS = 200  # of 20 ms
PLANS = 16


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


@pytest.mark.benchmark(group="study of plans")
@pytest.mark.parametrize("jobs", [1, 2])
def test_plans_of_a_study(benchmark: BenchmarkFixture, tmp_path: Path, jobs: int) -> None:
    """Plans a second, in all, by worker and by processor time, with the overhead and the memory, in `extra_info`."""
    problem, out = straight(tmp_path), tmp_path / "study"
    out.mkdir()
    found = benchmark.pedantic(measured, (problem, PLANS if benchmark.enabled else 1, jobs, out), rounds=1)
    benchmark.extra_info.update(found)
    assert found["certified, %"] == 100.0
    assert found["plans a second of processor time"] > 0.0
    assert found["memory of the owner at the end, MB"] >= found["memory of the owner after a quarter, MB"]
