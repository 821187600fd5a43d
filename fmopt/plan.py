"""The plan file `fmopt.plan/1`: one self-contained JSON document, where makers and users of plans meet.

All values are SI. Same input, same machine, same bytes: keys are sorted, numbers are the shortest that read back
exactly, and the document ends with a digest of itself.
"""

from __future__ import annotations

import hashlib
import json
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fmopt.errors import PlanFormatError, ResourceError

FORMAT = "fmopt.plan/1"
STDIO = Path("-")  # standard input or output, in place of a file
UNITS = {"length": "m", "angle": "rad", "force": "N", "torque": "N m", "time": "s"}
FRAMES = {
    "B": "body frame of the fixed hollow feature: origin at the centre of its mouth, z out of the hole",
    "moving": "origin at the centre of the leading face of the moving feature, z back into the part",
    "pose": "(x, y, z, r): origin of the moving frame in B, and the rotation vector r",
    "error": "(e, eps) about a nominal pose (p, R): the real pose is p + e, exp([eps]x) R",
    "wrench": "(force, torque about the moving frame's origin), in axes of B",
}
NOT_COVERED = (
    "friction, jamming and wedging beyond the choice of bias wrenches",
    "compliance and dynamics of the robot: that held contacts stay held under the bias wrench",
    "shape and size deviations of the parts other than those in the stated errors",
    "whether the real errors lie in the stated set, each fixed in the frame that is stated of it, apart from the "
    "velocity error",
)


def canonical(document: Mapping[str, Any]) -> str:
    """The document as canonical JSON text: sorted keys, no spaces, no special numbers.

    Raises:
        PlanFormatError: a number is not finite.
    """
    try:
        return json.dumps(
            document, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False, check_circular=False
        )
    except ValueError as error:
        raise PlanFormatError(f"the plan holds a number that JSON cannot: {error}") from error


def digest(document: Mapping[str, Any]) -> str:
    """SHA-256 (hex) of the canonical text without the key `sha256`."""
    bare = {key: value for key, value in document.items() if key != "sha256"}
    return hashlib.sha256(canonical(bare).encode()).hexdigest()


def sealed(document: Mapping[str, Any]) -> dict[str, Any]:
    """The document with its digest."""
    return {**document, "sha256": digest(document)}


def clean(value: Any) -> Any:
    """Numbers, arrays and tuples as plain JSON values; minus zero becomes zero."""
    if value is None or isinstance(value, (str, int)):
        return value
    if isinstance(value, (list, tuple)):
        return [item + 0.0 if type(item) is float else clean(item) for item in value]
    if hasattr(value, "tolist"):
        return clean(value.tolist())
    if isinstance(value, Mapping):
        return {key: item + 0.0 if type(item) is float else clean(item) for key, item in value.items()}
    return value + 0.0 if isinstance(value, float) else value


def prepare(folder: Path) -> None:
    """Makes a folder for results, before the work is done that would go there.

    Raises:
        ResourceError: it cannot be made or written to.
    """
    probe = folder / ".fmopt"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise ResourceError(f"{folder}: {error.strerror or error}", "choose another folder with --out") from error


def write(document: Mapping[str, Any], path: Path) -> None:
    """Writes a plan, whole or not at all: to a file beside it first, then over it.

    Raises:
        ResourceError: the file cannot be written.
    """
    text = json.dumps(document, sort_keys=True, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    save(text.encode(), path)


def save(content: bytes, path: Path) -> None:
    """Writes a file, whole or not at all.

    Raises:
        ResourceError: the file cannot be written.
    """
    partial = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial.write_bytes(content)
        partial.replace(path)
    except OSError as error:
        raise ResourceError(f"{path}: {error.strerror or error}", "choose another folder with --out") from error


def read(path: Path) -> dict[str, Any]:
    """Reads a plan file, "-" for standard input.

    Raises:
        ResourceError: the file cannot be read.
        PlanFormatError: it is no plan of this format.
    """
    try:
        text = sys.stdin.read() if path == STDIO else path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise PlanFormatError(f"{path}: not UTF-8 text", "a plan is a JSON file that fmopt wrote") from error
    except OSError as error:
        raise ResourceError(f"{path}: {error.strerror or error}", "give the plan.json of a solved problem") from error
    try:
        document = json.loads(text, parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        raise PlanFormatError(f"{path}: no JSON document: {error}", "a plan is a JSON file that fmopt wrote") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        found = document.get("format") if isinstance(document, dict) else type(document).__name__
        raise PlanFormatError(f"{path}: format {found!r} is not {FORMAT!r}", "solve the problem with this version")
    return document


def _refuse(name: str) -> float:
    raise ValueError(f"{name} is no number of a plan")


def rounded_down(value: float) -> float:
    """A little less than `value`: what may be stated of a margin that was computed in floating point."""
    return value - 1e-15 - 1e-12 * abs(value) if math.isfinite(value) else 1.0
