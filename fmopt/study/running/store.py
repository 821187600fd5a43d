"""Results on disk, each acknowledged only when it is durable: SQLite with a write-ahead log, one writer.

A transaction holds the results of one batch. The log is synchronised before `add` returns (`synchronous = FULL`), so
that what it took is there after a kill and after a power cut; what it did not take leaves no trace.

One owner of a folder at a time: a lock on a file with its process, which the kernel drops when the owner dies.
"""

from __future__ import annotations

import fcntl
import json
import os
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from fmopt.errors import InputError, ResourceError
from fmopt.runtime.output import synchronise
from fmopt.task.toml.source import Place

NAME = "study.sqlite"
FORMAT = "fmopt.study/1"
Outcome = Literal["done", "input", "error", "crash", "timeout", "memory", "killed"]
Scalar = str | float | int | bool | None

# Results go by key and not by number: they outlive a change of the design, and equal runs share one.
_TABLES = """
CREATE TABLE IF NOT EXISTS facts (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS runs (number INTEGER PRIMARY KEY, key TEXT NOT NULL, point TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS results
    (key TEXT PRIMARY KEY, outcome TEXT NOT NULL, reason TEXT NOT NULL, answers TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS kept (key TEXT PRIMARY KEY, content BLOB NOT NULL);
CREATE TABLE IF NOT EXISTS effort (key TEXT PRIMARY KEY, seconds REAL NOT NULL, peak INTEGER NOT NULL) WITHOUT ROWID;
"""


@dataclass(frozen=True)
class Row:
    """What came of a run."""

    key: str
    outcome: Outcome
    reason: str
    answers: Mapping[str, Scalar]
    kept: bytes = b""


@dataclass(frozen=True)
class Effort:
    """What a run took, another each time and so beside its row: seconds, and the worker's peak memory in bytes."""

    seconds: float
    peak: int


@dataclass(frozen=True)
class Numbered:
    """A run of the design as the store holds it: its number, key and named values on the axes."""

    number: int
    key: str
    point: Mapping[str, Scalar]


