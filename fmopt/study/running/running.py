"""The running of a study: batches to an executor, rows to the store, until none is left or the user has enough."""

import math
import signal
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from fmopt.runtime import output
from fmopt.runtime.process import cores
from fmopt.study.running.batch import Batch, Evaluate, Limits, Loss, Returned, Run, laid_out
from fmopt.study.running.cluster import Hosts, cluster
from fmopt.study.running.program import program
from fmopt.study.running.store import Effort, Numbered, Row, Store, owned
from fmopt.study.running.workers import Local, run_batch

ATTEMPTS = 3  # times that a run is tried whose worker or host is killed from outside
BATCH_SECONDS = 0.5  # of work in a batch; about what a kill of the owner costs each of its workers
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


Progress = Callable[[Tally], None]


@dataclass(frozen=True)
class Options:
    """How to run.

    `jobs` are processes, or batches under way on a cluster, None for as many as there are processors; at most `limit`
    rows are written; `cluster` is the address of a Dask scheduler, None for processes on this machine.
    """

    jobs: int | None = None
    limit: int | None = None
    retry_failed: bool = False
    cluster: str | None = None


def run(
    work: Work,
    folder: Path,
    evaluate: Evaluate,
    options: Options,
    progress: Progress = lambda _: None,
    store_of: Callable[[Path], Store] = Store,
) -> Tally:
    """Does all runs that have no row yet, and writes their rows.

    Raises:
        ResourceError: the folder is owned by another, or cannot be written; workers cannot be started, or are all lost.
    """
    output.prepare(folder)
    with hands(options) as (executor, count), owned(folder), store_of(folder) as store, _stoppable() as heard:
        pairs = enumerate(zip(work.runs, work.points, strict=True))
        store.design((Numbered(number, one.key, point) for number, (one, point) in pairs), work.facts)
        # A copy: what changes meanwhile in files that are named by relative paths gets into no run.
        home = laid_out(work.inputs, folder / "inputs") if options.cluster is None else None
        form = Batch((), evaluate, work.limits, {}, home)
        if home is None:  # a host elsewhere has neither the inputs nor, perhaps, this program
            form = replace(form, inputs=work.inputs, program=program())
        return _Desk(work.runs, store, form, count, options, progress).served(executor, heard)


@contextmanager
def hands(options: Options) -> Iterator[tuple[Executor, int]]:
    """Where batches go, and how many are under way at a time.

    Raises:
        ResourceError: the cluster cannot be had.
    """
    if options.cluster is None:
        count = options.jobs or cores()
        with Local(count) as local:
            yield local, count
    else:
        with cluster(options.cluster) as (hosts, threads):
            yield hosts, options.jobs or threads


