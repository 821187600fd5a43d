"""The inside of the process that reads a STEP file: the CAD kernel, which may break down or go on for ever.

It answers in JSON on what was its standard output, and ends with its owner.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import sys
import threading
from typing import Any

from fmopt.errors import GeometryError

MEMORY = 4 << 30  # bytes of address space
SECONDS = 60  # of the processor
_PR_SET_PDEATHSIG = 1


def main(arguments: list[str]) -> None:
    """Answers {"bodies": [{"name", "place", and of those that were asked for "points", "triangles", …}, …]}.

    Or {"message", "advice"} where the file cannot be used.

    Args:
        arguments: the STEP file, how far facets may lie from curved faces in mm, the body that is asked for (its
            name or number, "" for the only one, "*" for all), the descriptor of a pipe that is closed when the owner
            ends, and the owner's process.
    """
    path, deviation, which, life, owner = arguments
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the owner to answer
    _die_with(int(owner), int(life))
    _limit()
    answer = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # the kernel is talkative
    json.dump(_read(path, float(deviation), which), answer)
    answer.close()
    os._exit(0)  # what the kernel holds of a damaged file is not worth taking apart


def _read(path: str, deviation: float, which: str) -> dict[str, Any]:
    from fmopt.geometry.step.step_file import COARSER, SIMPLER

    try:
        from OCP import Standard
    except ImportError as error:
        return {"kernel": str(error)}
    # Not all versions of the kernel derive its errors from Standard_Failure.
    known = [kind for kind in vars(Standard).values() if isinstance(kind, type) and issubclass(kind, Exception)]
    failures: tuple[type[Exception], ...] = (*known, RuntimeError)
    try:
        return {"bodies": _bodies(path, deviation, which)}
    except GeometryError as error:
        return {"message": error.message, "advice": error.advice}
    except MemoryError:
        return {"message": f"the CAD kernel needs more than {MEMORY >> 30} GiB for it", "advice": SIMPLER}
    except failures as error:
        told = " ".join(str(error).split())[:200]
        message = f"the CAD kernel gives up on it: {type(error).__name__} {told}"
        return {"message": message, "advice": f"export it again, or {COARSER}"}


def _bodies(path: str, deviation: float, which: str) -> list[dict[str, Any]]:
    from fmopt.geometry.body_names import chosen
    from fmopt.geometry.step.facets import facets_of
    from fmopt.geometry.step.step_file import solids, whole

    found = solids(path)
    wanted = range(len(found)) if which == "*" else [chosen([body.name for body in found], which)]
    told: list[dict[str, Any]] = [{"name": body.name, "place": body.place.tolist()} for body in found]
    for number in wanted:
        try:
            told[number] |= facets_of(whole(found[number].solid), deviation)
        except GeometryError as error:
            where = f"body {found[number].name or number + 1}: " if len(found) > 1 else ""
            raise GeometryError(f"{where}{error.message}", error.advice) from error
    return told


def _limit() -> None:
    """Limits memory and processor time where the system can."""
    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        # The soft limit ends it by SIGXCPU, by which the owner knows that it was time.
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 5))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # no image of its memory on the disk


def _die_with(owner: int, life: int) -> None:
    """Makes this process end with its owner."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL))
    # The owner may have ended before the signal was asked for.
    if os.getppid() != owner:
        os._exit(0)

    # For systems without such a signal: reading comes to an end when the owner, however it ends, lets go of the pipe.
    def watch() -> None:
        os.read(life, 1)
        os._exit(0)

    threading.Thread(target=watch, daemon=True).start()
