"""The inside of a worker process: it evaluates runs one after the other and answers each at once.

It lives and dies with its owner, see `fmopt.runtime.child_process`; a worker without work for a minute ends by itself.
"""

import math
import pickle
import resource
import time
from collections.abc import Iterable
from multiprocessing.connection import Connection
from pathlib import Path

from fmopt.study.running.batch import Evaluate, Run
from fmopt.study.running.store import Effort, Row

READY = b"ready"
BEGUN = b"begun"
LEAVING = b"leaving"
# Threads of a Dask host go on when a study is over, and nobody there dismisses their workers.
_IDLE = 60.0  # s


def serve(connection: Connection, memory: str) -> None:
    """Serves an owner until it goes, its address space limited to `memory`, bytes as a text, or "0"."""
    if int(memory):
        resource.setrlimit(resource.RLIMIT_AS, (int(memory), int(memory)))
    connection.send_bytes(READY)
    while connection.poll(_IDLE):
        try:
            message = connection.recv_bytes()
        except EOFError:
            return
        # This imports what evaluates, which counts as starting up: time limits of runs begin after BEGUN.
        evaluate, folder, runs = pickle.loads(message)
        connection.send_bytes(BEGUN)
        if not _served(connection, evaluate, folder, runs):
            connection.send_bytes(LEAVING)
            return


def _served(connection: Connection, evaluate: Evaluate, folder: Path, runs: Iterable[Run]) -> bool:
    """Answers every run, until one runs out of memory: what is left of a process then is not to be trusted."""
    for run in runs:
        began = time.perf_counter()
        row = answered(evaluate, run, folder)
        peak = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # KiB on Linux
        connection.send_bytes(pickle.dumps((row, Effort(time.perf_counter() - began, peak))))
        if row.outcome == "memory":
            return False
    return True


def answered(evaluate: Evaluate, run: Run, folder: Path) -> Row:
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
