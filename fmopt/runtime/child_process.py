"""Processes of our own that live no longer than we do.

A child is a fresh interpreter that runs a function of this package with a connection to its parent. The kernel kills it
when the thread that started it ends (Linux); a thread of its own does when the pipe that the parent holds is closed,
however the parent ended (anywhere). What users type at a terminal goes to the parent alone.
"""

from __future__ import annotations

import ctypes
import importlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import IO

from fmopt.errors import ResourceError

FAREWELL = 5.0  # s that a process may take to end once its connection is closed
# Children are mostly as many as cores: threads of libraries would only wait for each other.
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS", "RAYON_NUM_THREADS")
_CODE = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from fmopt.runtime.child_process import main; main(sys.argv[2:])"
)
_PR_SET_PDEATHSIG = 1


class Child:
    """A process of the calling thread, whose output goes to the file `said` or to this one's standard error.

    Raises:
        ResourceError: no process can be made.
    """

    def __init__(self, entry: str, *arguments: str, said: IO[bytes] | None = None) -> None:
        near, far = socket.socketpair()
        watched, held = os.pipe()
        self._life = os.fdopen(held, "wb")
        given = (str(far.fileno()), str(watched), str(os.getpid()), entry, *arguments)
        try:
            self.process = subprocess.Popen(
                # Where this process looks for modules, which a program may have changed since it began.
                [sys.executable, "-c", _CODE, json.dumps(sys.path), *given],
                stdin=subprocess.DEVNULL,
                # What a library prints does not get into what the parent does.
                stdout=subprocess.DEVNULL if said is None else said,
                stderr=said,
                pass_fds=(far.fileno(), watched),
                process_group=0,
                env={**os.environ, **dict.fromkeys(_ONE_THREAD, "1")},
            )
        except OSError as error:
            near.close()
            self._life.close()
            raise ResourceError(f"no process can be started: {error.strerror}", "free memory") from error
        finally:  # while these are open here as well, nobody notices that the other end is closed
            far.close()
            os.close(watched)
        self.connection = Connection(near.detach())

    def end(self, gone: bool = False) -> int:
        """Ends the process and says how it ended, as a return code; its own way if it has `gone` already."""
        if gone:
            with suppress(subprocess.TimeoutExpired):
                self.process.wait(FAREWELL)
        self.process.kill()
        code = self.process.wait()
        self.connection.close()
        self._life.close()
        return code


def main(arguments: list[str]) -> None:
    """The inside of a child.

    Its arguments are descriptors of the connection and of the pipe that says whether the parent lives, the parent's
    process, what to run, and what else that is given.
    """
    line, life, parent, entry, *given = arguments
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent to answer
    _die_with(int(parent), int(life))
    module, function = entry.split(":")
    getattr(importlib.import_module(module), function)(Connection(int(line)), *given)


def _die_with(parent: int, life: int) -> None:
    """Makes this process end with its parent; if that is gone already, now."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL))
    if os.getppid() != parent:  # it may have ended before the kernel was asked
        os._exit(0)

    def watch() -> None:
        os.read(life, 1)  # nobody writes: it returns once the end of the parent is closed
        os.kill(os.getpid(), signal.SIGKILL)

    threading.Thread(target=watch, daemon=True).start()
