"""The running of a study: batches to an executor, rows to the store, until none is left or the user has enough."""

import math
import signal
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType

from fmopt.runtime import output
from fmopt.study.running.batch import Batch, Evaluate, Limits, Returned, Run, laid_out
from fmopt.study.running.program import program
from fmopt.study.running.store import Effort, Numbered, Row, Store, owned
from fmopt.study.running.workers import ATTEMPTS, Local, run_batch

BATCH_SECONDS = 0.5  # s of work in a batch; about what a kill of the owner costs each of its workers
_GROWTH = 4  # times that a batch may be longer than the one before
_LONGEST = 10_000  # runs of a batch, however short they are
_BEAT = 0.5  # s between looks at the clock and at Ctrl-C


@dataclass(frozen=True, eq=False)
class Work:
    """What there is to do: `runs` of the design, in order; those with the same key are the same."""

    runs: Sequence[Run]
    points: Sequence[Mapping[str, str | float | int | bool | None]]
    facts: Mapping[str, str]
    inputs: Mapping[str, bytes]
    limits: Limits


@dataclass(frozen=True)
class Tally:
    """How far a study is; only what is durable counts. `interrupted` is the signal that ended it, or 0."""

    total: int
    done: int
    failed: int
    fresh: int = 0
    seconds: float = 0.0
    asked: int = 0
    interrupted: int = 0

    @property
    def rate(self) -> float:
        """Runs a second since this start."""
        return self.fresh / self.seconds if self.seconds > 0.0 else 0.0

    @property
    def left(self) -> float:
        """Seconds that the rest will take at this rate; infinite as long as there is none."""
        return (self.asked - self.fresh) / self.rate if self.rate > 0.0 else math.inf


@dataclass(frozen=True)
class Options:
    """How to run.

    At most `limit` rows are written. Batches go to the executor, to be shut down by the caller; processes on this
    machine if None.
    """

    jobs: int
    limit: int | None = None
    retry_failed: bool = False
    executor: Executor | None = None


def run(
    work: Work,
    folder: Path,
    evaluate: Evaluate,
    options: Options,
    progress: Callable[[Tally], None] = lambda _: None,
    store_of: Callable[[Path], Store] = Store,
) -> Tally:
    """Does all runs that have no row yet, and writes their rows.

    Raises:
        ResourceError: the folder is owned by another, or cannot be written; workers cannot be started, or are all lost.
    """
    output.prepare(folder)
    with owned(folder), store_of(folder) as store:
        pairs = enumerate(zip(work.runs, work.points, strict=True))
        store.design((Numbered(number, one.key, point) for number, (one, point) in pairs), work.facts)
        # A copy: what changes meanwhile in files that are named by relative paths gets into no run.
        home = laid_out(work.inputs, folder / "inputs") if options.executor is None else None
        form = Batch((), evaluate, work.limits, {}, home)
        if home is None:  # a host elsewhere has neither the inputs nor, perhaps, this program
            form = replace(form, inputs=work.inputs, program=program())
        desk = _Desk(work.runs, store, form, options, progress)
        with _stoppable() as stop:
            if options.executor is not None:
                return desk.served(options.executor, stop)
            with Local(options.jobs) as local:
                return desk.served(local, stop)


class _Stop:
    """The signal that asked for an end, or 0."""

    def __init__(self) -> None:
        self.signal = 0

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self.signal = number


@contextmanager
def _stoppable() -> Iterator[_Stop]:
    """Ctrl-C and SIGTERM end the study after what is under way has been put away, and so does a second one."""
    stop = _Stop()
    if threading.current_thread() is not threading.main_thread():  # no other thread may set handlers
        yield stop
        return
    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class Remote(Executor, ABC):
    """An executor on other hosts, which may go away for good."""

    @abstractmethod
    def watch(self) -> None:
        """Looks after the hosts; asked often.

        Raises:
            ResourceError: nobody is left to do the work.
        """


