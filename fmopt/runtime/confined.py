"""Reading what others wrote, in a process of its own: with limits of memory and time, which may break down.

It ends with its owner, see `child_process`, and answers in JSON: nothing of its answer is executed.
"""

import importlib
import json
import signal
import sys
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from fmopt.errors import FmoptError, GeometryError, ResourceError
from fmopt.runtime.child_process import Child

MEMORY = 4 << 30  # bytes of address space
PROCESSOR_SECONDS = 60
SECONDS = 300.0  # by the clock; the process has less of the processor
_NEXT = "scipy.spatial"  # which every answer is worked on with: it is imported while the process reads


@dataclass(frozen=True)
class FileReader:
    """What reads files."""

    name: str
    entry: str  # "module:function" of texts, which returns what JSON has; its GeometryErrors are raised by `read`
    # simpler, again: advice where it takes too long or too much memory, and where it breaks down
    simpler: str
    again: str


def read(path: Path, reader: FileReader, *arguments: str) -> Any:
    """What a reader returns of a file, whose path is its first argument.

    Raises:
        GeometryError: it breaks down on the file, or takes more time or memory than there is for it.
        ResourceError: no process can be started, or it was ended from outside.
    """
    try:
        return _read(reader, str(path.resolve()), *arguments)
    except FmoptError as error:
        error.message = f"{path}: {error.message}"
        raise


def _read(reader: FileReader, *arguments: str) -> Any:
    child, gone = Child(f"{__name__}:work", reader.entry, *arguments), False
    try:
        importlib.import_module(_NEXT)
        if not child.connection.poll(SECONDS):
            raise GeometryError(f"{reader.name} has not read it in {SECONDS:g} s", reader.simpler)
        answer = json.loads(child.connection.recv_bytes())
    except (EOFError, ConnectionError):
        gone = True
    # Ctrl-C, too, ends it from here: the process does not listen to that itself.
    finally:
        code = child.end(gone)
    if gone:
        raise _ending(reader, code, child.last_words)
    if "message" in answer:
        raise GeometryError(answer["message"], answer["advice"])
    if "found" not in answer:
        raise GeometryError(f"{reader.name} needs more than {MEMORY >> 30} GiB for it", reader.simpler)
    return answer["found"]


def work(connection: Connection, entry: str, *arguments: str) -> None:
    """The inside of the process: answers {"found"}, {"message", "advice"} of an error, or {} where memory is short."""
    _limit()
    module, function = entry.split(":")
    try:
        answer = {"found": getattr(importlib.import_module(module), function)(*arguments)}
    except GeometryError as error:
        answer = {"message": error.message, "advice": error.advice}
    except MemoryError:
        answer = {}
    connection.send_bytes(json.dumps(answer).encode())


def _limit() -> None:
    """Limits memory and processor time where the system can."""
    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        # The soft limit ends it by SIGXCPU, by which the owner knows that it was time.
        resource.setrlimit(resource.RLIMIT_CPU, (PROCESSOR_SECONDS, PROCESSOR_SECONDS + 5))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # no image of its memory on the disk


def _ending(reader: FileReader, code: int, last: str) -> FmoptError:
    """The error of a process that did not answer."""
    if code >= 0:
        return FmoptError(f"the process that reads it ended with exit code {code}: {last}")
    name = signal.Signals(-code).name
    if -code in (signal.SIGKILL, signal.SIGTERM, signal.SIGHUP):  # what others send
        return ResourceError(f"the process that reads it was ended by {name}", "free memory, and try again")
    if -code == signal.SIGXCPU:
        return GeometryError(f"{reader.name} comes to no end with it", reader.simpler)
    return GeometryError(f"{reader.name} breaks down on it ({name})", reader.again)