@contextmanager
def _stoppable() -> Iterator[list[int]]:
    """SIGINT and SIGTERM as they come: they end the study after what is under way has been put away."""
    heard: list[int] = []
    if threading.current_thread() is not threading.main_thread():  # no other thread may set handlers
        yield heard
        return
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.signal(number, lambda sent, _: heard.append(sent)) for number in numbers}
    try:
        yield heard
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _Desk:
    """Where batches go out and rows come in; the only writer of the store."""

    def __init__(
        self, listed: Sequence[Run], store: Store, form: Batch, jobs: int, options: Options, progress: Progress
    ) -> None:
        self._store, self._form, self._jobs, self._progress = store, form, jobs, progress
        runs = {run.key: run for run in listed}
        outcomes = store.outcomes()
        self._failed = {key for key in runs if outcomes.get(key, "done") != "done"}
        again = self._failed if options.retry_failed else set()
        waiting = [run for key, run in runs.items() if key not in outcomes or key in again]
        self._waiting = deque(waiting[: options.limit])
        self._had = {key for key in runs if key in outcomes}
        self._total, self._asked, self._fresh = len(runs), len(self._waiting), 0
        self._losses = Counter[str]()
        self._mean_seconds, self._size = math.inf, 0  # of a run, the newest batch with the weight of all before
        self._began = time.perf_counter()

    def served(self, executor: Executor, heard: Sequence[int]) -> Tally:
        """Keeps the executor busy until nothing waits, or until a signal is heard."""
        under_way: dict[Future[Returned], Batch] = {}
        self._progress(self._tally())
        while (self._waiting or under_way) and not heard:
            # No more than can be done at once: how long a batch is follows from the times of those before it.
            while self._waiting and len(under_way) < self._jobs:
                batch = self._next()
                under_way[executor.submit(run_batch, batch)] = batch
            finished, _ = wait(under_way, _BEAT, FIRST_COMPLETED)
            # Before results are taken: who has lost its scheduler has futures cancelled, which no run is to blame for.
            if isinstance(executor, Hosts):
                executor.watch()
            for future in finished:
                self._take(under_way.pop(future), future)
            self._progress(self._tally())
        if heard:
            for future in under_way:
                future.cancel()
            # Its workers are killed, and its threads hand back the rows that they have; other hosts are not waited for.
            if isinstance(executor, Local):
                executor.shutdown()
            for future in under_way:
                if future.done() and not future.cancelled() and future.exception() is None:
                    self._add(future.result().rows)
        return replace(self._tally(), interrupted=heard[0] if heard else 0)

    def _next(self) -> Batch:
        """The next batch: as many runs as make half a second, but no more than leave work for the others."""
        # Alone after a loss, so that the run that takes its host down is found out; and as long as no times are known.
        size = 1
        if self._waiting[0].key not in self._losses:
            wanted = math.ceil(BATCH_SECONDS / self._mean_seconds) if self._mean_seconds > 0.0 else _LONGEST
            self._size = max(1, min(wanted, _GROWTH * self._size, _LONGEST))
            size = min(self._size, math.ceil(len(self._waiting) / self._jobs))
        return replace(self._form, runs=tuple([self._waiting.popleft() for _ in range(size)]))

    def _take(self, batch: Batch, future: Future[Returned]) -> None:
        """Writes what came of a batch; what is left of it waits again, but for what was lost too often."""
        error = future.exception() if not future.cancelled() else CancelledError()
        if error is None:
            returned = future.result()
            left = batch.runs[len(returned.rows) :]
            loss, lost = returned.loss, left[:1]
        elif isinstance(error, CancelledError) or type(error).__name__ == "KilledWorker":
            # Dask's error goes by its name, as the library need not be there.
            loss, returned = Loss("killed", "its host was lost", 0.0), Returned(())
            left = lost = batch.runs
        else:
            raise error
        rows = list(returned.rows)
        if loss is not None:
            self._losses.update(run.key for run in lost)
            reason = f"{loss.reason}, {ATTEMPTS} times" if loss.outcome == "killed" else loss.reason
            given_up = [run for run in lost if loss.outcome != "killed" or self._losses[run.key] == ATTEMPTS]
            rows += [(Row(run.key, loss.outcome, reason, {}), Effort(loss.seconds, 0)) for run in given_up]
            left = tuple(run for run in left if run not in given_up)
        self._waiting.extendleft(reversed(left))  # to the front, in the order of the design
        self._add(rows)

    def _add(self, rows: Sequence[tuple[Row, Effort]]) -> None:
        if rows:
            self._store.add(rows)
            self._fresh += len(rows)
            for row, _ in rows:
                self._had.add(row.key)
                (self._failed.discard if row.outcome == "done" else self._failed.add)(row.key)
            mean = math.fsum(effort.seconds for _, effort in rows) / len(rows)
            self._mean_seconds = mean if math.isinf(self._mean_seconds) else 0.5 * (self._mean_seconds + mean)

    def _tally(self) -> Tally:
        seconds = time.perf_counter() - self._began
        return Tally(self._total, len(self._had), len(self._failed), self._fresh, seconds, self._asked)
