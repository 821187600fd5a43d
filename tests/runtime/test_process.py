"""Streams that are closed or full, signals at random times: the right exit code, nothing lost, nobody left."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.shared.process_calls import PROBLEM, alive, as_a_shell_starts, called, started

SOON = 5.0  # s within which a signal ends a command: one, and the rest for a machine with more work than processors


@pytest.mark.wide
def test_a_dozen_signals_and_as_many_broken_streams(square_peg_plan_file: Path, tmp_path: Path) -> None:
    found = called(square_peg_plan_file, tmp_path, 24, 1)
    assert (found.wrong, sum(found.counts.values())) == ([], 24)
    assert found.slowest < SOON
    assert found.orphans < SOON


@pytest.mark.parametrize("name", ["verify", "export", "show", "check", "solve", "execute", "compare"])
def test_standard_input_that_is_closed_is_no_fault_of_ours(name: str, tmp_path: Path) -> None:
    more = {"export": "--to csv"}.get(name, "")
    line = f"'{sys.executable}' -m fmopt {name} - {more} --out '{tmp_path / 'out'}' <&-"
    line = line if name not in ("verify", "check") else line.partition(" --out")[0] + " <&-"
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 4, done.stderr
    assert "Bad file descriptor" in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_file_does_not_get_the_number_of_a_closed_stream(tmp_path: Path) -> None:
    line = f"'{sys.executable}' -m fmopt examples --out '{tmp_path / 'examples'}' >&- 2>&- <&-"
    done = subprocess.run(["bash", "-c", line], timeout=60, check=False)
    assert done.returncode == 4
    assert {path.name for path in (tmp_path / "examples").iterdir()} == {"models", "problems"}
    assert not any(b"wrote" in path.read_bytes() for path in (tmp_path / "examples").rglob("*.toml"))


def test_a_reader_that_leaves_ends_the_command_without_a_word() -> None:
    process = started(["check", "--json", str(PROBLEM)], "leaving")
    assert process.stderr is not None
    process.stdout.close()
    with process.stderr:
        assert process.stderr.read() == b""
    assert process.wait(60) == -signal.SIGPIPE


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_a_command_that_is_inside_a_library(number: signal.Signals, tmp_path: Path) -> None:
    code = (
        "import ctypes, signal, sys\n"
        "from pathlib import Path\n"
        "from fmopt.runtime import output, process\n"
        "signal.signal(int(sys.argv[2]), signal.SIG_DFL)  # whoever runs the tests may have it ignored\n"
        "def command():\n"
        "    with output.fresh(Path(sys.argv[1])) as folder:\n"
        "        output.save(b'half', folder / 'file')\n"
        "        print('begun', flush=True)\n"
        "        ctypes.CDLL(None).usleep(4_000_000_000)\n"
        "        for _ in range(100): ctypes.CDLL(None).sleep(60)\n"
        "process.run(command)\n"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "bag"), str(int(number))]
    process = subprocess.Popen(command, stdout=subprocess.PIPE)
    assert process.stdout is not None
    with process.stdout:
        process.stdout.readline()
    time.sleep(0.1)
    began = time.monotonic()
    process.send_signal(number)
    assert process.wait(60) == 128 + number
    assert time.monotonic() - began < 5.0
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_that_a_library_turns_into_an_error_of_its_own_is_still_one(number: signal.Signals) -> None:
    code = (
        "import os, sys\n"
        "from fmopt.runtime import process\n"
        "from fmopt.cli import entry\n"
        "from fmopt.errors import ResourceError\n"
        "def imported():\n"
        "    try:\n"
        "        os.kill(os.getpid(), int(sys.argv[1]))\n"
        "    except BaseException:\n"
        "        error = ImportError('no such library')\n"
        "    raise ResourceError('it needs an extra') from error\n"
        "entry.app = imported\n"
        "process.run(entry.command)\n"
    )
    command = [sys.executable, "-c", code, str(int(number))]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, preexec_fn=as_a_shell_starts)
    assert (done.returncode, done.stderr) == (128 + number, "interrupted\n")


def test_signals_that_who_started_it_ignores_are_ignored() -> None:
    code = "from fmopt.runtime import process; process.run(lambda: os.kill(os.getpid(), signal.SIGHUP) or 7)"
    code = f"import os, signal; {code}"
    line = f"trap '' HUP; exec '{sys.executable}' -c '{code}'"
    assert subprocess.run(["bash", "-c", line], timeout=60, check=False).returncode == 7


def test_a_child_ends_with_its_parent_however_that_ends(tmp_path: Path) -> None:
    code = (
        "import os, signal, time\n"
        "from fmopt.runtime.pool import Worker\n"
        "workers = [Worker() for _ in range(2)]\n"
        "time.sleep(0.5)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    mark = f"child-{tmp_path.name}"
    environment = {**os.environ, "FMOPT_TEST": mark}
    done = subprocess.run([sys.executable, "-c", code], env=environment, timeout=60, check=False)
    assert done.returncode == -signal.SIGKILL
    began = time.monotonic()
    while alive(mark) and time.monotonic() - began < SOON:
        time.sleep(0.01)
    assert alive(mark) == []
