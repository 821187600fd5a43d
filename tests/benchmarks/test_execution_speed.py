"""Trials in the physics engine, in one process and in two."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from fmopt.execution.trials import CHUNK, Trials, run, run_all


@pytest.mark.benchmark(group="execution")
def test_one_trial(benchmark: BenchmarkFixture, square_peg_plan: dict[str, Any]) -> None:
    [record] = benchmark.pedantic(run, (square_peg_plan, Trials(1), [0]), rounds=1)
    assert record["success"]


@pytest.mark.benchmark(group="execution")
@pytest.mark.parametrize("workers", [1, 2])
def test_chunks(benchmark: BenchmarkFixture, square_peg_plan: dict[str, Any], tmp_path: Path, workers: int) -> None:
    """Two chunks of trials when timing is on; without it, two trials."""
    count = 2 * CHUNK if benchmark.enabled else 2
    benchmark.extra_info["trials"] = count
    work = (square_peg_plan, Trials(count), tmp_path / "trials.jsonl", workers, lambda _: None)
    records = benchmark.pedantic(run_all, work, rounds=1)
    assert sum(record["success"] for record in records) >= 0.98 * count
