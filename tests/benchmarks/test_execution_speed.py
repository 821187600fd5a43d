"""Trials in the physics engine, in one process and in two."""

from pathlib import Path
from typing import Any

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from fmopt.execution.execute import run_all
from fmopt.execution.trials import Trials, run
from fmopt.plan import parsed


@pytest.mark.benchmark(group="execution")
def test_one_trial(benchmark: BenchmarkFixture, square_peg_plan: dict[str, Any]) -> None:
    [record] = benchmark.pedantic(run, (parsed(square_peg_plan), Trials(1), [0]), rounds=1)
    assert record["success"]


@pytest.mark.benchmark(group="execution")
@pytest.mark.parametrize("workers", [1, 2])
def test_chunks(benchmark: BenchmarkFixture, square_peg_plan: dict[str, Any], tmp_path: Path, workers: int) -> None:
    """A hundred trials when timing is on; without it, two. Of the two rows, trials per second, and their ratio."""
    count = 100 if benchmark.enabled else 2
    work = (parsed(square_peg_plan), Trials(count), tmp_path / "trials.jsonl", workers, lambda _: None)
    records = benchmark.pedantic(run_all, work, rounds=1)
    if benchmark.enabled:
        benchmark.extra_info["trials per second"] = count / benchmark.stats.stats.mean
    assert sum(record["success"] for record in records) >= 0.98 * count
