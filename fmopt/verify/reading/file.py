"""A plan file as JSON: reading it, with bounds, and its seal.

What is the same in every plan file: the format's name, its units and frames, and what no plan covers.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

LARGEST_FILE = 1 << 26  # bytes

FORMAT = "fmopt.plan/1"
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
NOT_COVERED_OFF_FORM = (
    *NOT_COVERED,
    "where more contacts hold than determine the pose of parts that are off their form: those of the basis are taken "
    "to touch",
)
FIXED_IN = ("hole", "hand", "world")  # of errors, in the order of their generators
VERDICTS = ("CERTIFIED", "NOT_PROVED", "REFUTED")

Numbers = tuple[float, ...]


def load(path: str | Path) -> dict[str, Any]:
    """Reads a plan file, "-" for standard input; special numbers and repeated keys are refused.

    Raises:
        PlanError: the file cannot be read, is too large, or is no JSON object.
    """
    try:
        return decoded(content(path))
    except OSError as error:
        raise PlanError("", f"cannot be read: {error}") from error


def content(path: str | Path) -> bytes:
    """The bytes of a file, "-" for standard input, and no more than show that it is too large.

    Raises:
        OSError: it cannot be read.
    """
    if str(path) != "-":
        with Path(path).open("rb") as file:
            return file.read(LARGEST_FILE + 1)
    if sys.stdin is None:
        raise OSError("standard input is closed")
    stream = getattr(sys.stdin, "buffer", None)
    return bytes(stream.read(LARGEST_FILE + 1)) if stream is not None else sys.stdin.read(LARGEST_FILE + 1).encode()


def decoded(text: bytes) -> dict[str, Any]:
    """The JSON object that a plan file is.

    Raises:
        PlanError: it is too large, or none; it holds special numbers, or a key twice.
    """
    if len(text) > LARGEST_FILE:
        raise PlanError("", f"is larger than {LARGEST_FILE >> 20} MiB")
    try:
        document = json.loads(text.decode(), parse_constant=_no_constant, object_pairs_hook=_no_repetition)
    except PlanError:
        raise
    except UnicodeDecodeError as error:
        raise PlanError("", f"cannot be read: {error}") from error
    except ValueError as error:
        raise PlanError("", f"no JSON: {error}") from error
    except RecursionError as error:
        raise PlanError("", "nested too deeply") from error
    if not isinstance(document, dict):
        raise PlanError("", "must be a JSON object")
    return document


def _no_constant(name: str) -> float:
    raise PlanError("", f"holds {name}, which is no number")


def _no_repetition(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        seen: set[str] = set()
        for key, _ in pairs:
            if key in seen:
                raise PlanError("", f"repeats the key {key[:40]!r}")
            seen.add(key)
    return found


def digest(document: Mapping[str, Any]) -> str:
    """SHA-256 of the document without its key `sha256`, in canonical JSON.

    Raises:
        PlanError: the document holds something that is not JSON.
    """
    bare = {key: value for key, value in document.items() if key != "sha256"}
    try:
        text = json.dumps(
            bare, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False, check_circular=False
        )
        return hashlib.sha256(text.encode()).hexdigest()
    except (TypeError, ValueError) as error:
        raise PlanError("", f"holds what is not JSON: {error}") from error
    except RecursionError as error:
        raise PlanError("", "nested too deeply") from error


class PlanError(ValueError):
    """A document that is no plan: says where in it, and what is wrong."""

    def __init__(self, path: str, message: str) -> None:
        super().__init__(f"{path or 'plan'}: {message}")
        self.path = path
        self.message = message

    def __reduce__(self) -> tuple[type[PlanError], tuple[str, str]]:
        return type(self), (self.path, self.message)
