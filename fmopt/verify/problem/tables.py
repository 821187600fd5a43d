"""TOML files as tables whose values are taken out one by one, refused with their file and key where they are wrong."""

from __future__ import annotations

import math
import re
import stat
import sys
import tomllib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

from fmopt.verify.problem.quantities import (
    ANGLE,
    FORCE,
    LENGTH,
    RATIO,
    SPEED,
    TIME,
    TORQUE,
    UNITS,
    Dimension,
    NoQuantity,
    Quantity,
    evaluate,
    scaled,
)

_SPLIT = re.compile(r"[,;]|\band\b")
LARGEST_FILE, LARGEST_MESH, DEEPEST = 1_000_000, 100_000_000, 24
STDIN = Path("-")
FAR, TURN = 1e3, 2.0 * math.pi  # m, rad
_UNITS: Mapping[str, tuple[Dimension, tuple[str, ...]]] = {
    "length": (LENGTH, ("m", "cm", "mm", "um", "in")),
    "angle": (ANGLE, ("rad", "mrad", "deg")),
    "speed": (SPEED, ("m/s", "mm/s")),
    "force": (FORCE, ("N", "mN", "kN")),
    "torque": (TORQUE, ("N*m", "N*mm")),
    "time": (TIME, ("s", "ms", "min")),
}


_DIMENSIONS = frozenset(kind for kind, _ in _UNITS.values())


class ProblemError(ValueError):
    """A problem or one of its files that the check cannot read: which file, which key, and what is wrong."""

    def __init__(self, file: str, key: str, message: str) -> None:
        super().__init__(f"{file}: {key}: {message}" if key else f"{file}: {message}")
        self.file = file
        self.key = key
        self.message = message

    def __reduce__(self) -> tuple[type[ProblemError], tuple[str, str, str]]:
        return type(self), (self.file, self.key, self.message)


