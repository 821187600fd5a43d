"""Start-up: the help text beside an empty interpreter beside one that loads the solvers."""

import subprocess
import sys

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

COMMANDS = {
    "python -c pass": ["-c", "pass"],
    "fmopt --help": ["-m", "fmopt", "--help"],
    "import fmopt.verify": ["-c", "import fmopt.verify"],
    "import fmopt.planning.pipeline": ["-c", "import fmopt.planning.pipeline"],
    "import of the solvers": ["-c", "import casadi, clarabel, daqp, scipy.optimize, sympy"],
}


@pytest.mark.benchmark(group="start-up")
@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS.keys())
def test_start_up(benchmark: BenchmarkFixture, command: list[str]) -> None:
    def start() -> int:
        return subprocess.run([sys.executable, *command], stdout=subprocess.DEVNULL, timeout=60, check=True).returncode

    assert benchmark.pedantic(start, rounds=5, warmup_rounds=1) == 0
