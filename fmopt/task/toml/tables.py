"""What every table of a problem or model file has in common: strict keys, and numbers that are read in SI units.

Pydantic's errors as faults of this project: with line, column, key, code and advice.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, TypeAlias, TypeVar

import pydantic
from pydantic import GetJsonSchemaHandler, StringConstraints, ValidationInfo
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from fmopt.errors import Fault
from fmopt.task.toml import units as si
from fmopt.task.toml.source import Key, Source, dotted, holds
from fmopt.task.toml.units import EXAMPLES, LENGTH, RATIO, Dimension, Quantity, QuantityError, did_you_mean

NAME = r"^[A-Za-z][A-Za-z0-9_-]{0,63}$"
TITLE = r"^[^\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff]{1,200}$"  # as plans may hold it
_TEXT = {"type": "string", "minLength": 1, "maxLength": si.MAX_TEXT}
PARAMETER = r"^[A-Za-z][A-Za-z0-9_]{0,63}$"

_NANOMETRE, _KILOMETRE, _TURN = 1e-9, 1e3, 2.0 * math.pi

Parameter: TypeAlias = Annotated[Any, pydantic.WithJsonSchema({"anyOf": [{"type": "number"}, _TEXT]})]
ParameterName: TypeAlias = Annotated[str, StringConstraints(pattern=PARAMETER)]
Values: TypeAlias = Annotated[dict[ParameterName, Parameter], pydantic.Field(max_length=256)]
Name: TypeAlias = Annotated[str, StringConstraints(pattern=NAME)]
Title: TypeAlias = Annotated[str, StringConstraints(pattern=TITLE)]
File: TypeAlias = Annotated[str, StringConstraints(min_length=1, max_length=1000)]


class Table(pydantic.BaseModel):
    """A table of a file: no unknown keys, no conversions of type, frozen."""

    model_config = pydantic.ConfigDict(extra="forbid", strict=True, frozen=True, use_attribute_docstrings=True)


@dataclass(frozen=True)
class Reading:
    """What the numbers of a file mean: the factor to SI of plain ones, and the parameters expressions may name.

    `broken` are parameters at fault: what names them is not judged. `bare` are the dimensions for which the file names
    no unit: plain numbers other than 0 are refused there.
    """

    factors: Mapping[Dimension, float] = field(default_factory=dict)
    names: Mapping[str, Quantity] | None = None
    broken: frozenset[str] = frozenset()
    bare: frozenset[Dimension] = frozenset()

    @staticmethod
    def of(data: Mapping[str, Any]) -> "Reading":
        """The reading of a file, from its `[units]` table as it stands, right or wrong.

        Without the table every plain number lacks its unit; with it lengths and angles do where it leaves them out, and
        what else it leaves out is in SI.
        """
        units = data.get("units", {})
        known = units if isinstance(units, Mapping) else {"length": "", "angle": ""}
        asked = ("length", "angle") if known else tuple(si.UNITS)
        return Reading(factors(units), bare=frozenset(si.UNITS[name][0] for name in asked if name not in known))

    def excuses(self, value: object) -> bool:
        """Whether the value is text that names a parameter which is at fault itself."""
        return isinstance(value, str) and not self.broken.isdisjoint(re.findall(r"\w+", value[: si.MAX_TEXT]))

    def quantity(self, value: object, dimension: Dimension | None) -> Quantity:
        """A number, or text with a unit, in SI; for a parameter (None) plain numbers are lengths.

        Raises:
            QuantityError: no number, not finite, or a quantity of another dimension.
        """
        wanted = LENGTH if dimension is None else dimension
        if isinstance(value, str):
            result = si.evaluate(value, self.names)
        elif isinstance(value, int | float) and not isinstance(value, bool):
            result = Quantity(si.scaled(_float(value), self.factors.get(wanted, 1.0)), wanted)
            if wanted in self.bare and value and math.isfinite(result.value):
                raise _bare(value, wanted)
        else:
            message = f"{kind_of(value)} stands where {wanted} is asked for"
            raise QuantityError("wrong-type", message, f"write a number, or text such as {EXAMPLES[wanted]}")
        if not math.isfinite(result.value):
            raise QuantityError("not-finite", f"{shown(value)} is not a finite number", "write a finite number")
        allowed = (LENGTH, si.ANGLE, RATIO) if dimension is None else (dimension,)
        if result.dimension not in allowed:
            message = f"{shown(value)} is {result.dimension}, not {' or '.join(str(kind) for kind in allowed)}"
            raise QuantityError("wrong-unit", message, f"write a number, or text such as {EXAMPLES[wanted]}")
        return result


def _bare(value: int | float, wanted: Dimension) -> QuantityError:
    name, choices = next((name, known) for name, (kind, known) in si.UNITS.items() if kind == wanted)
    unit = {"length": "mm", "angle": "deg"}.get(name, next(iter(choices)))
    advice = f'write text with its unit, such as {EXAMPLES[wanted]}, or add {name} = "{unit}" under [units]'
    return QuantityError("no-unit", f"{shown(value)} stands without a unit", advice)


def _float(value: int | float) -> float:
    try:
        return float(value)
    except OverflowError:  # an integer of hundreds of digits
        return math.inf


def kind_of(value: object) -> str:
    """The TOML type of a value, in words."""
    names = {bool: "a boolean", str: "text", int: "a number", float: "a number", dict: "a table"}
    names |= {list: "an array", tuple: "an array"}
    return names.get(type(value), "a date or time")


def shown(value: object) -> str:
    """A value as a message quotes it, short and in one line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float | str):
        text = f"{value!r}" if not isinstance(value, int) or abs(value) < 10**20 else f"{_float(value):g}"
        return text if len(text) <= 60 else text[:57] + "..."
    return kind_of(value)


