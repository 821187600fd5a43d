"""Processes that do one task after the other, for trials, studies and compiling, and tell results as they come.

A task is a function that can be pickled, importable by name; it is called with the function that tells a result.
"""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from enum import Enum
from itertools import islice
from multiprocessing.connection import Connection, wait
from typing import Any

from fmopt.errors import FmoptError, ResourceError
from fmopt.runtime.child_process import Child

Task = Callable[[Callable[[Any], None]], object]
_IDLE_SECONDS = 60.0  # after which a worker ends by itself: on other hosts nobody dismisses it
_ENTRY = "fmopt.runtime.pool:serve"


class Mark(Enum):
    """What a worker says between results: a task has begun, or is done; the process has ended; nothing came in time."""

    BEGUN, DONE, ENDED, LATE = range(4)


class Worker:
    """A worker of the calling thread, its address space limited to `memory`, bytes, unless that is 0.

    Raises:
        ResourceError: no process can be made.
    """

    def __init__(self, memory: int = 0) -> None:
        self.memory, self._child = memory, Child(_ENTRY, str(memory))
        self.connection, self.kill = self._child.connection, self._child.process.kill

    def give(self, task: Task) -> None:
        """Hand over a task; a process that has ended says so in `next`."""
        try:
            self.connection.send(task)
        except OSError:
            return

    def next(self, seconds: float | None = None) -> Any:
        """The next result or mark; a FmoptError that a task raised is a result, any other one ends the process."""
        try:
            return self.connection.recv() if self.connection.poll(seconds) else Mark.LATE
        except (EOFError, OSError):
            return Mark.ENDED

    def end(self, gone: bool = False) -> tuple[int, str]:
        """End the process, which may have `gone` already: its return code, and the last line that it wrote."""
        return self._child.end(gone), self._child.last_words


def share_out(tasks: Sequence[Task], count: int, take: Callable[[Any], None]) -> None:
    """Do tasks in `count` processes, or in this one where there is one of either, and take their results as they come.

    Raises:
        ResourceError: no process can be started, or one has ended.
        FmoptError: what a task raises.
    """
    if count == 1 or len(tasks) < 2:
        for task in tasks:
            task(take)
        return
    waiting, busy = iter(tasks), dict[Any, Worker]()
    with ExitStack() as stack:
        for task in islice(waiting, count):
            worker = Worker()
            stack.callback(worker.end)
            worker.give(task)
            busy[worker.connection] = worker
        while busy:
            for connection in wait(list(busy)):
                match busy[connection].next():
                    case Mark.BEGUN:
                        continue
                    case Mark.DONE if following := next(waiting, None):
                        busy[connection].give(following)
                    case Mark.DONE:
                        del busy[connection]
                    case Mark.ENDED:
                        code, last = busy[connection].end(gone=True)
                        how = f"signal {-code}" if code < 0 else f"exit code {code}: {last}"
                        advice = "free memory or use fewer workers, and run it again"
                        raise ResourceError(f"a worker ended by {how}", advice)
                    case FmoptError() as error:
                        raise error
                    case result:
                        take(result)


def serve(connection: Connection, memory: str) -> None:
    """The inside of a worker."""
    if int(memory):
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (int(memory), int(memory)))
    while connection.poll(_IDLE_SECONDS):
        try:
            task = connection.recv()
        except EOFError:
            return
        # Receiving a task imports what does it, which counts as starting up: time limits begin here.
        connection.send(Mark.BEGUN)
        try:
            task(connection.send)
        except FmoptError as error:
            connection.send(error)
        connection.send(Mark.DONE)
