"""Pydantic's errors as faults of this project: with line, column, key, code and advice."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

from pydantic import ValidationError

from fmopt.errors import Fault
from fmopt.task.tables import Reading, Table, kind_of, shown
from fmopt.task.toml_source import Key, Source, dotted, holds
from fmopt.task.units import did_you_mean

T = TypeVar("T", bound=Table)

_LENGTH_ERRORS = {"too_short", "too_long"}


def checked(table: type[T], source: Source, reading: Reading) -> tuple[T | None, list[Fault]]:
    """The contents of a file as `table`, or all its faults.

    Args:
        table: the class of the whole file.
        source: the document.
        reading: what its numbers mean.
    """
    try:
        return table.model_validate(_tuples(source.data), context=reading), []
    except ValidationError as error:
        schema = table.model_json_schema()
        found = [_fault(source, schema, item) for item in error.errors(include_url=False, include_context=True)]
        return None, list(dict.fromkeys(found))


def _tuples(value: Any) -> Any:
    """The same data with arrays as tuples, which is what strict validation takes for them."""
    if isinstance(value, Mapping):
        return {key: _tuples(child) for key, child in value.items()}
    return tuple(_tuples(child) for child in value) if isinstance(value, list) else value


def _fault(source: Source, schema: Mapping[str, Any], item: Mapping[str, Any]) -> Fault:
    kind, loc = str(item["type"]), tuple(item["loc"])
    key = _existing(source, loc)
    if kind == "missing" and loc and isinstance(loc[-1], int):
        return _array_length(source, key)
    if kind == "missing":
        place = source.place(key, of_key=True)
        place = replace(place, key=dotted((*key, loc[-1])))
        return place.fault("missing-key", "this key is missing", _add(key, loc[-1]))
    if kind == "extra_forbidden":
        known = _known_keys(schema, key[:-1], source)
        advice = did_you_mean(str(key[-1]), known) or f"known keys here: {', '.join(known)}"
        return source.place(key, of_key=True).fault("unknown-key", "there is no such key", advice)
    if loc and loc[-1] == "[key]":
        code, message, advice = _words(kind, item, key[-1])
        return source.place(key, of_key=True).fault(code, message, advice)
    place = source.place(key)
    if kind in _LENGTH_ERRORS:
        return _array_length(source, key)
    code, message, advice = _words(kind, item, source.get(key))
    return place.fault(code, message, advice)


def _add(key: Key, name: str | int) -> str:
    return f"add {name!r} to [{dotted(key)}]" if key else f"add {name!r} above the first table, or as a table"


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
            return "bad-name", f"{shown(value)} is no name", "use letters, digits and _, starting with a letter"
    if kind.endswith(("_type", "_parsing")):
        wanted = str(item["msg"]).removeprefix("Input should be ").split(" or an instance")[0]
        wanted = wanted.replace("a valid dictionary", "a table").replace("a valid tuple", "an array")
        return "wrong-type", f"{kind_of(value)} stands here", f"write {wanted.replace('a valid string', 'text')}"
    return "bad-value", f"{shown(value)} is not accepted", str(item["msg"]).replace("Input should", "it should")


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
    node: Mapping[str, Any] = schema
    value: Any = source.data
    for part in (*key, None):
        node = _resolved(schema, node, value)
        if part is None:
            break
        if isinstance(part, int):
            node, value = node.get("items", {}), value[part]
            continue
        named = [*node.get("patternProperties", {}).values(), node.get("additionalProperties") or {}]
        node = node.get("properties", {}).get(part, named[0])
        value = value[part]
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
