"""Damage to files, drawn from seeds: bytes, words, lines, keys and nesting, as disks, editors and exporters do it."""

from __future__ import annotations

import json
import random
import re
from collections.abc import Callable
from typing import Any

NUMBER = re.compile(rb"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
WORD = re.compile(rb"[^\s,\[\](){}=:\"/]+")
NUMBERS = (
    *(b"nan", b"inf", b"-inf", b"1e400", b"-0", b"0", b"1e31", b"-1e31", b"1e-300", b"9" * 25, b"9" * 5000, b"1_0"),
    *("²".encode(), "٣".encode(), b"0x10", b"-1", b"1", b"", b"1.5", b"true", b"null", b'"1 mm"', b"4294967295"),
)
FACTORS = (-1.0, 1e-9, 1e-6, 1e-3, 0.5, 1.0 - 1e-9, 1.0 + 1e-9, 1.001, 2.0, 1e3, 1e6)
VALUES: tuple[Any, ...] = (
    *(None, True, 0, -1, 1, 0.5, 1e31, -1e-300, 10**30, "", "²", "a\nb", "\x1b[31m", "nan", [], {}, [[]], [None]),
    *({"a": 1}, [1, 2, 3], float("nan"), float("inf")),
)
Damage = Callable[[random.Random, bytes], bytes]


def damaged(rng: random.Random, content: bytes, *, data: bool = False) -> bytes:
    """The content with one to three kinds of damage.

    Args:
        rng: what draws them.
        content: a whole file.
        data: whether it is JSON, whose values can be damaged as such.
    """
    kinds: list[Damage] = [*_BYTES, *_TEXT, *_TEXT, *([_value] * 12 if data else [])]
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        content = rng.choice(kinds)(rng, content)
    return content


def _place(rng: random.Random, content: bytes) -> int:
    return rng.randrange(len(content) + 1)


def _flipped(rng: random.Random, content: bytes) -> bytes:
    changed = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 8, 40))):
        if changed:
            changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _inserted(rng: random.Random, content: bytes) -> bytes:
    at = _place(rng, content)
    what = rng.choice(
        (b"\xe9", b"\x00", b"\xff\xfe", b"\r", b"\n", b"\x85", b"\x0c", b"\x1b[31m", rng.randbytes(rng.randrange(1, 9)))
    )
    return content[:at] + what + content[at:]


def _deleted(rng: random.Random, content: bytes) -> bytes:
    at = _place(rng, content)
    return content[:at] + content[at + rng.choice((1, 1, 2, 5, 50, 500)) :]


def _truncated(rng: random.Random, content: bytes) -> bytes:
    return content[: _place(rng, content)]


def _encoded(rng: random.Random, content: bytes) -> bytes:
    text = content.decode("latin-1")
    return rng.choice(
        (
            lambda: b"\xef\xbb\xbf" + content,
            lambda: text.encode("utf-16"),
            lambda: content.replace(b"\n", b"\r\n"),
            lambda: content.replace(b"\n", b"\r"),
            lambda: b"".join(line + rng.choice((b"\n", b"\r\n", b"\r")) for line in content.split(b"\n")),
            lambda: content.replace(b"e", "é".encode("latin-1")),
            lambda: content.upper(),
        )
    )()


def _number(rng: random.Random, content: bytes) -> bytes:
    found = list(NUMBER.finditer(content))
    if not found:
        return content
    one = rng.choice(found)
    what = rng.choice(NUMBERS) if rng.random() < 0.5 else repr(float(one[0]) * rng.choice(FACTORS)).encode()
    return content[: one.start()] + what + content[one.end() :]


def _all_numbers(rng: random.Random, content: bytes) -> bytes:
    """Every number that has a decimal point, or is alike, by one factor: another unit."""
    factor = rng.choice(FACTORS)
    like = rng.choice([found[0] for found in NUMBER.finditer(content)] or [b"1"])
    return NUMBER.sub(lambda one: repr(float(one[0]) * factor).encode() if one[0] == like else one[0], content)


def _word(rng: random.Random, content: bytes) -> bytes:
    found = list(WORD.finditer(content))
    if not found:
        return content
    one, other = rng.choice(found), rng.choice(found)
    what = rng.choice((b"", other[0], one[0] + b"x", one[0][:-1], one[0] * 2, b"x" * 300, b"../" * 9, one[0].upper()))
    return content[: one.start()] + what + content[one.end() :]


def _lines(rng: random.Random, content: bytes) -> bytes:
    lines = content.split(b"\n")
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(6):
        case 0:
            lines.insert(j, lines[i])
        case 1:
            del lines[i]
        case 2:
            lines.insert(j, lines.pop(i))
        case 3:
            lines[i], lines[j] = lines[j], lines[i]
        case 4:
            lines[i : i + 1] = [lines[i]] * rng.choice((2, 30, 1000))
        case _:
            lines[i] += lines[i][-1:] * rng.choice((100, 10_000, 300_000))
    return b"\n".join(lines)


def _nested(rng: random.Random, content: bytes) -> bytes:
    depth = rng.choice((3, 30, 1000, 100_000))
    opening, closing = rng.choice(((b"[", b"]"), (b'{"a":', b"}"), (b"{a=", b"}"), (b"(", b")")))
    found = list(NUMBER.finditer(content)) or [re.match(rb"", content)]
    one = rng.choice(found)
    assert one is not None
    return content[: one.start()] + opening * depth + one[0] + closing * depth + content[one.end() :]


def _key(rng: random.Random, content: bytes) -> bytes:
    """A key of a table dropped, renamed, or given another value."""
    lines = content.split(b"\n")
    with_keys = [i for i, line in enumerate(lines) if b" = " in line or b'": ' in line]
    if not with_keys:
        return content
    i = rng.choice(with_keys)
    between = b" = " if b" = " in lines[i] else b'": '
    key, value = lines[i].split(between, 1)
    comma = b"," if value.rstrip().endswith(b",") else b""
    texts = (
        b"null",
        b"{}",
        b"[]",
        b'""',
        b"true",
        b"1",
        b'"\\u0000"',
        b"[[1], 2]",
        b"1979-05-27",
        b'"1 / 0"',
        b'"(((1"',
    )
    match rng.randrange(3):
        case 0:
            lines[i] = key + b"x" + between + value
        case 1:
            lines[i] = key + between + rng.choice(texts) + comma
        case _:
            lines[i] = key + between + value.swapcase()
    return b"\n".join(lines)


def _value(rng: random.Random, content: bytes) -> bytes:
    """A value somewhere in JSON dropped, renamed, repeated or replaced."""
    try:
        whole = json.loads(content)
    except (ValueError, RecursionError):
        return content
    place = whole
    while True:
        keys = list(place) if isinstance(place, dict) else list(range(len(place)))
        if not keys:
            return content
        key = rng.choice(keys)
        if not isinstance(place[key], dict | list) or not place[key] or rng.random() < 0.1:
            break
        place = place[key]
    match rng.randrange(6):
        case 0:
            del place[key]
        case 1 if isinstance(place, dict):
            place[f"{key}x"] = place.pop(key)
        case 2 if isinstance(place, list):
            place.extend([place[key]] * rng.choice((1, 2, 300)))
        case 3 if isinstance(place[key], int | float):
            place[key] = place[key] * rng.choice(FACTORS)
        case _:
            place[key] = rng.choice(VALUES)
    return json.dumps(whole).encode()


_BYTES: tuple[Damage, ...] = (_flipped, _inserted, _deleted, _truncated, _encoded)
_TEXT: tuple[Damage, ...] = (_number, _number, _all_numbers, _word, _lines, _nested, _key)
