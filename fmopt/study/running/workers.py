"""Runs in worker processes, which a run may break down or hold up; each belongs to the thread that gives it runs."""

from __future__ import annotations

import math
import resource
import signal
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from fmopt.errors import ResourceError
from fmopt.runtime.pool import Mark, Worker
from fmopt.study.running.batch import Batch, Evaluate, Loss, Returned, Run, laid_out
from fmopt.study.running.program import program
from fmopt.study.running.store import Effort, Row

_START_UP = 120.0  # s
_MAX_STARTS = 10  # workers that may end before they begin
_OUTSIDE = {signal.SIGKILL, signal.SIGTERM, signal.SIGHUP}  # what others send
_WORKERS: dict[int | None, Worker] = {}  # by thread


class Local(ThreadPoolExecutor):
    """Threads with a worker process each, which end with this executor."""

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Ends the workers, too; what they are at is called off."""
        super().shutdown(wait=False, cancel_futures=True)
        # Again and again, as a thread may be starting another worker just now.
        while any(thread.is_alive() for thread in self._threads):
            for worker in [_WORKERS[thread.ident] for thread in self._threads if thread.ident in _WORKERS]:
                worker.kill()
            time.sleep(0.01)
        for thread in self._threads:
            _end(thread.ident)


def run_batch(batch: Batch) -> Returned:
    """Do the runs of a batch, as far as a worker of this thread comes; the one task that any executor is given.

    Raises:
        ResourceError: workers do not start, or the inputs cannot be laid out.
    """
    if batch.program not in ("", program()):
        message = f"a worker runs fmopt {program()}, the study {batch.program}"
        raise ResourceError(message, "install the same version, and the same libraries, everywhere")
    folder = batch.folder if batch.folder is not None else laid_out(batch.inputs, None)
    worker = _begun(partial(evaluated, batch.evaluate, folder, batch.runs), batch.limits.memory or 0)
    rows: list[tuple[Row, Effort]] = []
    began = time.perf_counter()
    while not isinstance(item := worker.next(batch.limits.seconds), Mark):
        rows.append(item)
        began = time.perf_counter()
    spent = bool(rows) and rows[-1][0].outcome == "memory"
    if item is Mark.DONE and not spent:
        return Returned(tuple(rows))
    code, _ = _end(threading.get_ident(), item is Mark.ENDED)
    return Returned(tuple(rows), None if spent else _loss(batch, item, code, time.perf_counter() - began))


def _loss(batch: Batch, item: Mark, code: int, seconds: float) -> Loss:
    if item is Mark.LATE:
        return Loss("timeout", f"not done in {batch.limits.seconds:g} s", seconds)
    if code >= 0:
        return Loss("crash", f"the worker ended with exit code {code}", seconds)
    name = signal.Signals(-code).name
    if -code in _OUTSIDE:
        return Loss("killed", f"the worker was killed by {name}", seconds)
    return Loss("crash", f"the worker died of {name}", seconds)


def _begun(task: Any, memory: int) -> Worker:
    """The worker of this thread, once it has begun a task."""
    thread, last = threading.get_ident(), ""
    for _ in range(_MAX_STARTS):
        # A process that has lowered its limit of memory may not raise it again.
        if thread in _WORKERS and _WORKERS[thread].memory != memory:
            _end(thread)
        if thread not in _WORKERS:
            _WORKERS[thread] = Worker(memory)
        _WORKERS[thread].give(task)
        if _WORKERS[thread].next(_START_UP) is Mark.BEGUN:
            return _WORKERS[thread]
        _, last = _end(thread, gone=True)  # it was idle for too long, was killed, or has too little memory to start
    raise ResourceError(f"workers end before they begin: {last}", "raise the study's memory limit, if any")


def _end(thread: int | None, gone: bool = False) -> tuple[int, str]:
    return _WORKERS.pop(thread).end(gone) if thread in _WORKERS else (0, "")


def evaluated(evaluate: Evaluate, folder: Path, runs: Sequence[Run], tell: Callable[[Any], None]) -> None:
    """Evaluate runs and tell each row, until one runs out of memory: then the process is not to be trusted."""
    for run in runs:
        began = time.perf_counter()
        row = _row(evaluate, run, folder)
        peak = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # KiB on Linux
        tell((row, Effort(time.perf_counter() - began, peak)))
        if row.outcome == "memory":
            break


def _row(evaluate: Evaluate, run: Run, folder: Path) -> Row:
    """The row of a run, whatever happens to it that a program can see."""
    try:
        row = evaluate(run, folder)
    except MemoryError:
        return Row(run.key, "memory", "out of memory", {})
    except Exception as error:  # noqa: BLE001 (the last door of a worker: what one run breaks is that run's row)
        words = " ".join(str(error).replace(str(folder) + "/", "").split())
        return Row(run.key, "error", f"{type(error).__name__}: {words}"[:500], {})
    strange = [name for name, x in row.answers.items() if isinstance(x, float) and not math.isfinite(x)]
    return Row(run.key, "error", f"not a finite number: {', '.join(strange)}", {}) if strange else row
