"""What tests share: the plan of the square peg, solved once a session, however many workers there are."""

import contextlib
import fcntl
import io
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from fmopt import plan
from fmopt.runtime.ahead import compile_ahead
from fmopt.runtime.store import FOLDER
from tests import ROOT
from tests.shared.commands import Outcome, ended
from tests.shared.pages import browser

os.environ[FOLDER] = ""  # nothing that a test reads was read by another one

settings.register_profile("repeatable", derandomize=True)  # the same examples in every run
settings.load_profile("repeatable")

collect_ignore = (
    [] if browser.PATH else ["report/test_browser.py"]
)  # report/test_scripts.py checks its pages everywhere
if not (ROOT.parent / "shared" / "parts").is_dir():
    collect_ignore.append("geometry/test_shared_parts.py")


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compiles kernels side by side before workers begin, rather than in each of them."""
    if session.config.getoption("numprocesses", None):
        compile_ahead()


@pytest.fixture(scope="session", autouse=True)
def _session_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keeps fixtures of modules and of the session out of the folder where pytest was started."""
    with contextlib.chdir(tmp_path_factory.mktemp("session")):
        yield


@pytest.fixture(autouse=True)
def _test_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Starts each test in an empty folder: commands write to `out/` of the current one, and find there what is old."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """Runs a command of fmopt in this process, in a wide terminal without colours, with what comes in."""

    def run(*words: object, given: bytes = b"") -> Outcome:
        monkeypatch.setattr("sys.argv", ["fmopt", *map(str, words)])
        monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(given), encoding="utf-8"))
        for name, value in (("COLUMNS", "200"), ("NO_COLOR", "1")):
            monkeypatch.setenv(name, value)
        return ended(capfd)

    return run


@pytest.fixture(scope="session")
def square_peg_plan_file(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """The plan file of problems/square_peg.toml; the first worker that asks solves it, the others wait."""
    base = tmp_path_factory.getbasetemp()
    shared = base if worker_id == "master" else base.parent
    path = shared / "square_peg" / "plan.json"
    path.parent.mkdir(exist_ok=True)
    with (shared / "square_peg.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not path.exists():
            from fmopt.planning.pipeline import synthesise
            from fmopt.task.problem import load

            plan.write(synthesise(load(ROOT / "problems" / "square_peg.toml")).document, path)
    return path


@pytest.fixture(scope="session")
def square_peg_plan(square_peg_plan_file: Path) -> dict[str, Any]:
    """The plan of problems/square_peg.toml. It is shared: copy it before changing anything in it."""
    return plan.read_document(square_peg_plan_file)
