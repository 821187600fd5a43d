"""A plan file as JSON: reading it, with bounds, its seal, and taking values out of it, with their place if wrong.

What is the same in every plan file: the format's name, its units and frames, and what no plan covers. What each of its
keys counts for: proved, compared with the problem, or commentary.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

LARGEST_FILE = 1 << 26  # bytes

FORMAT = "fmopt.plan/2"
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
VERDICTS = ("CERTIFIED", "NOT_PROVED", "REFUTED", "TESTED")
NOT_COVERED_PRESSES = (
    "a proof: presses are tested in a physics engine, whose contacts and robot stand for the real ones",
    "shape and size deviations of the parts other than those in the stated errors",
    "whether the real errors, friction, stiffness and offsets lie in the stated sets",
)

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
    # A text stream that stands in for standard input has no bytes of its own.
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
    # Raised by the hooks: as a ValueError it would be taken for broken JSON below.
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
        # Exceptions are pickled with their one text, which this constructor does not take.
        return type(self), (self.path, self.message)


MOST = 4096  # entries of a list, where nothing else is said
LONGEST = 1000  # characters of a text
# Control characters, those that turn the direction of writing, separators of lines, halves of characters.
UNSEEN = re.compile("[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff\ud800-\udfff]")
LABEL = r"[A-Za-z0-9][A-Za-z0-9_.+\[\]/ -]{0,63}"
_LABEL = re.compile(LABEL, re.ASCII)
_HEX = re.compile(r"[0-9a-f]{64}", re.ASCII)

PROVED = "proved"  # derived again from what is compared, a choice that the proof rests on, or the format's only value
COMPARED = "compared with the problem"  # an assumption, which `verify --problem` holds against the problem
COMMENTARY = "commentary"  # of the right form, and judged by nobody


class Reader:
    """A place in the document: takes values out of it and says where when they are wrong."""

    __slots__ = ("_above", "_step", "value")  # one is made for each value of a plan

    def __init__(self, value: Any, above: Reader | None = None, step: str = "") -> None:
        self.value = value
        self._above = above
        self._step = step

    @property
    def path(self) -> str:
        """Where in the document this is, such as "segments[2].tube"."""
        if self._above is None:
            return self._step
        before = self._above.path
        return f"{before}.{self._step}" if before and not self._step.startswith("[") else before + self._step

    def fail(self, message: str) -> PlanError:
        """The error that says what is wrong here."""
        return PlanError(self.path, message)

    def at(self, key: str) -> Reader:
        """The place of a key of this object, which must be there."""
        if not isinstance(self.value, dict):
            raise self.fail("must be an object")
        if key not in self.value:
            raise self.fail(f"lacks the key {key!r}")
        return Reader(self.value[key], self, key)

    def has(self, key: str) -> bool:
        """Whether this is an object with the key."""
        return isinstance(self.value, dict) and key in self.value

    def only(self, row: Fields) -> Reader:
        """This object, which must have the required keys and no others than the optional ones."""
        if not isinstance(self.value, dict):
            raise self.fail("must be an object")
        for key in row.required:
            if key not in self.value:
                raise self.fail(f"lacks the key {key!r}")
        # All that is required is there: an object of no more keys has no others.
        if len(self.value) > len(row.required):
            # The least by name, as differences of sets come in no order.
            unknown = min((str(key) for key in self.value.keys() - row.known), default=None)
            if unknown is not None:
                raise self.fail(f"unknown key {unknown[:40]!r}: what this check does not know it cannot vouch for")
        return self

    def items(self, least: int = 0, exact: int | None = None, most: int = MOST) -> list[Reader]:
        """The places of a list's entries, which must be at least and at most so many, or exactly."""
        if not isinstance(self.value, list | tuple):
            raise self.fail("must be a list")
        if len(self.value) < least or (exact is not None and len(self.value) != exact):
            raise self.fail(f"must have {f'{exact}' if exact is not None else f'at least {least}'} entries")
        if len(self.value) > most:
            raise self.fail(f"must have at most {most} entries")
        return [Reader(item, self, f"[{i}]") for i, item in enumerate(self.value)]

    def maybe(self, key: str) -> Reader | None:
        """The place of a key of this object; None where it is not there."""
        return self.at(key) if self.has(key) else None

    def filled(self, key: str) -> Reader | None:
        """The place of a key of this object, which must be there; None where it holds null."""
        place = self.at(key)
        return None if place.value is None else place

    def number(self, low: float = -1e6, high: float = 1e6) -> float:
        """A finite number within limits."""
        if isinstance(self.value, bool) or not isinstance(self.value, int | float):  # True is an int to Python
            raise self.fail("must be a number")
        # Whole numbers of JSON have no greatest: one of some hundred digits is no float.
        if not (math.isfinite(self.value) if isinstance(self.value, float) else abs(self.value) < 10**9):
            raise self.fail("must be a finite number")
        if not low <= self.value <= high:
            raise self.fail(f"must lie between {low:g} and {high:g}")
        return float(self.value)

    def numbers(self, count: int, low: float = -1e6, high: float = 1e6) -> Numbers:
        """A list of exactly so many numbers, each within limits, which are finite."""
        values = self.value
        # Nearly all are floats in range: only where one is not is each looked at by itself, for the place of the fault.
        if isinstance(values, list) and len(values) == count:
            for x in values:
                if type(x) is not float or not low <= x <= high:
                    break
            else:
                return tuple(values)
        return tuple(item.number(low, high) for item in self.items(exact=count))

    def matrix(self, most: int = MOST) -> tuple[Numbers, ...]:
        """Rows of six numbers, at most so many of them."""
        return tuple(item.numbers(6) for item in self.items(most=most))

    def integer(self, end: int = 10**6) -> int:
        """A whole number from 0 to below `end`."""
        if isinstance(self.value, bool) or not isinstance(self.value, int):
            raise self.fail("must be a whole number")
        if not 0 <= self.value < end:
            raise self.fail(f"must lie between 0 and {end - 1}")
        return self.value

    def indices(self, end: int, least: int = 0, exact: int | None = None) -> tuple[int, ...]:
        """A list of different whole numbers below `end`."""
        found = tuple(item.integer(end) for item in self.items(least, exact))
        if len(set(found)) != len(found):
            raise self.fail("repeats an index")
        return found

    def text(self, allowed: Iterable[str] | None = None) -> str:
        """A text of one line, one of those allowed if they are given."""
        if not isinstance(self.value, str):
            raise self.fail("must be text")
        if allowed is not None:
            if self.value not in allowed:
                words = ", ".join(word or '""' for word in [*allowed][:20])
                raise self.fail(f"must be one of {words}, not {self.value[:40]!r}")
            return self.value
        if len(self.value) > LONGEST:
            raise self.fail(f"must be at most {LONGEST} characters long")
        if (unseen := UNSEEN.search(self.value)) is not None:
            raise self.fail(f"must be one line of text, without the control character U+{ord(unseen.group()):04X}")
        return self.value

    def label(self) -> str:
        """A name: up to 64 letters and digits, and signs that end no text anywhere."""
        if not isinstance(self.value, str):
            raise self.fail("must be text")
        if _LABEL.fullmatch(self.value) is None:
            raise self.fail(f"must be a name of letters and digits, not {self.value[:40]!r}")
        return self.value

    def sha256(self) -> str:
        """A SHA-256 in hexadecimal digits."""
        if not isinstance(self.value, str) or _HEX.fullmatch(self.value) is None:
            raise self.fail("must be 64 hexadecimal digits")
        return self.value

    def flag(self) -> bool:
        """True or false."""
        if not isinstance(self.value, bool):
            raise self.fail("must be true or false")
        return self.value


@dataclass(frozen=True)
class Fields:
    """The keys that an object of a plan file may have."""

    where: str  # its place, such as "segments[].tube"
    # Each key with its class; one whose value is an object or a list of such has the classes of its keys
    classes: tuple[tuple[str, str], ...]
    required: tuple[str, ...]
    known: frozenset[str]


def fields(
    where: str, *, proved: str = "", compared: str = "", commentary: str = "", objects: str = "", optional: str = ""
) -> Fields:
    """The keys of an object, by class, separated by spaces, and which of them are optional."""
    told = ((PROVED, proved), (COMPARED, compared), (COMMENTARY, commentary))
    classes = tuple((key, kind) for kind, keys in told for key in keys.split())
    known = [key for key, _ in classes] + objects.split()
    missing = set(optional.split())
    return Fields(where, classes, tuple(key for key in known if key not in missing), frozenset(known))
