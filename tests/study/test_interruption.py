"""Studies that are killed or whose disk fails: nothing acknowledged is lost, doubled or torn, and they resume.

A naive store would not pass.
"""

import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests import ROOT
from tests.shared.studies.kills import JOBS, LONGEST_BATCH, LostError, _intact, _table, killed

DRIVER = "tests.shared.studies.driver"
RUNS = 24
STEPS = {"open": 5, "write": 9, "fsync": 3, "rename": 1}  # one call in so many
EVERY = os.environ.get("STUDY_EVERY_CALL") == "1"  # all of them, which takes minutes


def study(folder: Path, *failing: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", DRIVER, str(folder), str(RUNS), "1", "quick", "store", *(str(x) for x in failing)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.wide
@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EIO], ids=["ENOSPC", "EIO"])
@pytest.mark.parametrize("kind", ["open", "write", "fsync", "rename"])
def test_a_failing_call_ends_the_study_in_one_line(tmp_path: Path, kind: str, code: int) -> None:
    whole = study(tmp_path / "whole", kind, code, 0)
    assert (whole.returncode, whole.stdout) == (0, f"{RUNS} of {RUNS}, 0 failed\n"), whole.stderr
    right = _table(tmp_path / "whole", "store")
    calls = int(whole.stderr)
    assert calls >= 1
    ends = {_failing(tmp_path / str(n), kind, code, n, right) for n in range(1, calls + 1, 1 if EVERY else STEPS[kind])}
    assert 4 in ends


def _failing(folder: Path, kind: str, code: int, number: int, wanted: bytes) -> int:
    """How a study ends whose call of this number fails; SQLite does without some of them."""
    done = study(folder, kind, code, number)
    assert done.returncode in (0, 4), done.stderr
    if done.returncode:
        assert (done.stdout, len(done.stderr.splitlines())) == ("", 1)
        assert str(folder) in done.stderr
        _intact(folder, "store")
        again = study(folder)
        assert (again.returncode, again.stdout) == (0, f"{RUNS} of {RUNS}, 0 failed\n"), again.stderr
    _intact(folder, "store")
    assert _table(folder, "store") == wanted
    shutil.rmtree(folder)
    return done.returncode


@pytest.mark.wide
def test_fifty_kills_lose_nothing(tmp_path: Path) -> None:
    found = killed(tmp_path, 50, 1)
    assert found.total >= 50
    assert min(found.counts.values()) >= 5
    assert (
        found.begun - found.needed
        <= LONGEST_BATCH * JOBS * (found.counts["parent"] + found.counts["group"]) + (found.counts["worker"])
    )


@pytest.mark.wide
def test_a_naive_store_is_found_out_within_fifty_kills(tmp_path: Path) -> None:
    with pytest.raises(LostError, match=r"torn|lost|does not resume"):
        killed(tmp_path, 50, 1, "naive")
