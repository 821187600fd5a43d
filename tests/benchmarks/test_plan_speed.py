"""A whole plan: solved in a warm process, and checked."""

from typing import Any

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from fmopt.planning import pipeline
from fmopt.planning.same_problem import differences
from fmopt.task.problem import load
from fmopt.verify import verify
from fmopt.verify.reading.parse import parse
from tests import ROOT

PROBLEM = ROOT / "problems" / "square_peg.toml"


@pytest.mark.benchmark(group="whole plan")
def test_verify(benchmark: BenchmarkFixture, square_peg_plan: dict[str, Any]) -> None:
    benchmark.extra_info["segments"] = len(square_peg_plan["segments"])
    assert benchmark.pedantic(verify, (square_peg_plan,), rounds=3).segments == len(square_peg_plan["segments"])


@pytest.mark.benchmark(group="whole plan")
def test_the_problem_beside_the_plan(benchmark: BenchmarkFixture, square_peg_plan: dict[str, Any]) -> None:
    def read_again() -> tuple[str, ...]:
        return differences(parse(square_peg_plan), load(PROBLEM))

    assert benchmark.pedantic(read_again, rounds=3) == ()


@pytest.mark.benchmark(group="whole plan")
def test_load(benchmark: BenchmarkFixture) -> None:
    assert benchmark.pedantic(load, (PROBLEM,), rounds=3).title


@pytest.mark.benchmark(group="whole plan")
def test_solve(benchmark: BenchmarkFixture, square_peg_plan: dict[str, Any]) -> None:
    """Solves only when timing is on: without it, the session's plan stands for the answer."""

    def solve() -> dict[str, Any]:
        return pipeline.synthesise(load(PROBLEM)).document if benchmark.enabled else square_peg_plan

    assert benchmark.pedantic(solve, rounds=1)["sha256"] == square_peg_plan["sha256"]
