"""Chunks of trials on all cores: processes that are given one chunk after the other, and end with who gives them."""

import pickle
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection, wait
from typing import Any

from fmopt.errors import FmoptError, ResourceError
from fmopt.runtime.child_process import Child

_ENTRY = "fmopt.execution.workers:serve"
Take = Callable[[list[Any]], None]
Run = Callable[[Sequence[int], Take], object]
"""What is done with the numbers of a chunk, told records as they come: picklable, its function importable by name."""


def spread(run: Run, chunks: Sequence[Sequence[int]], workers: int, take: Take) -> None:
    """Runs chunks, in this process where there is one worker, or one chunk.

    Raises:
        ResourceError: no process can be started, or one was killed.
        FmoptError: what `run` raises.
    """
    if workers == 1 or len(chunks) < 2:
        for chunk in chunks:
            run(chunk, take)
        return
    waiting, busy = list(reversed(chunks)), dict[Any, Child]()  # popped from the end: they go out in order
    children: list[Child] = []
    try:
        for _ in range(min(workers, len(chunks))):
            child = Child(_ENTRY)
            # Before anything is sent: whatever fails from here on, it is to be ended.
            children.append(child)
            child.connection.send_bytes(pickle.dumps((run, waiting.pop())))
            busy[child.connection] = child
        while busy:
            for connection in wait(list(busy)):
                records = _received(busy[connection])
                if records:
                    take(records)
                elif waiting:
                    busy[connection].connection.send_bytes(pickle.dumps((run, waiting.pop())))
                else:
                    del busy[connection]
    finally:
        for child in children:
            child.end()


def _received(child: Child) -> list[Any]:
    """Records of trials that have just ended; none where the chunk has."""
    try:
        found = pickle.loads(child.connection.recv_bytes())
    except (EOFError, OSError) as error:
        code = child.end(gone=True)
        words = f"was killed by signal {-code}" if code < 0 else f"ended with exit code {code}"
        advice = "free memory or lower --workers, and run it again to go on"
        raise ResourceError(f"a process that ran trials {words}", advice) from error
    if isinstance(found, FmoptError):
        raise found
    return list(found)


def serve(connection: Connection) -> None:
    """The inside of a process: it answers every chunk until nobody asks any more."""
    while True:
        try:
            run, chunk = pickle.loads(connection.recv_bytes())
        except EOFError:
            return
        # An empty list says that the chunk has ended: records that are told are never none, see `_attempt`.
        last: FmoptError | list[Any] = []
        try:
            run(chunk, lambda records: connection.send_bytes(pickle.dumps(records)))
        # Any other error ends this process, with its traceback, and the parent tells the exit code.
        except FmoptError as error:
            last = error
        connection.send_bytes(pickle.dumps(last))
