"""Cheap evaluations for tests of the running of studies; workers import them by name."""

import hashlib
import os
import signal
import time
from pathlib import Path

from fmopt.study.running.batch import Limits, Run, StudyContext
from fmopt.study.running.running import Work
from fmopt.study.running.store import Row

BEGUN = "STUDY_TEST_BEGUN"
QUESTION = StudyContext("problem.toml", ("test",))


def number_of(run: Run) -> int:
    value = run.assigned[0][1]
    assert isinstance(value, int)
    return value


def quick(run: Run, folder: Path) -> Row:
    """A few numbers that depend on nothing but the run."""
    n = number_of(run)
    return Row(run.key, "done", "", {"square": n * n, "root": n**0.5, "word": f"run {n}", "even": n % 2 == 0})


def slow(run: Run, folder: Path) -> Row:
    """The same after a hundredth of a second."""
    time.sleep(0.01)
    return quick(run, folder)


def busy(run: Run, folder: Path) -> Row:
    """The same after 20 ms of work on one processor."""
    began = time.thread_time()
    while time.thread_time() - began < 0.02:
        sum(range(1000))
    return quick(run, folder)


def noted(run: Run, folder: Path) -> Row:
    """The same after it was written down that the run has begun."""
    begun = os.open(os.environ[BEGUN], os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    os.write(begun, f"{run.key}\n".encode())
    os.close(begun)
    time.sleep(0.004)
    return quick(run, folder)


def mixed(run: Run, folder: Path) -> Row:
    """Every tenth run crashes, hangs, eats memory or raises, in turn."""
    n = number_of(run)
    if n % 10 == 3:
        match n // 10 % 5:
            case 0:
                os.kill(os.getpid(), signal.SIGSEGV)
            case 1:
                time.sleep(3600)
            case 2:
                _ = bytearray(1 << 40)
            case 3:
                os._exit(7)
            case 4:
                raise ValueError(f"{folder}/x.toml: nothing\nfits")
    return quick(run, folder)


def hungry(run: Run, folder: Path) -> Row:
    """The same beside 400 MB."""
    held = bytearray(400_000_000)
    row = quick(run, folder)
    return row if held[-1] == 0 else Row(run.key, "error", "memory is not zero", {})


def multiplied(run: Run, folder: Path) -> Row:
    """How many threads a process has once it has multiplied large matrices."""
    import numpy as np

    square = np.ones((600, 600))
    threads = len(os.listdir("/proc/self/task"))
    return Row(run.key, "done", "", {"sum": float((square @ square).sum()), "threads": threads})


def suicidal(run: Run, folder: Path) -> Row:
    """Killed from outside, as by a kernel that is out of memory; the first run only."""
    if number_of(run) == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return quick(run, folder)


def hostile(run: Run, folder: Path) -> Row:
    """The first run takes down the process that owns its worker."""
    if number_of(run) == 0:
        os.kill(os.getppid(), signal.SIGKILL)
        time.sleep(3600)
    return quick(run, folder)


def infinite(run: Run, folder: Path) -> Row:
    return Row(run.key, "done", "", {"x": float("inf")})


def waiting(run: Run, folder: Path) -> Row:
    time.sleep(3600)
    return quick(run, folder)


def work(count: int, limits: Limits | None = None) -> Work:
    """Runs that differ in one number."""
    runs = [Run(hashlib.sha256(f"run {n}".encode()).hexdigest(), ((("n",), n),), QUESTION) for n in range(count)]
    points = [{"n": n} for n in range(count)]
    return Work(runs, points, {"title": "test"}, {"problem.toml": b"title = 'none'\n"}, limits or Limits())