class _Desk:
    """Where batches go out and rows come in; the only writer of the store."""

    def __init__(
        self, listed: Sequence[Run], store: Store, form: Batch, options: Options, progress: Callable[[Tally], None]
    ) -> None:
        self._store, self._form, self._options, self._progress = store, form, options, progress
        runs = {run.key: run for run in listed}
        outcomes = store.outcomes()
        self._failed = {key for key in runs if outcomes.get(key, "done") != "done"}
        again = self._failed if options.retry_failed else set()
        waiting = [run for key, run in runs.items() if key not in outcomes or key in again]
        self._waiting = deque(waiting[: options.limit])
        self._had = {key for key in runs if key in outcomes}
        self._total, self._asked, self._fresh = len(runs), len(self._waiting), 0
        self._deaths: dict[str, int] = {}
        self._pace = _Pace()
        self._began = time.perf_counter()

    def served(self, executor: Executor, stop: _Stop) -> Tally:
        """Keeps the executor busy until nothing waits, or until stopped."""
        under_way: dict[Future[Returned], Batch] = {}
        self._progress(self._tally())
        while (self._waiting or under_way) and not stop.signal:
            # No more than can be done at once: how long a batch is follows from the times of those before it.
            while self._waiting and len(under_way) < self._options.jobs:
                batch = self._next()
                under_way[executor.submit(run_batch, batch)] = batch
            finished, _ = wait(under_way, _BEAT, FIRST_COMPLETED)
            # Before results are taken: who has lost its scheduler has futures cancelled, which no run is to blame for.
            if isinstance(executor, Remote):
                executor.watch()
            for future in finished:
                self._take(under_way.pop(future), future)
            self._progress(self._tally())
        if stop.signal:
            for future in under_way:
                future.cancel()
            # Its workers are killed, and its threads hand back the rows that they have; other hosts are not waited for.
            if isinstance(executor, Local):
                executor.shutdown()
            for future, batch in under_way.items():
                if future.done() and not future.cancelled():
                    self._take(batch, future)
        return replace(self._tally(), interrupted=stop.signal)

    def _next(self) -> Batch:
        """The next batch: as many runs as make half a second, but no more than leave work for the others."""
        first = self._waiting[0].key
        share = math.ceil(len(self._waiting) / self._options.jobs)
        # Alone after a loss, so that the run that takes its host down is found out.
        size = 1 if first in self._deaths else min(self._pace.size(), share)
        return replace(self._form, runs=tuple([self._waiting.popleft() for _ in range(size)]))

    def _take(self, batch: Batch, future: Future[Returned]) -> None:
        """Writes what came of a batch; what is left of it waits again."""
        error = future.exception() if not future.cancelled() else CancelledError()
        if error is None:
            returned = future.result()
        elif isinstance(error, CancelledError) or type(error).__name__ == "KilledWorker":
            # Dask's error goes by its name, as the library need not be there.
            returned = self._lost(batch)
        else:
            raise error
        self._waiting.extendleft(reversed(returned.left))  # to the front, in the order of the design
        if returned.rows:
            self._store.add(returned.rows)
            self._fresh += len(returned.rows)
            for row, _ in returned.rows:
                self._had.add(row.key)
                (self._failed.discard if row.outcome == "done" else self._failed.add)(row.key)
            self._pace.note(returned.rows)

    def _lost(self, batch: Batch) -> Returned:
        """What becomes of a batch whose whole host was lost: its runs are tried alone, and at last given up."""
        rows, left = [], []
        for run in batch.runs:
            self._deaths[run.key] = self._deaths.get(run.key, 0) + 1
            if self._deaths[run.key] < ATTEMPTS:
                left.append(run)
            else:
                row = Row(run.key, "killed", f"its host was lost {ATTEMPTS} times", {})
                rows.append((row, Effort(0.0, 0)))
        return Returned(tuple(rows), tuple(left))

    def _tally(self) -> Tally:
        seconds = time.perf_counter() - self._began
        return Tally(self._total, len(self._had), len(self._failed), self._fresh, seconds, self._asked)


class _Pace:
    """How many runs make a batch: half a second of them, as long as the last ones took."""

    def __init__(self) -> None:
        self._mean = math.inf
        self._last = 0

    def size(self) -> int:
        """Runs of the next batch."""
        # As long as no times are known the mean is infinite, and the batch is one run.
        wanted = math.ceil(BATCH_SECONDS / self._mean) if self._mean > 0.0 else _LONGEST
        self._last = max(1, min(wanted, _GROWTH * self._last, _LONGEST))
        return self._last

    def note(self, rows: Sequence[tuple[Row, Effort]]) -> None:
        """Takes the times of a batch in, the newest with the weight of all before."""
        mean = math.fsum(effort.seconds for _, effort in rows) / len(rows)
        self._mean = mean if math.isinf(self._mean) else 0.5 * (self._mean + mean)
