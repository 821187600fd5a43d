"""Numbers with units in SI, and the closed arithmetic of model expressions: + - * / ( ), names, numbers."""

from __future__ import annotations

import functools
import math
import re
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Context, Decimal
from difflib import get_close_matches
from fractions import Fraction
from typing import Any, NamedTuple, TypeAlias

MAX_TEXT = 200
MAX_PARENTHESES = 16  # the parser calls itself at each


class QuantityError(ValueError):
    """Text that is no quantity: a code, what is wrong, and what to write instead."""

    def __init__(self, code: str, message: str, advice: str) -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.advice = advice


class Dimension(NamedTuple):
    """Exponents of length, mass, time and angle."""

    length: int = 0
    mass: int = 0
    time: int = 0
    angle: int = 0

    def times(self, other: Dimension, sign: int = 1) -> Dimension:
        """The dimension of a product (sign 1) or quotient (sign −1)."""
        return Dimension(*(one + sign * two for one, two in zip(self, other, strict=True)))

    def __str__(self) -> str:
        return _KINDS.get(self, _OTHER)[0]


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
_OTHER = ("a quantity of another kind", 1.0, "", "")
# In words, the unit that people read with its factor to SI, and an example as a file has it.
_KINDS = {
    RATIO: ("a plain number", 1.0, "", "0.01"),
    LENGTH: ("a length", 1e-3, "mm", '"2 mm"'),
    ANGLE: ("an angle", math.pi / 180.0, "deg", '"0.3 deg"'),
    TIME: ("a time", 1.0, "s", '"60 s"'),
    SPEED: ("a speed", 1e-3, "mm/s", '"20 mm/s"'),
    FORCE: ("a force", 1.0, "N", '"5 N"'),
    TORQUE: ("a torque", 1.0, "N*m", '"0.5 N*m"'),
    MASS: ("a mass", 1.0, "kg", '"5 kg"'),
    STIFFNESS: ("a stiffness", 1e3, "N/mm", '"20 N/mm"'),
    AREA: ("an area", 1e-6, "mm*mm", ""),  # asked for nowhere
}
EXAMPLES = {kind: example for kind, (*_, example) in _KINDS.items() if example}

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

    def joined(self, sign: str, other: Quantity) -> Quantity:
        """The sum, difference, product or quotient, by the sign between the two.

        Raises:
            QuantityError: the dimensions of a sum differ, or a division by zero.
        """
        if sign in _SUM:
            if self.dimension != other.dimension:
                message = f"{self.dimension} and {other.dimension} are added"
                raise QuantityError("wrong-unit", message, "give every number in a sum its unit")
            return Quantity(self.value + (other.value if sign == "+" else -other.value), self.dimension)
        if sign != "/":
            return Quantity(self.value * other.value, self.dimension.times(other.dimension))
        if other.value == 0.0:
            raise QuantityError("expression", "there is a division by zero", "divide by something else")
        return Quantity(self.value / other.value, self.dimension.times(other.dimension, -1))


def scaled(number: float, factor: float) -> float:
    """`number` times `factor` as decimals, so that 8.1444 mm is the float nearest to 0.0081444 m."""
    if not (math.isfinite(number) and math.isfinite(factor)):
        return number * factor
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
_TOKEN = re.compile(
    r"(?:(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)|(?P<name>[^\W\d]\w*|[°%])|(?P<sign>[-+*/()·]))\s*"
)
_END = ("end", "the end")
_SUM, _PRODUCT = _LEVELS = {"+", "-"}, {"*", "/", "·"}
_Tokens: TypeAlias = deque[tuple[str, str]]  # kind and text of each that is left, then the end
_GRAMMAR = "write numbers with units, names of parameters, + - * / and parentheses"
_LONE = 'write a number, or one with its unit: "2 mm", "0.3 deg"'


