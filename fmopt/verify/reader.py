"""Taking values out of a JSON document, with the place in it when one is wrong."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from typing import Any

from fmopt.verify.document import Numbers, PlanError


class Reader:
    """A place in the document: takes values out of it and says where when they are wrong."""

    __slots__ = ("_above", "_step", "value")

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

    def only(self, required: Collection[str], optional: Iterable[str] = ()) -> Reader:
        """This object, which must have the required keys and no others than the optional ones."""
        for key in required:
            if not self.has(key):
                self.at(key)
        if len(self.value) == len(required):
            return self
        unknown = sorted(str(key) for key in self.value.keys() - {*required, *optional})
        if unknown:
            raise self.fail(f"unknown key {unknown[0]!r}: what this check does not know it cannot vouch for")
        return self

    def items(self, least: int = 0, exact: int | None = None) -> list[Reader]:
        """The places of a list's entries, which must be at least so many, or exactly."""
        if not isinstance(self.value, list | tuple):
            raise self.fail("must be a list")
        if len(self.value) < least or (exact is not None and len(self.value) != exact):
            raise self.fail(f"must have {f'{exact}' if exact is not None else f'at least {least}'} entries")
        return [Reader(item, self, f"[{i}]") for i, item in enumerate(self.value)]

    def number(self, low: float = -1e6, high: float = 1e6) -> float:
        """A finite number within limits."""
        if isinstance(self.value, bool) or not isinstance(self.value, int | float):
            raise self.fail("must be a number")
        if not (math.isfinite(self.value) if isinstance(self.value, float) else abs(self.value) < 10**9):
            raise self.fail("must be a finite number")
        if not low <= self.value <= high:
            raise self.fail(f"must lie between {low:g} and {high:g}")
        return float(self.value)

    def numbers(self, count: int, low: float = -1e6, high: float = 1e6) -> Numbers:
        """A list of exactly so many numbers, each within limits, which are finite."""
        values = self.value
        if isinstance(values, list) and len(values) == count:
            for x in values:
                if type(x) is not float or not low <= x <= high:
                    break
            else:
                return tuple(values)
        return tuple(item.number(low, high) for item in self.items(exact=count))

    def matrix(self, rows: int | None) -> tuple[Numbers, ...]:
        """Rows of six numbers; any number of them without `rows`."""
        return tuple(item.numbers(6) for item in self.items(exact=rows))

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
        """A text, one of those allowed if they are given."""
        if not isinstance(self.value, str):
            raise self.fail("must be text")
        if allowed is not None and self.value not in allowed:
            raise self.fail(f"must be one of {', '.join(allowed)}, not {self.value[:40]!r}")
        return self.value

    def flag(self) -> bool:
        """True or false."""
        if not isinstance(self.value, bool):
            raise self.fail("must be true or false")
        return self.value