@dataclass(frozen=True)
class Table:
    """A table of a file.

    Attributes:
        file: the file.
        key: its key, empty for the file as a whole.
        data: what it holds.
        factors: to SI, of plain numbers; a dimension that it lacks takes no plain number but 0.
        names: parameters that its expressions may name; None where there are no expressions.
    """

    file: Path
    key: str
    data: Mapping[str, Any]
    factors: Mapping[Dimension, Fraction]
    names: Mapping[str, Quantity] | None = None

    def error(self, key: str, message: str) -> ProblemError:
        """The error that says what is wrong with a key of this table."""
        return ProblemError(str(self.file), f"{self.key}.{key}" if self.key and key else self.key or key, message)

    def only(self, *known: str) -> Table:
        """This table, which must not have other keys.

        Raises:
            ProblemError: it has.
        """
        for key in self.data:
            if key not in known:
                raise self.error(key if key.isprintable() and len(key) < 65 else repr(key[:64]), "unknown key")
        return self

    def has(self, key: str) -> bool:
        """Whether there is such a key."""
        return key in self.data

    def value(self, key: str) -> Any:
        """The value of a key.

        Raises:
            ProblemError: it is missing, here and in all that follow.
        """
        if key not in self.data:
            raise self.error(key, "this key is missing")
        return self.data[key]

    def table(self, key: str) -> Table:
        """The table under a key."""
        found = self.value(key)
        if not isinstance(found, dict):
            raise self.error(key, "must be a table")
        return replace(self, key=f"{self.key}.{key}" if self.key else key, data=found)

    def tables(self, key: str, most: int) -> list[Table]:
        """The tables of the array under a key."""
        return [
            replace(self, key=f"{self.key}.{key}[{i}]", data=item)
            for i, item in enumerate(self.items(key, 1, most))
            if isinstance(item, dict) or self._refuse(f"{key}[{i}]", "must be a table")
        ]

    def _refuse(self, key: str, message: str) -> bool:
        raise self.error(key, message)

    def text(self, key: str, choices: Collection[str] = ()) -> str:
        """The text under a key, one of the choices where there are any.

        Args:
            choices: what it may be; anything up to 1000 characters if empty.
        """
        found = self.value(key)
        if not isinstance(found, str) or not 0 < len(found) <= 1000:
            raise self.error(key, "must be text")
        if choices and found not in choices:
            raise self.error(key, f"is {found[:64]!r}, which is none of {', '.join(choices)}")
        return found

    def flag(self, key: str) -> bool:
        """The truth value under a key, false where it is missing."""
        found = self.data.get(key, False)
        if not isinstance(found, bool):
            raise self.error(key, "must be true or false")
        return found

    def count(self, key: str, default: int, most: int) -> int:
        """The number of corners under a key."""
        found = self.data.get(key, default)
        if type(found) is not int or not 3 <= found <= most:  # bool is an int
            raise self.error(key, f"must be a whole number from 3 to {most}")
        return found

    def items(self, key: str, least: int, most: int) -> list[Any]:
        """The entries of the array under a key."""
        found = self.value(key)
        if not isinstance(found, list) or not least <= len(found) <= most:
            raise self.error(key, f"must be an array of {least} to {most} entries")
        return found

    def names_of(self, key: str) -> list[str]:
        """The names in the array under a key."""
        found = self.items(key, 1, 256)
        if not all(isinstance(name, str) for name in found):
            raise self.error(key, "must be an array of names")
        return found

    def number(self, key: str, kind: Dimension, low: float = 0.0, high: float = FAR) -> float:
        """The quantity under a key, in SI.

        Args:
            low, high: between which it must be, SI.
        """
        return self._number(key, self.value(key), kind, low, high)

    def interval(self, key: str, kind: Dimension, low: float = 0.0, high: float = FAR) -> tuple[float, ...]:
        """The quantity under a key, or both ends of an interval of it, in SI; arguments as of `number`."""
        value = self.value(key)
        ends = value if isinstance(value, list) and len(value) == 2 else [value]
        return tuple(self._number(key, end, kind, low, high) for end in ends)

    def maybe(self, key: str, kind: Dimension, low: float = 0.0, high: float = FAR) -> float | None:
        """The same, None where the key is missing."""
        return self.number(key, kind, low, high) if key in self.data else None

    def vector(self, key: str, kind: Dimension = LENGTH, default: tuple[float, ...] | None = None) -> tuple[float, ...]:
        """Three quantities, lengths of either sign or the entries of a rotation vector.

        Args:
            default: where the key is missing; an error then if None.
        """
        if default is not None and key not in self.data:
            return default
        return self.row(key, self.items(key, 3, 3), kind)

    def size(self, key: str) -> tuple[float, ...]:
        """Three lengths above zero."""
        found = self.items(key, 3, 3)
        return tuple(self._number(f"{key}[{i}]", x, LENGTH, 1e-9, FAR) for i, x in enumerate(found))

    def row(self, key: str, items: Any, kind: Dimension = LENGTH, count: int = 3) -> tuple[float, ...]:
        """So many quantities."""
        if not isinstance(items, list) or len(items) != count:
            raise self.error(key, f"must be {count} numbers")
        most = TURN if kind == ANGLE else FAR
        return tuple(self._number(f"{key}[{i}]", item, kind, -most, most) for i, item in enumerate(items))

    def _number(self, key: str, raw: Any, kind: Dimension, low: float, high: float) -> float:
        found = self.quantity(key, raw, kind)
        if found.dimension != kind:
            raise self.error(key, "is a quantity of another kind")
        if not low <= found.value <= high:
            raise self.error(key, f"is {found.value:.9g} in SI units, not from {low:.9g} to {high:.9g}")
        return found.value

    def quantity(self, key: str, raw: Any, kind: Dimension = LENGTH) -> Quantity:
        """A number of the kind, or text with its unit."""
        try:
            if isinstance(raw, str):
                return evaluate(raw, self.names)
            if isinstance(raw, bool) or not isinstance(raw, int | float):
                raise self.error(key, "must be a number")
            if raw and kind in _DIMENSIONS and kind not in self.factors:
                raise self.error(key, "is a number without a unit")
            return Quantity(scaled(float(raw), self.factors.get(kind, Fraction(1))), kind)
        except OverflowError:
            raise self.error(key, "is not finite") from None
        except NoQuantity as error:
            raise self.error(key, str(error)) from None


def parameters(model: Table, overrides: Mapping[str, Quantity], cited: Table) -> Table:
    """The table of a model with its parameters bound, some of them as the problem gives them.

    Args:
        overrides: by name, in SI.

    Raises:
        ProblemError: a parameter that is no quantity, or an override of none or of another kind.
    """
    names: dict[str, Quantity] = {}
    given = model.table("parameters") if model.has("parameters") else replace(model, key="parameters", data={})
    for name, raw in given.data.items():
        # A parameter may name those above it.
        found = replace(given, names=names).quantity(name, raw)
        if found.dimension not in (LENGTH, ANGLE, RATIO):
            raise given.error(name, "is neither a length, an angle nor a plain number")
        names[name] = overrides.get(name, found)
        if names[name].dimension != found.dimension:
            raise cited.error(name, "is of another kind than the parameter of the model")
    for name in overrides:
        if name not in names:
            raise cited.error(name, f"the model {model.file.name} has no such parameter")
    return replace(model, names=names)