def evaluate(text: str, names: Mapping[str, Quantity] | None = None) -> Quantity:
    """The value of a quantity or expression.

    Without `names` the text is one number with a unit, `"0.5 N*m"`. With `names` it is arithmetic on names and
    numbers, `"2 * (width + 0.1 mm)"`, where a number carries at most one unit. Nothing else is understood.

    Raises:
        QuantityError: the text is not of this form, or dimensions do not agree.
    """
    if len(text) > MAX_TEXT:
        raise QuantityError("expression", f"the text has {len(text)} characters", f"use at most {MAX_TEXT}")
    grammar = _LONE if names is None else _GRAMMAR
    tokens, position = _Tokens(), len(text) - len(text.lstrip())
    while position < len(text):
        found = _TOKEN.match(text, position)
        if found is None:
            advice = "write a decimal point, 0.2" if text[position] == "," else grammar
            raise QuantityError("expression", f"{text[position]!r} is not understood", advice)
        kind = found.lastgroup or ""
        tokens.append((kind, found[kind]))
        position = found.end()
    tokens.append(_END)
    value = _operand(tokens, names) if names is None else _arithmetic(tokens, names)
    if tokens[0] != _END:
        raise QuantityError("expression", f"{tokens[0][1]!r} is not expected", grammar)
    return value


def _arithmetic(tokens: _Tokens, names: Mapping[str, Quantity], depth: int = 0, level: int = 0) -> Quantity:
    """Operands joined by the signs of a level and those that bind tighter, inside so many parentheses."""
    if level == len(_LEVELS):
        return _operand(tokens, names, depth)
    value = _arithmetic(tokens, names, depth, level + 1)
    while tokens[0][1] in _LEVELS[level]:
        value = value.joined(tokens.popleft()[1], _arithmetic(tokens, names, depth, level + 1))
    return value


def _operand(tokens: _Tokens, names: Mapping[str, Quantity] | None, depth: int = 0) -> Quantity:
    """A number with its unit, a name or a sum in parentheses, behind any signs; without `names` a number alone."""
    negative = False
    while tokens[0][1] in _SUM:
        negative ^= tokens.popleft()[1] == "-"
    kind, text = tokens.popleft()
    if kind == "number":
        value = _measured(float(text), tokens, compound=names is None)
    elif names is None:
        raise QuantityError("expression", f"{text!r} is not a number", _LONE)
    elif kind == "name":
        if text not in names:
            advice = did_you_mean(text, names) or "define it under [parameters], above its first use"
            raise QuantityError("unknown-parameter", f"there is no parameter {text!r}", advice)
        value = names[text]
    elif text == "(":
        if depth == MAX_PARENTHESES:
            message = f"there are more than {MAX_PARENTHESES} parentheses within one another"
            raise QuantityError("expression", message, f"use at most {MAX_PARENTHESES}")
        value = _arithmetic(tokens, names, depth + 1)
        if tokens[0][1] != ")":
            raise QuantityError("expression", f"{tokens[0][1]!r} is not expected", _GRAMMAR)
        tokens.popleft()
    else:
        raise QuantityError("expression", f"{text!r} is not expected", _GRAMMAR)
    return Quantity(-value.value, value.dimension) if negative else value


def _measured(number: float, tokens: _Tokens, *, compound: bool) -> Quantity:
    """A number with the unit that follows it, in arithmetic a single one: a sign goes on with the arithmetic."""
    if tokens[0][0] != "name":
        return Quantity(number, RATIO)
    factor = unit(tokens.popleft()[1])
    while compound and tokens[0][1] in _PRODUCT:
        sign, (kind, name) = tokens.popleft()[1], tokens.popleft()
        if kind != "name":
            raise QuantityError("unknown-unit", f"{name!r} is no unit", 'write a unit such as "N*m" or "mm/s"')
        factor = factor.joined(sign, unit(name))
    return Quantity(scaled(number, factor.value), factor.dimension)


def in_words(number: float, dimension: Dimension) -> str:
    """A number in SI, in the unit that people read: lengths in mm, angles in degrees."""
    _, scale, name, _ = _KINDS.get(dimension, _OTHER)
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
