"""Numbers with units in SI, and the closed arithmetic of model expressions: + - * / ( ), names, numbers."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Context, Decimal
from difflib import get_close_matches
from fractions import Fraction
from typing import Any

MAX_TEXT = 200
MAX_PARENTHESES = 16  # the parser calls itself at each


class QuantityError(ValueError):
    """Text that is no quantity: a code, what is wrong, and what to write instead."""

    def __init__(self, code: str, message: str, advice: str) -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.advice = advice


@dataclass(frozen=True)
class Dimension:
    """Exponents of length, mass, time and angle."""

    length: int = 0
    mass: int = 0
    time: int = 0
    angle: int = 0

    def times(self, other: Dimension, sign: int = 1) -> Dimension:
        """The dimension of a product (sign 1) or quotient (sign −1).

        Args:
            sign: 1 or −1.
        """
        return Dimension(
            self.length + sign * other.length,
            self.mass + sign * other.mass,
            self.time + sign * other.time,
            self.angle + sign * other.angle,
        )

    def __str__(self) -> str:
        return _NAMES.get(self, "a quantity of another kind")


RATIO = Dimension()
LENGTH = Dimension(length=1)
ANGLE = Dimension(angle=1)
TIME = Dimension(time=1)
SPEED = Dimension(length=1, time=-1)
FORCE = Dimension(length=1, mass=1, time=-2)
TORQUE = Dimension(length=2, mass=1, time=-2)
MASS = Dimension(mass=1)
STIFFNESS = Dimension(mass=1, time=-2)
AREA = Dimension(length=2)
_NAMES = {
    RATIO: "a plain number",
    LENGTH: "a length",
    ANGLE: "an angle",
    TIME: "a time",
    SPEED: "a speed",
    FORCE: "a force",
    TORQUE: "a torque",
    MASS: "a mass",
    STIFFNESS: "a stiffness",
    AREA: "an area",
}
EXAMPLES = {
    RATIO: "0.01",
    LENGTH: '"2 mm"',
    ANGLE: '"0.3 deg"',
    TIME: '"60 s"',
    SPEED: '"20 mm/s"',
    FORCE: '"5 N"',
    TORQUE: '"0.5 N*m"',
    MASS: '"5 kg"',
    STIFFNESS: '"20 N/mm"',
}

# The units a file may choose for its plain numbers, in SI.
UNITS: Mapping[str, tuple[Dimension, Mapping[str, float]]] = {
    "length": (LENGTH, {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}),
    "angle": (ANGLE, {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180.0}),
    "speed": (SPEED, {"m/s": 1.0, "mm/s": 1e-3}),
    "force": (FORCE, {"N": 1.0, "mN": 1e-3, "kN": 1e3}),
    "torque": (TORQUE, {"N*m": 1.0, "N*mm": 1e-3}),
    "time": (TIME, {"s": 1.0, "ms": 1e-3, "min": 60.0}),
}


@dataclass(frozen=True)
class Quantity:
    """A number in SI units and its dimension."""

    value: float
    dimension: Dimension


def scaled(number: float, factor: float) -> float:
    """`number` times `factor` as decimals, so that 8.1444 mm is the float nearest to 0.0081444 m.

    Args:
        number: as it was written; infinite and nan stay as they are.
        factor: of its unit.
    """
    if not math.isfinite(number):
        return number
    try:
        return float(Fraction(repr(number)) * Fraction(repr(factor)))  # repr: the digits that were written
    except OverflowError:
        return math.copysign(math.inf, number)  # more than a float holds, which is refused as not finite


@functools.cache
def _registry() -> Any:
    import pint  # only where somebody writes a unit

    return pint.UnitRegistry()


@functools.lru_cache(maxsize=256)
def unit(name: str) -> Quantity:
    """One unit such as `mm`, `deg` or `N`, as pint knows it.

    Raises:
        QuantityError: no such unit, or one that does not start at zero or measures something else.
    """
    registry = _registry()
    import pint

    try:
        parsed = registry.parse_units(name)
        factor, base = registry.get_base_units(parsed)
        zero = registry.Quantity(0.0, parsed).to_base_units().magnitude
    # On text that is no unit pint raises any of these.
    except (pint.PintError, pint.errors.PintTypeError, AttributeError, ValueError, TypeError, OverflowError):
        raise QuantityError("unknown-unit", f"{name!r} is no unit", "write a unit such as mm, um, deg or N") from None
    # pint keeps the radian among its base units: an angle is no plain number.
    known = {"meter": "length", "kilogram": "mass", "second": "time", "radian": "angle"}
    exponents = {str(key): float(value) for key, value in registry.Quantity(1.0, base).unit_items()}
    if zero != 0.0 or not set(exponents) <= set(known) or any(value % 1 for value in exponents.values()):
        message = f"the unit {name!r} measures nothing that is asked for here"
        raise QuantityError("wrong-unit", message, "write a unit such as mm, um, deg or N")
    return Quantity(float(factor), Dimension(**{known[key]: int(value) for key, value in exponents.items()}))


# Digits of ASCII alone: float() would take those of any script.
_TOKEN = re.compile(r"\s*(?:((?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)|([^\W\d]\w*|[°%])|([-+*/()·]))")


def evaluate(text: str, names: Mapping[str, Quantity] | None = None) -> Quantity:
    """The value of a quantity or expression.

    Without `names` the text is one number with a unit, `"0.5 N*m"`. With `names` it is arithmetic on names and
    numbers, `"2 * (width + 0.1 mm)"`, where a number carries at most one unit. Nothing else is understood.

    Args:
        names: quantities that it may use; a lone number with its unit if None.

    Raises:
        QuantityError: the text is not of this form, or dimensions do not agree.
    """
    if len(text) > MAX_TEXT:
        raise QuantityError("expression", f"the text has {len(text)} characters", f"use at most {MAX_TEXT}")
    grammar = _LONE if names is None else _GRAMMAR
    tokens: list[tuple[str, str]] = []
    position = 0
    while text[position:].strip():
        found = _TOKEN.match(text, position)
        if found is None:
            rest = text[position:].strip()
            advice = "write a decimal point, 0.2" if rest[:1] == "," else grammar
            raise QuantityError("expression", f"{rest[:1]!r} is not understood", advice)
        kind = ("number", "name", "sign")[(found.lastindex or 1) - 1]
        tokens.append((kind, found[found.lastindex or 1]))
        position = found.end()
    parser = _Parser(tokens, names)
    value = parser.sum() if names is not None else parser.measure()
    if parser.kind is not None:
        raise QuantityError("expression", f"{parser.text!r} is not expected", grammar)
    return value


_GRAMMAR = "write numbers with units, names of parameters, + - * / and parentheses"
_LONE = 'write a number, or one with its unit: "2 mm", "0.3 deg"'


class _Parser:
    """Recursive descent: sum = product (± product)*, product = factor (*/ factor)*, factor = ± factor | atom."""

    def __init__(self, tokens: list[tuple[str, str]], names: Mapping[str, Quantity] | None) -> None:
        self._tokens = tokens
        self._names = names
        self._next = 0
        self._depth = 0

    @property
    def kind(self) -> str | None:
        return self._tokens[self._next][0] if self._next < len(self._tokens) else None

    @property
    def text(self) -> str:
        return self._tokens[self._next][1] if self._next < len(self._tokens) else "the end"

    def _take(self) -> str:
        self._next += 1
        return self._tokens[self._next - 1][1]

    def sum(self) -> Quantity:
        left = self._product()
        while self.kind == "sign" and self.text in "+-":
            sign = 1.0 if self._take() == "+" else -1.0
            right = self._product()
            if left.dimension != right.dimension:
                message = f"{left.dimension} and {right.dimension} are added"
                raise QuantityError("wrong-unit", message, "give every number in a sum its unit")
            left = Quantity(left.value + sign * right.value, left.dimension)
        return left

    def _product(self) -> Quantity:
        left = self._factor()
        while self.kind == "sign" and self.text in "*/·":
            divides = self._take() == "/"
            right = self._factor()
            if divides and right.value == 0.0:
                raise QuantityError("expression", "there is a division by zero", "divide by something else")
            value = left.value / right.value if divides else left.value * right.value
            left = Quantity(value, left.dimension.times(right.dimension, -1 if divides else 1))
        return left

    def _factor(self) -> Quantity:
        sign = 1.0
        while self.kind == "sign" and self.text in "+-":
            sign = sign if self._take() == "+" else -sign
        atom = self._atom()
        return Quantity(sign * atom.value, atom.dimension)

    def _atom(self) -> Quantity:
        if self.kind == "number":
            return self._number(compound=False)
        if self.kind == "name":
            return self._named(self._take())
        if self.kind == "sign" and self.text == "(":
            self._take()
            if self._depth == MAX_PARENTHESES:
                message = f"there are more than {MAX_PARENTHESES} parentheses within one another"
                raise QuantityError("expression", message, f"use at most {MAX_PARENTHESES}")
            self._depth += 1
            value = self.sum()
            self._depth -= 1
            if self.text == ")":
                self._take()
                return value
        raise QuantityError("expression", f"{self.text!r} is not expected", _GRAMMAR)

    def _named(self, name: str) -> Quantity:
        names = self._names or {}
        if name in names:
            return names[name]
        advice = did_you_mean(name, names) or "define it under [parameters], above its first use"
        raise QuantityError("unknown-parameter", f"there is no parameter {name!r}", advice)

    def measure(self) -> Quantity:
        """A number with a (compound) unit and a sign."""
        sign = 1.0
        while self.kind == "sign" and self.text in "+-":
            sign = sign if self._take() == "+" else -sign
        if self.kind != "number":
            raise QuantityError("expression", f"{self.text!r} is not a number", _LONE)
        value = self._number(compound=True)
        return Quantity(sign * value.value, value.dimension)

    def _number(self, *, compound: bool) -> Quantity:
        number = float(self._take())
        if self.kind != "name":
            return Quantity(number, RATIO)
        factor, dimension = 1.0, RATIO
        divides = False
        while True:
            part = unit(self._take())
            factor = factor / part.value if divides else factor * part.value
            dimension = dimension.times(part.dimension, -1 if divides else 1)
            # In an expression a sign goes on with the arithmetic: the unit before it is a single one.
            if not (compound and self.kind == "sign" and self.text in "*/·"):
                return Quantity(scaled(number, factor), dimension)
            divides = self._take() == "/"
            if self.kind != "name":
                raise QuantityError("unknown-unit", f"{self.text!r} is no unit", 'write a unit such as "N*m" or "mm/s"')


def in_words(number: float, dimension: Dimension) -> str:
    """A number in SI, in the unit that people read: lengths in mm, angles in degrees."""
    scale, name = {
        LENGTH: (1e-3, "mm"),
        ANGLE: (math.pi / 180.0, "deg"),
        SPEED: (1e-3, "mm/s"),
        FORCE: (1.0, "N"),
        TORQUE: (1.0, "N*m"),
        TIME: (1.0, "s"),
        MASS: (1.0, "kg"),
        STIFFNESS: (1e3, "N/mm"),
        AREA: (1e-6, "mm*mm"),
    }.get(dimension, (1.0, ""))
    return f"{number / scale:.9g} {name}".rstrip()


def at_most(number: float, dimension: Dimension) -> str:
    """The same of a limit: what is read of the words is within it, where digits rounded up would not be."""
    text = in_words(number, dimension)
    if evaluate(text).value > number:
        value, _, name = text.partition(" ")
        text = f"{Context(prec=9).next_minus(Decimal(value))} {name}".rstrip()
    return text


def did_you_mean(name: str, choices: Mapping[str, object] | list[str]) -> str:
    """`did you mean "…"?` for the nearest of `choices`, or nothing."""
    near = get_close_matches(name, [str(choice) for choice in choices], n=1, cutoff=0.6)
    return f"did you mean {near[0]!r}?" if near else ""
