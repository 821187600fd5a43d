"""The process as others see it: its three streams, the signals that end it, its exit code.

Streams. Whatever is closed at the start is taken by /dev/null, the wrong way round, so that no file that is opened
later gets its number, and reading or writing fails as it would. What standard output does not take is a failure of its
own; when its reader has gone, the process ends without a word, as others do. What standard error does not take is lost.

Signals. SIGINT, SIGTERM and SIGHUP are raised as `Interruption` where the program is, once: what is under way is put
away on the way out. When the program does not come to that within a second, since it is inside a library, the process
leaves from another thread: all that is finished is on disk anyhow. A library may make an error of its own of what is
raised inside it, as some do while they are imported; `interrupted` tells such errors from others.
"""

import gc
import io
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from types import FrameType
from typing import Any, NoReturn

from fmopt.errors import Interruption, ResourceError
from fmopt.runtime import output

_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_DEAF = 1.0  # s that the program has to come to a signal
_LEAVING = 3.0  # s that it has to put away what is under way
_heard = threading.Event()
_THREADS = "OPENBLAS_NUM_THREADS"
_ALLOCATIONS = 100_000  # objects made before cycles among them are looked for; with Python's 700 a tenth of the time
_raised: list[int] = []  # number of the signal that was raised, if one was


def run(command: Callable[[], int]) -> NoReturn:
    """Runs a command whose result is the exit code of this process, which ends with it."""
    # Read when NumPy is loaded: matrices are small, and threads that wait for each other take three times as long.
    os.environ.setdefault(_THREADS, "1")
    gc.set_threshold(_ALLOCATIONS, 20, 20)
    _open_streams()  # first: the pipe for signals would get the number of a closed stream
    try:
        _answer_signals()
        code = command()
        sys.stdout.flush()  # inside: a reader that has gone is noticed by the last lines at the latest
    except Interruption as interruption:
        code = 128 + interruption.number
        if interruption.number == signal.SIGPIPE:
            _end_by(signal.SIGPIPE)
        print("; ".join(["interrupted", *getattr(interruption, "__notes__", ())]), file=sys.stderr)
    for number in _ENDING:
        signal.signal(number, signal.SIG_IGN)  # nothing is left to be put away
    gc.collect()  # manifold3d tells of each solid that is left, as where an error refers to it
    gc.freeze()  # the rest goes back with the process; looking through it twice more takes a third of a second
    sys.exit(code)


def _end_by(number: signal.Signals) -> NoReturn:
    """Ends as a process does that does not answer a signal."""
    signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)
    os._exit(128 + number)  # where the signal is blocked


class _Stream(io.FileIO):
    """Standard output (1) or error (2). Once it takes nothing more, the rest is thrown away."""

    def __init__(self, number: int) -> None:
        super().__init__(number, "w", closefd=False)  # a number that were closed would go to the next file
        self._gone = False

    def write(self, content: Any, /) -> int:
        """Writes bytes.

        Raises:
            Interruption: nobody reads standard output any more.
            ResourceError: standard output takes nothing more.
        """
        if self._gone:
            return memoryview(content).nbytes  # as if taken: of less the buffer would offer the rest again
        try:
            return super().write(content)
        except OSError as error:
            self._gone = True  # before it is raised: what is left in the buffer is offered again at the exit
            if self.fileno() == 2:
                return memoryview(content).nbytes
            if isinstance(error, BrokenPipeError):
                raise Interruption(signal.SIGPIPE) from None
            raise ResourceError(f"standard output: {error.strerror}", "free the disk, or write elsewhere") from error


def _open_streams() -> None:
    for number, way in enumerate((os.O_WRONLY, os.O_RDONLY, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, way), True)  # it gets the lowest number that is free: this one
    if sys.stdin is None:  # as Python leaves it where it was closed
        sys.stdin = open(0, encoding="utf-8", closefd=False)  # noqa: SIM115 (as long as the process lives)
    sys.stdout, sys.stderr = _text(1, sys.stdout), _text(2, sys.stderr)


def _text(number: int, before: Any) -> io.TextIOWrapper:
    """A stream of text in the encoding of the one before; what that does not have is written as an escape code."""
    encoding = "utf-8" if before is None else before.encoding
    raw = _Stream(number)
    return io.TextIOWrapper(io.BufferedWriter(raw), encoding, "backslashreplace", line_buffering=raw.isatty())


def _answer_signals() -> None:
    """Takes the signals that end a process, but for those that who started it had ignored."""
    if threading.current_thread() is not threading.main_thread():  # no other thread may answer signals
        return
    near, far = os.pipe()
    os.set_blocking(far, False)
    # Inside a library no line of Python runs to answer a signal, but its number is written at once.
    signal.set_wakeup_fd(far, warn_on_full_buffer=False)
    for number in _ENDING:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)
    sys.unraisablehook = _lost
    threading.Thread(target=_watch, args=(near,), daemon=True).start()


def _interrupt(number: int, frame: FrameType | None) -> None:
    if not _heard.is_set():
        _raised.append(number)
        _heard.set()
        raise Interruption(number)


def interrupted() -> None:
    """Asked where an error ends a command: the signal that was raised before, whatever a library has made of it.

    Raises:
        Interruption: the signal.
    """
    if _raised:
        raise Interruption(_raised[0])


def _watch(near: int) -> None:
    """Leaves when a signal has come and the program has not; who answers signals in its own way is let alone."""
    while number := os.read(near, 1)[0]:
        if signal.getsignal(number) is _interrupt:
            if _heard.wait(_DEAF):
                time.sleep(_LEAVING)
            _leave(number)


def _leave(number: int) -> NoReturn:
    output.abandon()
    os._exit(128 + number)  # sys.exit would end this thread alone, and leave the program where it is


def _lost(unraisable: Any) -> None:
    """An interruption that came where nothing can be raised, as in a destructor, ends the process all the same."""
    if isinstance(unraisable.exc_value, Interruption):
        _leave(unraisable.exc_value.number)
    sys.__unraisablehook__(unraisable)


def cores() -> int:
    """Cores that this process may use, which are fewer than the machine has under taskset or in a container."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