def read(path: Path, cited: Table | None, key: str) -> Table:
    """The TOML file at a path, named by `key` of the table `cited`; plain numbers have the units it says.

    Args:
        cited: table that names it; None for the problem itself.

    Raises:
        ProblemError: no such file, too large, or no TOML.
    """
    content = read_bytes(path, cited, key, LARGEST_FILE)
    try:
        data = tomllib.loads(content.decode("utf-8").replace("\r\n", "\n"))
    except (ValueError, RecursionError) as error:
        raise ProblemError(str(path), "", f"no TOML: {str(error)[:200]}") from None
    return with_units(path, data)


def with_units(path: Path, data: Mapping[str, Any]) -> Table:
    """The table of a file's data, whose plain numbers have the units that it says.

    Raises:
        ProblemError: it is nested too deeply, or its units are none.
    """
    if any(depth >= DEEPEST for depth in _depths(data)):
        raise ProblemError(str(path), "", f"tables and arrays are nested more than {DEEPEST} deep")
    bare = Table(path, "", data, {})
    if not bare.has("units"):
        return bare
    units, factors = bare.table("units"), {}
    for name, (kind, known) in _UNITS.items():
        # Units of lengths and angles have to be named; all others are of SI where they are not.
        if units.has(name) or name not in ("length", "angle"):
            factors[kind] = _factor(units.text(name, known) if units.has(name) else known[0])
    return replace(bare, factors=factors)


def _factor(name: str) -> Fraction:
    one, *others = name.replace("*", " * ").replace("/", " / ").split()
    factor = UNITS[one][0]
    for sign, other in zip(others[::2], others[1::2], strict=True):
        factor = factor / UNITS[other][0] if sign == "/" else factor * UNITS[other][0]
    return factor


def _depths(data: Any) -> Iterator[int]:
    waiting = [(data, 0)]
    while waiting:
        value, depth = waiting.pop()
        if isinstance(value, dict | list):
            yield depth
            if depth < DEEPEST:
                waiting.extend((child, depth + 1) for child in (value.values() if isinstance(value, dict) else value))


def read_bytes(path: Path, cited: Table | None, key: str, most: int) -> bytes:
    """The bytes of a regular file, or of standard input in place of the problem file.

    Args:
        cited: table that names it; None for the problem itself, which may be standard input.

    Raises:
        ProblemError: there is none, or it is too large.
    """
    if path == STDIN and cited is None:
        content = sys.stdin.buffer.read(most + 1)
        if len(content) > most:
            raise ProblemError(str(path), "", f"more than {most} bytes come in")
        return content
    try:
        status = path.stat()  # before it is opened, as a pipe may never end
        if not stat.S_ISREG(status.st_mode):
            message = "is no regular file"
        elif status.st_size > most:
            message = f"has more than {most} bytes"
        else:
            return path.read_bytes()
    except OSError as error:
        message = f"cannot be read: {error.strerror}"
    except ValueError:  # a zero byte in it
        message = "is no file name"
    if cited is None:
        raise ProblemError(str(path), "", message)
    raise cited.error(key, f"{path!s} {message}")


def spelled_out(whole: Table) -> Table:
    """A problem file with its short forms as tables: a model by its name alone, a start error as text.

    Raises:
        ProblemError: the text is not a distance and an angle.
    """
    data = dict(whole.data)
    data.update({side: {"model": data[side]} for side in ("moving", "fixed") if isinstance(data.get(side), str)})
    errors = data.get("uncertainty")
    if isinstance(errors, dict) and isinstance(errors.get("start"), str):
        table = whole.table("uncertainty")
        parts = [
            part.strip().removeprefix("±").removeprefix("+-").removeprefix("+/-")
            for part in _SPLIT.split(errors["start"])
        ]
        kinds = [table.quantity("start", part.strip()).dimension for part in parts if part]
        if sorted(map(str, kinds)) != sorted(map(str, (LENGTH, ANGLE))):
            raise table.error("start", "must be a distance and an angle")
        position, angle = (
            next(part for part, kind in zip(filter(None, parts), kinds, strict=True) if kind == wanted)
            for wanted in (LENGTH, ANGLE)
        )
        data["uncertainty"] = {**errors, "start": {"position": position.strip(), "angle": angle.strip()}}
    return replace(whole, data=data)
