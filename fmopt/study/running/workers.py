"""The outside of worker processes: started, given runs, timed, and ended by the thread that owns each."""

from __future__ import annotations

import pickle
import signal
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from fmopt.errors import ResourceError
from fmopt.runtime.child_process import Child
from fmopt.study.running.batch import Batch, Evaluate, Limits, Returned, Run, laid_out
from fmopt.study.running.program import program
from fmopt.study.running.store import Effort, Outcome, Row
from fmopt.study.running.worker import BEGUN, LEAVING, READY

ATTEMPTS = 3  # times that a run is tried whose worker is killed from outside
_START_UP = 120.0  # s
_OUTSIDE = {signal.SIGKILL, signal.SIGTERM, signal.SIGHUP}  # what others send
_ENTRY = "fmopt.study.running.worker:serve"
_MINE = threading.local()
_TRIES = 10  # workers that may end before they begin


class Crew:
    """The workers of an executor's threads, so that it can end them."""

    def __init__(self) -> None:
        self._gate = threading.Lock()
        self._workers: set[Worker] = set()

    def enter(self, worker: Worker) -> None:
        """Takes a worker in."""
        with self._gate:
            self._workers.add(worker)

    def leave(self, worker: Worker) -> None:
        """Lets a worker go."""
        with self._gate:
            self._workers.discard(worker)

    def call_off(self) -> None:
        """Kills all workers; what they are at is left undone."""
        with self._gate:
            for worker in self._workers:
                # First, so that its thread does not take the end of the connection for a crash.
                worker.called_off = True
                worker.process.kill()

    def dismiss(self) -> None:
        """Ends all workers, once no thread uses them any more."""
        for worker in list(self._workers):  # `end` takes each out of the set
            worker.end()


class Worker:
    """A worker process of the calling thread.

    Raises:
        ResourceError: no process can be made.
    """

    def __init__(self, limits: Limits, crew: Crew) -> None:
        self.limits = limits
        self._crew = crew
        self.called_off = False
        self._new = True
        # No pipe: nobody reads it as long as the worker runs, and a full one would hold it up.
        self._said = tempfile.TemporaryFile()  # noqa: SIM115 (open as long as the process lives)
        self._child = Child(_ENTRY, str(limits.memory or 0), said=self._said)
        self.process, self.connection = self._child.process, self._child.connection
        crew.enter(self)

    def end(self, gone: bool = False) -> int:
        """Ends the process and says how it ended, as a return code; its own way if it has `gone` already."""
        self._crew.leave(self)
        code = self._child.end(gone)
        self._said.close()
        return code

    def done(self, evaluate: Evaluate, folder: Any, runs: Sequence[Run]) -> Iterator[tuple[Row, Effort] | Outcome]:
        """Rows of runs as they come; the last is a word when it did not: "timeout", or "crash" when the process ended.

        Nothing at all comes from a worker that did not begin.
        """
        if self._new and self._message(_START_UP) != READY:
            return
        self._new = False
        try:
            self.connection.send_bytes(pickle.dumps((evaluate, folder, tuple(runs))))
        except OSError:  # it has ended meanwhile, idle for too long or killed
            return
        if self._message(_START_UP) != BEGUN:
            return
        for _ in runs:
            message = self._message(self.limits.seconds)
            if message is None:
                yield "timeout"
                return
            if message == b"":
                yield "crash"
                return
            if message == LEAVING:
                return
            yield pickle.loads(message)

    def _message(self, seconds: float | None) -> bytes | None:
        """The next message; None when none came in time, nothing in it when the process is gone."""
        try:
            return self.connection.recv_bytes() if self.connection.poll(seconds) else None
        except (EOFError, OSError):
            return b""

    def last_words(self) -> str:
        """The last line that the process wrote."""
        self._said.seek(0)
        lines = self._said.read()[-2000:].decode(errors="replace").split("\n")
        return next((line for line in reversed(lines) if line.strip()), "it said nothing")


