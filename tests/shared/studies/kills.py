"""A study killed again and again, at random moments, in random parts; what a study may never lose.

python study_kills.py KILLS SEED, to do it at length.
"""

import json
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from tests import ROOT

RUNS = 600
JOBS = 2
LONGEST_BATCH = 125  # runs of 4 ms in half a second
_DRIVER = "tests.shared.studies.driver"


class LostError(AssertionError):
    """A study lost, doubled or tore something."""


@dataclass
class Kills:
    """What has happened so far."""

    # Kills by what was killed
    counts: dict[str, int] = field(default_factory=lambda: {"parent": 0, "worker": 0, "group": 0})
    studies: int = 0  # studies that were brought to their end
    begun: int = 0  # evaluations that were begun
    needed: int = 0  # evaluations that were needed
    orphans: float = 0.0  # longest time that a worker outlived its parent, s

    @property
    def total(self) -> int:
        return sum(self.counts.values())


def killed(base: Path, kills: int, seed: int, store: str = "store") -> Kills:
    """Kills studies in an empty folder as often as wanted, bringing one after the other to its end.

    Raises:
        LostError: what was acknowledged is not there, or not once, or the final table is another one.
    """
    chance, found = random.Random(seed), Kills()
    undisturbed = base / "undisturbed"
    _finished(undisturbed, "store")
    wanted = _table(undisturbed, "store")
    while found.total < kills:
        folder = base / f"study{found.studies}"
        while not _killed_once(folder, chance, found, store) and found.total < kills:
            _intact(folder, store)
        _finished(folder, store)
        _intact(folder, store)
        if _table(folder, store) != wanted:
            raise LostError("the final table is another one")
        found.studies += 1
        found.needed += RUNS
        found.begun += len((folder / "begun").read_text().splitlines())
        shutil.rmtree(folder)
    return found


def _command(folder: Path, store: str) -> list[str]:
    return [sys.executable, "-m", _DRIVER, str(folder), str(RUNS), str(JOBS), "noted", store]


def _finished(folder: Path, store: str) -> None:
    done = subprocess.run(_command(folder, store), cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)
    if done.returncode or not done.stdout.startswith(f"{RUNS} of {RUNS}, 0 failed"):
        raise LostError(f"a study does not resume: {done.stdout}{done.stderr}")


def _killed_once(folder: Path, chance: random.Random, found: Kills, store: str) -> bool:
    """Starts, or resumes, a study and kills its workers, and at last all of it; whether it came to its end before."""
    late = chance.random() > 0.1
    with subprocess.Popen(
        _command(folder, store), cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    ) as study:
        begun = folder / "begun"
        before = begun.stat().st_size if begun.exists() else 0
        # Now and then while it starts; mostly once it is at work, however long a busy machine takes to start it.
        while late and study.poll() is None and not (begun.exists() and begun.stat().st_size > before):
            time.sleep(0.01)
        while True:
            time.sleep(chance.uniform(0.02, 0.5))
            if study.poll() is not None:
                return True
            workers = _children(study.pid)
            victim = chance.choice(["parent", "worker", "worker", "group"])
            if victim == "worker" and workers:
                _kill(chance.choice(workers))
            elif victim == "parent":
                _kill(study.pid)
            elif victim == "group":
                os.killpg(study.pid, signal.SIGKILL)
            else:
                continue
            found.counts[victim] += 1
            if victim != "worker":
                study.wait()
                found.orphans = max(found.orphans, _outlived(workers))
                return False


def _kill(process: int) -> None:
    try:
        os.kill(process, signal.SIGKILL)
    except ProcessLookupError:
        return  # it has just ended by itself


def _children(process: int) -> list[int]:
    """Children of a process, whichever of its threads made them."""
    found: list[int] = []
    try:
        for task in Path(f"/proc/{process}/task").iterdir():
            found += [int(child) for child in (task / "children").read_text().split()]
    except (FileNotFoundError, ProcessLookupError):
        return []
    return found


def _outlived(workers: list[int]) -> float:
    """How long workers live on without their parent, s."""
    began = time.monotonic()
    while any(_alive(worker) for worker in workers):
        if time.monotonic() - began > 10.0:
            raise LostError("a worker outlives its parent")
        time.sleep(0.005)
    return time.monotonic() - began


def _alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] not in "ZX"
    except (FileNotFoundError, ProcessLookupError):
        return False


def _rows(folder: Path, store: str) -> dict[str, tuple[str, ...]]:
    """What the store holds, read without its program."""
    if store == "naive":
        path = folder / "results.jsonl"
        try:
            rows = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
        except ValueError as error:
            raise LostError(f"torn: {error}") from error
        return {row["key"]: (row["outcome"], row["reason"], json.dumps(row["answers"])) for row in rows}
    if not (folder / "study.sqlite").exists():
        return {}
    with closing(sqlite3.connect(folder / "study.sqlite")) as file:
        if file.execute("PRAGMA integrity_check").fetchall() != [("ok",)]:
            raise LostError("torn")
        if not file.execute("SELECT count(*) FROM sqlite_master WHERE name = 'results'").fetchone()[0]:
            return {}
        records = file.execute("SELECT key, outcome, reason, answers FROM results").fetchall()
    return {key: (outcome, reason, json.dumps(json.loads(answers))) for key, outcome, reason, answers in records}


def _intact(folder: Path, store: str) -> None:
    """What was acknowledged is there, once."""
    path = folder / "acknowledged"
    told = path.read_text().split() if path.exists() else []
    rows = _rows(folder, store)
    lost = [key for key in told if key not in rows]
    if lost:
        raise LostError(f"{len(lost)} acknowledged runs are lost")
    done = [key for key in told if rows[key][0] == "done"]
    if len(done) != len(set(done)) and all(rows[key][0] == "done" for key in told):
        raise LostError("a run was done twice")


def _table(folder: Path, store: str) -> bytes:
    """The final table, byte by byte."""
    return json.dumps(sorted(_rows(folder, store).items())).encode()


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        began = time.monotonic()
        result = killed(Path(scratch), int(sys.argv[1]), int(sys.argv[2]))
        again = result.begun - result.needed
        print(f"{result.total} kills {result.counts} over {result.studies} studies in {time.monotonic() - began:.0f} s")
        print(f"{again} of {result.needed} runs begun again, {again / result.total:.2f} a kill")
        print(f"no worker outlived its parent by more than {1e3 * result.orphans:.0f} ms")
