"""The command called as by hands that close streams, fill disks and send signals; what holds of every call."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from tests import ROOT

PROBLEM = ROOT / "problems" / "square_peg.toml"
STUDY = ROOT / "problems" / "studies" / "square_peg_clearance.toml"
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
BROKEN = ("full", "closed", "left", "said nowhere", "deaf")


@dataclass
class Calls:
    """What came of calls."""

    counts: Counter[str] = field(default_factory=Counter)  # of each kind of call
    wrong: list[str] = field(default_factory=list)  # what did not hold, in words
    slowest: float = 0.0  # longest time from a signal to the end, s
    orphans: float = 0.0  # longest time that a worker outlived its parent, s


def called(plan: Path, folder: Path, calls: int, seed: int, patience: float = 0.0) -> Calls:
    """Calls commands again and again: half of them with a broken stream, half of them with a signal.

    The plan is certified, the folder empty. One signal in four waits for something to be kept first, `patience` s.
    """
    chance, found = random.Random(seed), Calls()
    for number in range(calls):
        if number % 2:
            _interrupted(plan, folder, chance, found, patience)
        else:
            _broken(plan, chance, found)
    return found


def started(arguments: list[str], mark: str, **streams: object) -> subprocess.Popen[bytes]:
    """The command as a process of its own, whose children bear the mark in their environment."""
    return subprocess.Popen(
        [sys.executable, "-m", "fmopt", *arguments],
        env={**os.environ, "FMOPT_TEST": mark},
        preexec_fn=as_a_shell_starts,
        **{"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **streams},  # type: ignore[arg-type]
    )


def as_a_shell_starts() -> None:
    """Signals that who runs the tests may ignore are answered again."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def alive(mark: str) -> list[int]:
    """Processes that bear a mark."""
    wanted, found = f"FMOPT_TEST={mark}".encode(), []
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and wanted in (entry / "environ").read_bytes().split(b"\0"):
                found.append(int(entry.name))
        except OSError:  # it has ended meanwhile
            continue
    return found


def _broken(plan: Path, chance: random.Random, found: Calls) -> None:
    """A command whose streams are not what they should be."""
    kind = chance.choice(BROKEN)
    reads = ["verify", "export"] if kind == "deaf" else ["verify", "export", "check", "schema", "--version", "--help"]
    name = chance.choice(reads)
    arguments = {
        "verify": ["verify", "-" if kind == "deaf" else str(plan)],
        "export": ["export", "-" if kind == "deaf" else str(plan), "--to", "csv", "--out", "-"],
        "check": ["check", "--json", str(PROBLEM)],
    }.get(name, [name])
    redirected = {
        "full": "> /dev/full",
        "closed": ">&-",
        "left": "| head -c 1 > /dev/null; exit ${PIPESTATUS[0]}",
        "said nowhere": "2>&-",
        "deaf": "<&-",
    }[kind]
    words = " ".join(f"'{word}'" for word in (sys.executable, "-m", "fmopt", *arguments))
    done = subprocess.run(["bash", "-c", f"{words} {redirected}"], capture_output=True, text=True, timeout=120)
    # A reader that leaves late leaves nothing undone.
    wanted = {"full": {4}, "closed": {4}, "left": {0, 141}, "said nowhere": {0}, "deaf": {4}}[kind]
    _judge(found, f"{kind} {name}", done.returncode, wanted, done.stderr)


def _interrupted(plan: Path, folder: Path, chance: random.Random, found: Calls, patience: float) -> None:
    """A command with a signal at a random time; what it had done is there, and it goes on."""
    name, number = chance.choice(("execute", "compare", "solve", "study")), chance.choice(SIGNALS)
    there = folder / name
    arguments = {
        "execute": ["execute", str(plan), "--trials", "20", "--workers", "2", "--out", str(there)],
        "compare": ["compare", str(plan), "--trials", "20", "--workers", "2", "--out", str(there)],
        "solve": ["solve", str(PROBLEM), "--out", str(there)],
        "study": ["study", str(STUDY), "--jobs", "2", "--out", str(there)],
    }[name]
    before = kept(there)
    mark = f"{os.getpid()}-{sum(found.counts.values())}"
    process = started(arguments, mark)
    _wait(there, chance, before, patience)
    sent = time.monotonic()
    ended = process.poll() is not None
    process.send_signal(number)
    _, said = process.communicate(timeout=120)
    found.slowest = max(found.slowest, time.monotonic() - sent)
    gone = time.monotonic()
    while alive(mark) and time.monotonic() - gone < 10.0:
        time.sleep(0.01)
    found.orphans = max(found.orphans, time.monotonic() - gone)
    wanted = {0, 3} if ended else {-9} if number == signal.SIGKILL else {128 + number, -number}
    _judge(
        found, f"{number.name} {name}", process.returncode, wanted | ({0} if name == "solve" else set()), said.decode()
    )
    if alive(mark):
        found.wrong.append(f"{number.name} {name}: a process is left")
    if not before <= kept(there):
        found.wrong.append(f"{number.name} {name}: something is lost")
    if number != signal.SIGKILL and list(there.rglob("*.part")):
        found.wrong.append(f"{number.name} {name}: something half-written is left")


def _wait(folder: Path, chance: random.Random, before: set[str], patience: float) -> None:
    """Some seconds; one time in four until something is kept that was not, if that comes soon."""
    if patience and chance.random() < 0.25:
        since = time.monotonic()
        while kept(folder) == before and time.monotonic() - since < patience:
            time.sleep(0.1)
    else:
        time.sleep(chance.uniform(0.2, 8.0))


def kept(folder: Path) -> set[str]:
    """What is kept of trials and studies, each whole: every line and every row reads back."""
    found = set()
    for file in folder.rglob("*.jsonl"):
        _, *records = [json.loads(line) for line in file.read_text().splitlines()]
        found |= {f"{file.name} {json.dumps(record, sort_keys=True)}" for record in records}
    if (folder / "study.sqlite").is_file():
        from fmopt.study.running.store import recorded

        found |= {repr(one.row) for one in recorded(folder)[1] if one.row is not None}
    return found


def _judge(found: Calls, what: str, code: int, wanted: set[int], said: str) -> None:
    found.counts[what] += 1
    if code not in wanted:
        found.wrong.append(f"{what}: exit code {code}, not {wanted}: {said[-500:]}")
    if "Traceback" in said or "Exception ignored" in said:
        found.wrong.append(f"{what}: {said[-800:]}")