class Local(ThreadPoolExecutor):
    """Worker processes on this machine, one for each thread of this executor."""

    def __init__(self, jobs: int) -> None:
        self._crew = Crew()
        super().__init__(jobs, "study", _joined, (self._crew,))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Ends the workers, too; what they are at is called off."""
        super().shutdown(wait=False, cancel_futures=True)
        # Again and again, as a thread may be starting another worker just now.
        while any(thread.is_alive() for thread in self._threads):
            self._crew.call_off()
            time.sleep(0.01)
        super().shutdown(wait, cancel_futures=cancel_futures)
        self._crew.dismiss()


def _joined(crew: Crew) -> None:
    _MINE.crew = crew


def run_batch(batch: Batch) -> Returned:
    """Does the runs of a batch in a worker process of this thread; the one task that any executor is given.

    A run that takes too long, or takes its worker down, becomes a row, and another worker goes on with the next. One
    whose worker is killed from outside is tried again first.

    Raises:
        ResourceError: workers do not start, or the inputs cannot be laid out.
    """
    if batch.program not in ("", program()):
        message = f"a worker runs fmopt {program()}, the study {batch.program}"
        raise ResourceError(message, "install the same version, and the same libraries, everywhere")
    folder = batch.folder if batch.folder is not None else laid_out(batch.inputs, None)
    rows: list[tuple[Row, Effort]] = []
    deaths = false_starts = 0
    while len(rows) < len(batch.runs):
        worker, before, began = _own(batch.limits), len(rows), time.perf_counter()
        word: Outcome | None = None
        for item in worker.done(batch.evaluate, folder, batch.runs[len(rows) :]):
            if isinstance(item, tuple):
                rows.append(item)
                deaths, began = 0, time.perf_counter()
            else:
                word = item
        # A worker whose last run ran out of memory is leaving, and is not used again.
        if word is None and len(rows) == len(batch.runs) and rows[-1][0].outcome != "memory":
            break
        false_starts = false_starts + 1 if word is None and len(rows) == before else 0
        # Before it is released, which closes the file of what it said.
        said = worker.last_words() if false_starts == _TRIES else ""
        code = _released(worker, word == "crash")
        if worker.called_off:
            return Returned(tuple(rows), batch.runs[len(rows) :])
        if said:
            raise ResourceError(f"workers end before they begin: {said}", "raise the study's memory limit, if any")
        killed = word == "crash" and -code in _OUTSIDE
        deaths += killed
        if word is not None and (not killed or deaths == ATTEMPTS):
            run, reason = batch.runs[len(rows)], _reason(word, code, batch.limits)
            row = Row(run.key, "killed" if killed else word, reason, {})
            rows.append((row, Effort(time.perf_counter() - began, 0)))
            deaths = 0
    return Returned(tuple(rows))


def _reason(word: str, code: int, limits: Limits) -> str:
    if word == "timeout":
        return f"not done in {limits.seconds:g} s"
    if code >= 0:
        return f"the worker ended with exit code {code}"
    name = signal.Signals(-code).name
    return f"the worker was killed {ATTEMPTS} times by {name}" if -code in _OUTSIDE else f"the worker died of {name}"


def _own(limits: Limits) -> Worker:
    """The worker of this thread."""
    worker: Worker | None = getattr(_MINE, "worker", None)
    # A process that has lowered its limit of memory may not raise it again.
    if worker is not None and worker.limits != limits:
        _released(worker, False)
        worker = None
    if worker is None:
        worker = _MINE.worker = Worker(limits, getattr(_MINE, "crew", _NO_CREW))
    return worker


def _released(worker: Worker, gone: bool) -> int:
    """Ends the worker of this thread; see `Worker.end`."""
    _MINE.worker = None
    return worker.end(gone)


_NO_CREW = Crew()  # of threads that belong to no executor of ours
