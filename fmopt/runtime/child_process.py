"""Processes of our own that live no longer than we do.

A child is a fresh interpreter that runs a function of this package with a connection to its parent. The kernel kills it
when the thread that started it ends (Linux); a thread of its own does when the pipe that the parent holds is closed,
however the parent ended (anywhere). What users type at a terminal goes to the parent alone.
"""

import ctypes
import importlib
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from contextlib import suppress
from multiprocessing.connection import Connection

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
    """A process of the calling thread; `last_words` is the last line that it wrote, once it has ended.

    Raises:
        ResourceError: no process can be made.
    """

    def __init__(self, entry: str, *arguments: str) -> None:
        near, far = socket.socketpair()
        watched, held = os.pipe()
        self._life, self.last_words = os.fdopen(held, "wb"), ""
        # No pipe: nobody reads it as long as the process runs, and a full one would hold it up.
        self._output = tempfile.TemporaryFile()  # noqa: SIM115 (open as long as the process lives)
        given = (str(far.fileno()), str(watched), str(os.getpid()), entry, *arguments)
        try:
            self.process = subprocess.Popen(
                # Where this process looks for modules, which a program may have changed since it began.
                [sys.executable, "-c", _CODE, json.dumps(sys.path), *given],
                stdin=subprocess.DEVNULL,
                stdout=self._output,
                stderr=self._output,
                pass_fds=(far.fileno(), watched),
                process_group=0,
                env={**os.environ, **dict.fromkeys(_ONE_THREAD, "1")},
            )
        except OSError as error:
            for opened in (near, self._life, self._output):
                opened.close()
            raise ResourceError(f"no process can be started: {error.strerror}", "free memory") from error
        finally:  # while these are open here as well, nobody notices that the other end is closed
            far.close()
            os.close(watched)
        self.connection = Connection(near.detach())

    def end(self, gone: bool = False) -> int:
        """Ends the process and returns its code; its own one if it has `gone` already."""
        if gone:
            with suppress(subprocess.TimeoutExpired):
                self.process.wait(FAREWELL)
        self.process.kill()
        code = self.process.wait()
        if not self._output.closed:
            self._output.seek(0)
            lines = self._output.read()[-2000:].decode(errors="replace").split("\n")
            self.last_words = next((line for line in reversed(lines) if line.strip()), "")
        for opened in (self.connection, self._life, self._output):
            opened.close()
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