@dataclass(frozen=True)
class Measured:
    """Annotation of a float field: its dimension, the closed range [low, high] in SI, and words that mean None."""

    dimension: Dimension
    low: float = -math.inf
    high: float = math.inf
    words: tuple[str, ...] = ()

    def __get_pydantic_core_schema__(self, source: Any, handler: pydantic.GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_plain_validator_function(self._validate)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        plain: dict[str, Any] = {"type": "number"}
        if self.low == 0.0:
            plain["minimum"] = 0  # of all limits 0 alone holds in every unit
        elif self.low > 0.0:
            plain["exclusiveMinimum"] = 0
        words = [{"const": word} for word in self.words]
        return {"anyOf": [plain, *words, _TEXT], "examples": [EXAMPLES[self.dimension].strip('"')]}

    def _validate(self, value: Any, info: ValidationInfo) -> float | None:
        reading = info.context if isinstance(info.context, Reading) else Reading()
        if (isinstance(value, str) and value in self.words) or reading.excuses(value):
            return None
        try:
            number = reading.quantity(value, self.dimension).value
        except QuantityError as error:
            raise fault(error.code, error.message, error.advice) from None
        if self.low <= number <= self.high:
            return number
        raise self._out_of_range(value, number)

    def _out_of_range(self, value: object, number: float) -> PydanticCustomError:
        text = shown(value)
        if isinstance(value, str):
            text += f" = {si.in_words(number, self.dimension)}"
        if number < 0.0 <= self.low:
            advice = "make it positive" if self.low > 0.0 else "make it zero or positive"
            return fault("negative", f"{text} is negative", advice)
        if number == 0.0 < self.low:
            return fault("zero", f"{text} is zero", "make it positive")
        side, bound = ("small", self.low) if number < self.low else ("large", self.high)
        words = f"at {'least' if side == 'small' else 'most'} {si.at_most(bound, self.dimension)}"
        advice = f"keep it {words}, and check the unit"
        return fault("out-of-range", f"{text} is too {side}", advice)


class NumberOrInterval(Measured):
    """Annotation of a field that is a number, or both ends of the interval that it lies in."""

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        one = super().__get_pydantic_json_schema__(schema, handler)
        pair = {"type": "array", "items": {"anyOf": one["anyOf"]}, "minItems": 2, "maxItems": 2}
        return {**one, "anyOf": [*one["anyOf"], pair]}

    def _validate(self, value: Any, info: ValidationInfo) -> Any:
        if isinstance(value, list | tuple) and len(value) == 2:
            return tuple(super(NumberOrInterval, self)._validate(one, info) for one in value)
        return super()._validate(value, info)


@dataclass(frozen=True)
class Short:
    """Annotation of a table that text may stand for; `spelled_out` puts the table in its place before it is read."""

    def __get_pydantic_json_schema__(self, source: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [handler(source), _TEXT]}


def fault(code: str, message: str, advice: str) -> PydanticCustomError:
    """An error that carries its own code and advice through pydantic."""
    return PydanticCustomError("fault", "{message}", {"code": code, "message": message, "advice": advice})


Coordinate: TypeAlias = Annotated[float, Measured(LENGTH, -_KILOMETRE, _KILOMETRE)]
Length: TypeAlias = Annotated[float, Measured(LENGTH, _NANOMETRE, _KILOMETRE)]
Distance: TypeAlias = Annotated[float, Measured(LENGTH, 0.0, _KILOMETRE)]
Way: TypeAlias = Annotated[float, Measured(LENGTH, _NANOMETRE, 4.0)]
Beside: TypeAlias = Annotated[float, Measured(LENGTH, -4.0, 4.0)]
Shift: TypeAlias = Annotated[float, Measured(LENGTH, 0.0, 0.5)]  # the most that the check of a plan takes
Lever: TypeAlias = Annotated[float, Measured(LENGTH, 2.0**-10, 16.0)]  # what the check takes for ρ
Turn: TypeAlias = Annotated[float, Measured(si.ANGLE, -_TURN, _TURN)]
Tilt: TypeAlias = Annotated[float, Measured(si.ANGLE, 0.0, math.pi / 4.0)]
ErrorAngle: TypeAlias = Annotated[float, Measured(si.ANGLE, 0.0, 0.5)]  # likewise, the most of a start error
Ratio: TypeAlias = Annotated[float, Measured(RATIO, 0.0, 1.0)]
Friction: TypeAlias = Annotated[float | tuple[float, float] | None, NumberOrInterval(RATIO, 0.0, 5.0)]
Speed: TypeAlias = Annotated[float, Measured(si.SPEED, 1e-6, 100.0)]
Force: TypeAlias = Annotated[float, Measured(si.FORCE, 1e-9, 1e6)]
Torque: TypeAlias = Annotated[float, Measured(si.TORQUE, 1e-9, 1e6)]
Mass: TypeAlias = Annotated[float, Measured(si.MASS, 1e-9, 1e6)]
Stiffness: TypeAlias = Annotated[float, Measured(si.STIFFNESS, 1e-3, 1e12)]
Duration: TypeAlias = Annotated[float, Measured(si.TIME, 1e-3, 1e7)]
Vector: TypeAlias = tuple[Coordinate, Coordinate, Coordinate]
Rotation: TypeAlias = tuple[Turn, Turn, Turn]


def factors(units: object) -> dict[Dimension, float]:
    """Factors to SI of the plain numbers of a file, from its `[units]` table as it stands, right or wrong."""
    table = units if isinstance(units, Mapping) else {}
    return {dimension: known.get(str(table.get(name)), 1.0) for name, (dimension, known) in si.UNITS.items()}


T = TypeVar("T", bound=Table)


def checked(table: type[T], source: Source, reading: Reading) -> tuple[T | None, list[Fault]]:
    """The contents of a file as `table`, or all its faults."""
    try:
        return table.model_validate(_tuples(source.data), context=reading), []
    except pydantic.ValidationError as error:
        schema = table.model_json_schema()
        items = error.errors(include_url=False, include_context=True)
        inner = {item["loc"][:n] for item in items for n in range(len(item["loc"]))}
        # An array counts as too short where one of its entries is at fault.
        told = [item for item in items if not (item["type"] == "too_short" and item["loc"] in inner)]
        return None, list(dict.fromkeys(_fault(source, schema, item) for item in told))


def _tuples(value: Any) -> Any:
    """The same data with arrays as tuples, which is what strict validation takes for them."""
    if isinstance(value, Mapping):
        return {key: _tuples(child) for key, child in value.items()}
    return tuple(_tuples(child) for child in value) if isinstance(value, list) else value


def _fault(source: Source, schema: Mapping[str, Any], item: Mapping[str, Any]) -> Fault:
    kind, loc = str(item["type"]), tuple(item["loc"])
    key = _existing(source, loc)
    if kind == "missing" and loc and isinstance(loc[-1], int):  # an array is too short
        return _array_length(source, key)
    if kind == "missing":
        text = not key and schema["properties"][loc[-1]].get("type") == "string"
        return source.missing(key, loc[-1], _add(key, loc[-1], text))
    if kind == "extra_forbidden":
        known = _known_keys(schema, key[:-1], source)
        advice = did_you_mean(str(key[-1]), known) or f"known keys here: {', '.join(known)}"
        return source.place(key, of_key=True).fault("unknown-key", "there is no such key", advice)
    if loc and loc[-1] == "[key]":  # pydantic's word for an entry's name
        code, message, advice = _words(kind, item, key[-1])
        return source.place(key, of_key=True).fault(code, message, advice)
    if kind in {"too_short", "too_long"}:
        return _array_length(source, key)
    code, message, advice = _words(kind, item, source.get(key))
    return source.place(key).fault(code, message, advice)


def _add(key: Key, name: str | int, text: bool) -> str:
    if any(isinstance(part, int) for part in key):
        return f"add {name!r} to {dotted(key)}"
    if key:
        return f"add {name!r} to [{dotted(key)}]"
    return f"add {name!r} above the first table" if text else f"add {name!r} above the first table, or as a table"


def _array_length(source: Source, key: Key) -> Fault:
    n = len(source.get(key))
    return source.place(key).fault("wrong-length", f"there are {n} entries", "see the schema for how many it takes")


def _words(kind: str, item: Mapping[str, Any], value: object) -> tuple[str, str, str]:
    """Code, message and advice of the errors that are neither about keys nor about lengths of arrays."""
    context: Mapping[str, Any] = item.get("ctx", {})
    match kind:
        case "fault":
            return context["code"], context["message"], context["advice"]
        case "literal_error":
            return "unknown-choice", f"{shown(value)} is none of the choices", f"write {context['expected']}"
        case "union_tag_invalid":
            tag = shown(context["tag"])
            return "unknown-choice", f"there is no shape {tag}", f"write one of {context['expected_tags']}"
        case "union_tag_not_found":
            return "missing-key", "the key 'shape' is missing or is no text", 'write shape = "box", for example'
        case "string_pattern_mismatch":
            return "bad-name", f"{shown(value)} is no name", _named(context["pattern"])
    if kind.endswith(("_type", "_parsing")):
        wanted = str(item["msg"]).removeprefix("Input should be ").split(" or ")[0]
        wanted = wanted.replace("a valid dictionary", "a table").replace("a valid tuple", "an array")
        return "wrong-type", f"{kind_of(value)} stands here", f"write {wanted.replace('a valid string', 'text')}"
    return "bad-value", f"{shown(value)} is not accepted", f"it should {str(item['msg']).partition(' should ')[2]}"


def _named(pattern: str) -> str:
    """What matches the pattern of a name, in words."""
    if r"\." in pattern:
        return 'write "object.feature"' + (", or the name of an object" if pattern.endswith("?$") else "")
    if pattern == TITLE:
        return "use 1 to 200 characters in one line, none of them hidden"
    return f"use up to 64 letters, digits{' and _' if pattern == PARAMETER else ', _ and -'}, starting with a letter"


def _existing(source: Source, loc: Sequence[str | int]) -> Key:
    """The part of an error's location that the file has; union tags and the like are stepped over."""
    key: list[str | int] = []
    value: Any = source.data
    for part in loc:
        if holds(value, part):
            key.append(part)
            value = value[part]
    return tuple(key)


def _known_keys(schema: Mapping[str, Any], key: Key, source: Source) -> list[str]:
    """The keys that the table at `key` may have, by the schema."""
    value: Any = source.data
    node = _resolved(schema, schema, value)
    for part in key:
        named = [*node.get("patternProperties", {}).values(), node.get("additionalProperties") or {}]
        child = node.get("items", {}) if isinstance(part, int) else node.get("properties", {}).get(part, named[0])
        value = value[part]
        node = _resolved(schema, child, value)
    return list(node.get("properties", {}))


def _resolved(schema: Mapping[str, Any], node: Mapping[str, Any], value: object) -> Mapping[str, Any]:
    """The schema that a reference, an optional or a choice by `shape` stands for."""
    while True:
        if "$ref" in node:
            node = schema["$defs"][node["$ref"].rsplit("/", 1)[1]]
        elif "discriminator" in node and isinstance(value, Mapping):
            tag = value.get(node["discriminator"]["propertyName"])
            mapping = node["discriminator"]["mapping"]
            node = {"$ref": mapping[tag]} if isinstance(tag, str) and tag in mapping else {}
        elif "anyOf" in node:
            node = next((choice for choice in node["anyOf"] if choice.get("type") != "null"), {})
        else:
            return node