class Store:
    """The results of a study's folder, open for writing; the caller owns the folder.

    Raises:
        ResourceError: the file cannot be opened, written, or is damaged; so do all methods.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / NAME
        with translated(self._path):
            fresh = not self._path.exists()
            # Transactions begin and end where this class says; by itself the module begins some unasked.
            self._file = sqlite3.connect(self._path, isolation_level=None)
        try:
            with translated(self._path):
                self._file.execute("PRAGMA journal_mode = WAL")  # who reads meanwhile keeps no writer waiting
                self._file.execute("PRAGMA synchronous = FULL")
                self._file.executescript(_TABLES)
                self._file.execute("INSERT OR IGNORE INTO facts VALUES ('format', ?)", (FORMAT,))
                if fresh:
                    synchronise(folder)  # the names of its files stand there
            if (known := self.facts()["format"]) != FORMAT:
                message = f"{self._path} holds a study of format {known!r}, not {FORMAT!r}"
                raise ResourceError(message, "choose another folder with --out")
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *raised: object) -> None:
        with translated(self._path):
            self._file.close()

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        # The connection commits in the end, or rolls back where SQLite has not done so itself, as on a full disk.
        with translated(self._path), self._file:
            # A writer from the start: a transaction that becomes one halfway may be refused there.
            self._file.execute("BEGIN IMMEDIATE")
            yield self._file

    def facts(self) -> dict[str, str]:
        """What the store says of itself, by name."""
        with translated(self._path):
            return dict(self._file.execute("SELECT name, value FROM facts"))

    def design(self, runs: Iterable[Numbered], facts: Mapping[str, str]) -> None:
        """Replaces the runs of the design, and states facts with them, all at once; results stay."""
        with self._transaction() as file:
            file.execute("DELETE FROM runs")
            file.executemany("INSERT INTO runs VALUES (?, ?, ?)", ((r.number, r.key, _text(r.point)) for r in runs))
            file.executemany("INSERT OR REPLACE INTO facts VALUES (?, ?)", sorted(facts.items()))

    def outcomes(self) -> dict[str, str]:
        """The outcome of every run that has a row, by key."""
        with translated(self._path):
            return dict(self._file.execute("SELECT key, outcome FROM results"))

    def add(self, rows: Sequence[tuple[Row, Effort]]) -> None:
        """Takes rows, durably and all at once; a row that is done is never replaced, a failed one is."""
        with self._transaction() as file:
            for row, effort in rows:
                done = file.execute("SELECT 1 FROM results WHERE key = ? AND outcome = 'done'", (row.key,)).fetchone()
                if done is not None:
                    continue
                values = (row.key, row.outcome, row.reason, _text(row.answers))
                file.execute("INSERT OR REPLACE INTO results VALUES (?, ?, ?, ?)", values)
                file.execute("INSERT OR REPLACE INTO effort VALUES (?, ?, ?)", (row.key, effort.seconds, effort.peak))
                if row.kept:
                    file.execute("INSERT OR REPLACE INTO kept VALUES (?, ?)", (row.key, row.kept))


@dataclass(frozen=True)
class Recorded:
    """A run of the design with its row, or None when it has none yet."""

    run: Numbered
    row: Row | None


def recorded(folder: Path) -> tuple[dict[str, str], list[Recorded]]:
    """What a folder's store holds: its facts, and the runs of its design in their order, with their rows.

    Raises:
        InputError: there is no study in this folder.
        ResourceError: the store cannot be read.
    """
    query = (
        "SELECT number, runs.key, point, outcome, reason, answers FROM runs "
        "LEFT JOIN results ON results.key = runs.key ORDER BY number"
    )
    with _reading(folder) as file:
        facts = dict(file.execute("SELECT name, value FROM facts"))
        return facts, [_recorded(*record) for record in file.execute(query)]


def kept(folder: Path, key: str) -> bytes | None:
    """What the store keeps of a run beside its row."""
    with _reading(folder) as file:
        found = file.execute("SELECT content FROM kept WHERE key = ?", (key,)).fetchone()
        return None if found is None else bytes(found[0])


def efforts(folder: Path) -> dict[str, Effort]:
    """What the runs took, by key."""
    with _reading(folder) as file:
        return {key: Effort(seconds, peak) for key, seconds, peak in file.execute("SELECT * FROM effort")}


@contextmanager
def _reading(folder: Path) -> Iterator[sqlite3.Connection]:
    path = folder / NAME
    if not path.is_file():
        fault = Place(str(folder)).fault("no-study", "there is no study in this folder", "run fmopt study FILE first")
        raise InputError(fault)
    with translated(path):
        # Only a URI can say that nothing is to be written.
        file = sqlite3.connect(path.absolute().as_uri() + "?mode=ro", uri=True)
        try:
            yield file
        finally:
            file.close()


def _recorded(number: int, key: str, point: str, outcome: Outcome | None, reason: str, answers: str) -> Recorded:
    row = None if outcome is None else Row(key, outcome, reason, json.loads(answers))
    return Recorded(Numbered(number, key, json.loads(point)), row)


@contextmanager
def translated(path: Path) -> Iterator[None]:
    """Failures of SQLite, and of the disk under it, as errors of this package.

    Raises:
        ResourceError: for each of them.
    """
    try:
        yield
    except sqlite3.Error as error:
        advice = "free some disk and run the same command again; what was acknowledged is kept"
        raise ResourceError(f"{path}: {error}", advice) from error
    except OSError as error:
        raise ResourceError(f"{path}: {error.strerror or error}", "check the disk, then run it again") from error


def _text(values: Mapping[str, Scalar]) -> str:
    # NaN and infinity, which JSON lacks and Python writes all the same, were refused by `answered` before.
    return json.dumps(dict(values), separators=(",", ":"), ensure_ascii=False, allow_nan=False)


@contextmanager
def owned(folder: Path) -> Iterator[None]:
    """Holds a folder until the block ends.

    Raises:
        ResourceError: it is held already, by which process; or its lock cannot be written.
    """
    path = folder / "lock"
    # The file stays: if it went, one could hold the old one and another a new one of its name.
    with translated(path):
        file = path.open("a+b", buffering=0)  # a buffer would write again as it is closed
    with file:
        with translated(path):
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                file.seek(0)
                message = f"{folder}: process {file.read().decode()} runs a study in this folder"
                raise ResourceError(message, "wait for it, or choose another with --out") from None
            file.truncate(0)
            file.write(str(os.getpid()).encode())
        yield
