"""Numbers with units, and arithmetic on parameters, as problem and model files write them; all in SI."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

LONGEST, DEEPEST = 200, 16
Dimension = tuple[int, int, int, int]  # exponents of length, mass, time and angle
RATIO: Dimension = (0, 0, 0, 0)
LENGTH: Dimension = (1, 0, 0, 0)
MASS: Dimension = (0, 1, 0, 0)
TIME: Dimension = (0, 0, 1, 0)
ANGLE: Dimension = (0, 0, 0, 1)
SPEED: Dimension = (1, 0, -1, 0)
FORCE: Dimension = (1, 1, -2, 0)
TORQUE: Dimension = (2, 1, -2, 0)
STIFFNESS: Dimension = (0, 1, -2, 0)
_DEGREE = Fraction(repr(math.pi / 180.0))
_PREFIXES = {"": 0, "n": -9, "u": -6, "µ": -6, "μ": -6, "m": -3, "c": -2, "d": -1, "k": 3, "M": 6}
_WORDS = {"": 0, "nano": -9, "micro": -6, "milli": -3, "centi": -2, "deci": -1, "kilo": 3, "mega": 6}
_SYMBOLS = {"m": LENGTH, "g": MASS, "s": TIME, "rad": ANGLE, "N": FORCE}
_NAMES = {
    "meter": LENGTH,
    "metre": LENGTH,
    "gram": MASS,
    "second": TIME,
    "radian": ANGLE,
    "newton": FORCE,
}


def _units() -> dict[str, tuple[Fraction, Dimension]]:
    """Every unit that the check reads, its factor to SI and its dimension."""
    found: dict[str, tuple[Fraction, Dimension]] = {}
    for (before, power), plural in ((item, end) for item in _WORDS.items() for end in ("", "s")):
        for name, kind in _NAMES.items():
            found[f"{before}{name}{plural}"] = Fraction(10) ** (power - 3 * (kind == MASS)), kind
    for prefix, power in _PREFIXES.items():
        for symbol, kind in _SYMBOLS.items():
            found[prefix + symbol] = Fraction(10) ** (power - 3 * (kind == MASS)), kind
    inch = Fraction(254, 10000)
    found |= dict.fromkeys(("in", "inch", "inches"), (inch, LENGTH))
    found |= dict.fromkeys(("ft", "foot", "feet"), (12 * inch, LENGTH))
    found |= {"thou": (inch / 1000, LENGTH)}
    found |= dict.fromkeys(("micron", "microns"), (Fraction(1, 10**6), LENGTH))
    found |= dict.fromkeys(("deg", "degree", "degrees", "°"), (_DEGREE, ANGLE))
    found |= dict.fromkeys(("arcmin", "arcminute", "arcminutes"), (_DEGREE / 60, ANGLE))
    found |= dict.fromkeys(("arcsec", "arcsecond", "arcseconds"), (_DEGREE / 3600, ANGLE))
    found |= dict.fromkeys(("sec",), (Fraction(1), TIME)) | dict.fromkeys(("min", "minute"), (Fraction(60), TIME))
    found |= dict.fromkeys(("minutes",), (Fraction(60), TIME))
    found |= dict.fromkeys(("h", "hr", "hour", "hours"), (Fraction(3600), TIME))
    found |= dict.fromkeys(("%", "percent"), (Fraction(1, 100), RATIO))
    found |= dict.fromkeys(("t", "tonne", "tonnes"), (Fraction(1000), MASS))
    return found


UNITS = _units()


@dataclass(frozen=True)
class Quantity:
    """A number in SI units and its dimension."""

    value: float
    dimension: Dimension


class NoQuantity(ValueError):
    """Text that is no quantity, in words."""


def scaled(number: float, factor: Fraction) -> float:
    """The number in units of so much, in SI: the float nearest to the product of the decimals.

    Args:
        factor: of its unit to SI, exactly.

    Raises:
        NoQuantity: the number is not finite, or the product is none.
    """
    if not math.isfinite(number):
        raise NoQuantity("is not finite")
    try:
        return float(Fraction(repr(number)) * factor)
    except OverflowError:
        raise NoQuantity("is not finite") from None


def evaluate(text: str, names: Mapping[str, Quantity] | None) -> Quantity:
    """One number with its unit, `"0.5 N*m"`; or, where there are names, arithmetic on them, `"2 * (width + 1 mm)"`.

    Args:
        names: parameters by name; None where there are no expressions.

    Raises:
        NoQuantity: the text is not of this form.
    """
    if len(text) > LONGEST:
        raise NoQuantity(f"has more than {LONGEST} characters")
    words = _Words(_split(text), names)
    found = words.measure() if names is None else words.sum()
    if words.next != "":
        raise NoQuantity(f"{words.next!r} is not expected")
    if not math.isfinite(found.value):
        raise NoQuantity("is not finite")
    return found


_DIGITS = frozenset("0123456789")  # isdigit would take those of other scripts


def _split(text: str) -> list[str]:
    """Numbers, names and signs."""
    found, i = [], 0
    while i < len(text):
        begin, c = i, text[i]
        if c.isspace():
            i += 1
            continue
        if c in _DIGITS or (c == "." and text[i + 1 : i + 2] in _DIGITS and i + 1 < len(text)):
            i = _past_number(text, i)
        elif c.isalpha() or c == "_":
            while i < len(text) and (text[i].isalnum() or text[i] == "_"):
                i += 1
        elif c in "+-*/()·°%":
            i += 1
        else:
            raise NoQuantity(f"{c!r} is not understood")
        found.append(text[begin:i])
    return found


def _past_number(text: str, i: int) -> int:
    def digits(k: int) -> int:
        while k < len(text) and text[k] in _DIGITS:
            k += 1
        return k

    i = digits(i)
    if text[i : i + 1] == ".":
        i = digits(i + 1)
    if text[i : i + 1] in ("e", "E"):
        k = i + 2 if text[i + 1 : i + 2] in ("+", "-") else i + 1
        if digits(k) > k:  # else the e begins a name
            i = digits(k)
    return i


class _Words:
    """Recursive descent over the words of a text."""

    def __init__(self, words: list[str], names: Mapping[str, Quantity] | None) -> None:
        self._words = [*reversed(words)]
        self._names = names or {}
        self._depth = 0

    @property
    def next(self) -> str:
        return self._words[-1] if self._words else ""

    def _take(self, wanted: tuple[str, ...]) -> str:
        return self._words.pop() if self.next in wanted else ""

    def _sign(self) -> float:
        sign = 1.0
        while taken := self._take(("+", "-")):
            sign = -sign if taken == "-" else sign
        return sign

    def sum(self) -> Quantity:
        left = self._product()
        while taken := self._take(("+", "-")):
            right = self._product()
            if left.dimension != right.dimension:
                raise NoQuantity("adds quantities of two kinds")
            left = Quantity(left.value + (right.value if taken == "+" else -right.value), left.dimension)
        return left

    def _product(self) -> Quantity:
        left = self._factor()
        while taken := self._take(("*", "/", "·")):
            right = self._factor()
            if taken == "/" and right.value == 0.0:
                raise NoQuantity("divides by zero")
            value = left.value / right.value if taken == "/" else left.value * right.value
            left = Quantity(value, _joined(left.dimension, right.dimension, taken))
        return left

    def _factor(self) -> Quantity:
        sign = self._sign()
        if self._take(("(",)):
            self._depth += 1
            if self._depth > DEEPEST:
                raise NoQuantity(f"nests more than {DEEPEST} parentheses")
            found = self.sum()
            self._depth -= 1
            if not self._take((")",)):
                raise NoQuantity("lacks a closing parenthesis")
        elif self.next[:1] in _DIGITS or self.next[:1] == ".":
            found = self._number(compound=False)  # signs behind its unit join factors
        elif self.next in self._names and self.next:
            found = self._names[self._words.pop()]
        else:
            raise NoQuantity(f"{self.next or 'the end'!r} is not expected, or no parameter")
        return Quantity(sign * found.value, found.dimension)

    def measure(self) -> Quantity:
        """A number with a sign and a unit, which may be of several."""
        sign = self._sign()
        if self.next[:1] not in _DIGITS and self.next[:1] != ".":
            raise NoQuantity(f"{self.next or 'the end'!r} is no number")
        found = self._number(compound=True)
        return Quantity(sign * found.value, found.dimension)

    def _number(self, *, compound: bool) -> Quantity:
        number = float(self._words.pop())
        if not self.next or self.next in "+-*/()·":
            return Quantity(number, RATIO)
        factor, dimension, sign = Fraction(1), RATIO, "*"
        while True:
            one, kind = self._unit()
            factor = factor / one if sign == "/" else factor * one
            dimension = _joined(dimension, kind, sign)
            if not (compound and (sign := self._take(("*", "/", "·")))):
                return Quantity(scaled(number, factor), dimension)

    def _unit(self) -> tuple[Fraction, Dimension]:
        name = self._words.pop() if self._words else ""
        if name not in UNITS:
            raise NoQuantity(f"{name or 'the end'!r} is no unit that the check knows")
        return UNITS[name]


def _joined(a: Dimension, b: Dimension, sign: str) -> Dimension:
    s = -1 if sign == "/" else 1
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2], a[3] + s * b[3]
