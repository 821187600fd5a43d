"""Quantities and the closed arithmetic of expressions: laws, agreement of plain numbers with text, refusals."""

import math
from contextlib import suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fmopt.task.toml import units
from fmopt.task.toml.tables import Reading, factors

NAMES = {
    "width": units.Quantity(0.02, units.LENGTH),
    "taper": units.Quantity(0.1, units.ANGLE),
    "none": units.Quantity(0.0, units.LENGTH),
}


@pytest.mark.parametrize(
    ("text", "value", "dimension"),
    [
        ("0.2 mm", 0.0002, units.LENGTH),
        ("8.1444mm", 0.0081444, units.LENGTH),
        ("-3 µm", -3e-6, units.LENGTH),
        ("1 in", 0.0254, units.LENGTH),
        ("1 thou", 2.54e-5, units.LENGTH),  # as all units of Pint
        ("0.3 deg", math.radians(0.3), units.ANGLE),
        ("0.3 °", math.radians(0.3), units.ANGLE),
        ("20 mm/s", 0.02, units.SPEED),
        ("0.5 N*m", 0.5, units.TORQUE),
        ("0.5 N·m", 0.5, units.TORQUE),
        ("5 N", 5.0, units.FORCE),
        ("2 min", 120.0, units.TIME),
        ("1 %", 0.01, units.RATIO),
        ("0.25", 0.25, units.RATIO),
        ("5 kg", 5.0, units.Dimension(mass=1)),
    ],
)
def test_text_with_a_unit(text: str, value: float, dimension: units.Dimension) -> None:
    quantity = units.evaluate(text)
    assert (quantity.value, quantity.dimension) == (pytest.approx(value, rel=1e-15), dimension)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("width", 0.02),
        ("2 * width - 1 mm", 0.039),
        ("-(width + 2 mm) / 2", -0.011),
        ("width * width / width", 0.02),
        ("width / 4 / 5", 0.001),
        ("width - 1 mm - 1 mm", 0.018),
        ("+-+-width", 0.02),
    ],
)
def test_expressions(text: str, value: float) -> None:
    quantity = units.evaluate(text, NAMES)
    assert (quantity.value, quantity.dimension) == (pytest.approx(value, rel=1e-14), units.LENGTH)


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        ("", "expression", "'the end' is not expected"),
        ("2 *", "expression", "'the end' is not expected"),
        ("(width", "expression", "'the end' is not expected"),
        ("width)", "expression", "')' is not expected"),
        ("width width", "expression", "'width' is not expected"),
        ("width ** 2", "expression", "'*' is not expected"),
        ("width / none", "expression", "division by zero"),
        ("width + taper", "wrong-unit", "a length and an angle are added"),
        ("width + 1", "wrong-unit", "a length and a plain number are added"),
        ("widht", "unknown-parameter", "there is no parameter 'widht'; did you mean 'width'?"),
        ("2 furlonks", "unknown-unit", "'furlonks' is no unit"),
        ("20 degC", "wrong-unit", "'degC' measures nothing"),
        ("__import__('os').system('true')", "expression", "is not understood"),
        ("width.real", "expression", "'.' is not understood"),
        ("lambda: 0", "expression", "':' is not understood"),
        ("(" * 60 + "width" + ")" * 60, "expression", "more than 16 parentheses"),
        ("width+" * 60 + "width", "expression", "the text has 365 characters"),
        ("٣ mm", "expression", "is not understood"),
    ],
)
def test_what_is_not_understood_is_refused(text: str, code: str, words: str) -> None:
    with pytest.raises(units.QuantityError) as caught:
        units.evaluate(text, NAMES)
    assert caught.value.code == code
    assert words in f"{caught.value.message}; {caught.value.advice}"
    assert caught.value.advice


@pytest.mark.parametrize("text", ["mm", "2 N*", "2 N/3", "1 mm + 1 mm", "width"])
def test_without_names_there_is_no_arithmetic(text: str) -> None:
    with pytest.raises(units.QuantityError):
        units.evaluate(text)


@pytest.mark.parametrize(("kind", "name"), [(kind, name) for kind, (_, known) in units.UNITS.items() for name in known])
def test_plain_numbers_and_text_agree(kind: str, name: str) -> None:
    dimension, _ = units.UNITS[kind]
    reading = Reading(factors({kind: name}))
    for number in (8.1444, 0.3, 7, 1e-3):
        plain = reading.quantity(number, dimension)
        assert plain == reading.quantity(f"{number} {name}", dimension)


@pytest.mark.parametrize(
    ("value", "name", "expected"), [(8.1444, "mm", 0.0081444), (0.3, "mm", 0.0003), (7, "um", 7e-6)]
)
def test_decimals_stay_decimals(value: float, name: str, expected: float) -> None:
    assert Reading(factors({"length": name})).quantity(value, units.LENGTH).value == expected


@pytest.mark.parametrize("value", [math.inf, math.nan, -math.inf, 10**400, "1e400 mm", f"1 {'Ym*' * 14}m"])
def test_numbers_are_finite(value: object) -> None:
    with pytest.raises(units.QuantityError, match="is not a finite number"):
        Reading().quantity(value, units.LENGTH)


@given(st.text(max_size=40) | st.text(alphabet="widthmkg0123456789.+-*/() eE", max_size=40))
@settings(max_examples=300, deadline=None, derandomize=True)
def test_any_text_gives_a_quantity_or_its_error(text: str) -> None:
    for names in (None, NAMES):
        with suppress(units.QuantityError):
            assert isinstance(units.evaluate(text, names).value, float)
