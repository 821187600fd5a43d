"""STEP files as the CAD kernel reads them, in a process that it may break down: see `runtime.confined`."""

import os
from typing import Any

from fmopt.errors import GeometryError
from fmopt.geometry.step import COARSER


def read(path: str, deviation: str, which: str) -> dict[str, Any]:
    """{"bodies": [{"name", "place", and of those that are asked for "points", "triangles", …}, …]}.

    Or {"kernel": why there is none that works}.

    The deviation is how far facets may lie from curved faces, mm; `which` is the body that is asked for, its name or
    number, "" for the only one, "*" for all.

    Raises:
        GeometryError: the file cannot be used.
    """
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # the kernel is talkative
    try:
        from OCP import Standard
    except ImportError as error:
        return {"kernel": str(error)}
    # Not all versions of the kernel derive its errors from Standard_Failure.
    known = [kind for kind in vars(Standard).values() if isinstance(kind, type) and issubclass(kind, Exception)]
    failures: tuple[type[Exception], ...] = (*known, RuntimeError)
    try:
        return {"bodies": _bodies(path, float(deviation), which)}
    except failures as error:
        if isinstance(error, GeometryError):
            raise
        told = " ".join(str(error).split())[:200]
        message = f"the CAD kernel gives up on it: {type(error).__name__} {told}"
        raise GeometryError(message, f"export it again, or {COARSER}") from error


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
