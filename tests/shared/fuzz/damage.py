"""Damage to files, drawn from seeds: bytes, words, lines, keys and nesting, as disks, editors and exporters do it."""

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
TEXTS = (
    *(b"null", b"{}", b"[]", b'""', b"true", b"1", b'"\\u0000"', b"[[1], 2]", b"1979-05-27", b'"1 / 0"', b'"(((1"'),
)
STRAY = (b"\xe9", b"\x00", b"\xff\xfe", b"\r", b"\n", b"\x85", b"\x0c", b"\x1b[31m", b"\x91\xe2\x82")
BRACKETS = ((b"[", b"]"), (b'{"a":', b"}"), (b"{a=", b"}"), (b"(", b")"))
Damage = Callable[[random.Random, bytes], bytes]


def damaged(rng: random.Random, content: bytes, *, data: bool = False) -> bytes:
    """The content with one to three kinds of damage; `data` says that it is JSON, whose values can be damaged too."""
    kinds: list[Damage] = [*_BYTES, *_TEXT, *_TEXT, *([_value] * 12 if data else [])]
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        content = rng.choice(kinds)(rng, content)
    return content


def _flipped(rng: random.Random, content: bytes) -> bytes:
    changed = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 8, 40)) if content else 0):
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _cut(rng: random.Random, content: bytes) -> bytes:
    """Bytes inserted, bytes deleted, or all bytes after a place lost."""
    at, count = rng.randrange(len(content) + 1), rng.choice((0, 1, 1, 2, 5, 50, 500, len(content)))
    return content[:at] + (b"" if count else rng.choice(STRAY)) + content[at + count :]


def _encoded(rng: random.Random, content: bytes) -> bytes:
    ends = b"".join(line + rng.choice((b"\n", b"\r\n", b"\r")) for line in content.split(b"\n"))
    marked, wide = b"\xef\xbb\xbf" + content, content.decode("latin-1").encode("utf-16")
    lines = (content.replace(b"\n", end) for end in (b"\r\n", b"\r"))
    return rng.choice((marked, wide, ends, *lines, content.replace(b"e", b"\xe9"), content.upper()))


def _replaced(rng: random.Random, content: bytes, pattern: re.Pattern[bytes], other: Callable[[bytes], bytes]) -> bytes:
    """The content, one match of a pattern replaced by another text; as it was where nothing matches."""
    found = list(pattern.finditer(content))
    if not found:
        return content
    one = rng.choice(found)
    return content[: one.start()] + other(one[0]) + content[one.end() :]


def _scaled(rng: random.Random, number: bytes) -> bytes:
    return repr(float(number) * rng.choice(FACTORS)).encode()


def _number(rng: random.Random, content: bytes) -> bytes:
    many = rng.random() < 0.5
    return _replaced(rng, content, NUMBER, lambda one: rng.choice(NUMBERS) if many else _scaled(rng, one))


def _all_numbers(rng: random.Random, content: bytes) -> bytes:
    """Every number that is alike by one factor: another unit."""
    like = rng.choice([found[0] for found in NUMBER.finditer(content)] or [b"1"])
    other = _scaled(rng, like)
    return NUMBER.sub(lambda one: other if one[0] == like else one[0], content)


def _word(rng: random.Random, content: bytes) -> bytes:
    other = rng.choice(WORD.findall(content) or [b""])
    odd = (b"", other, b"x" * 300, b"../" * 9)
    return _replaced(rng, content, WORD, lambda one: rng.choice((*odd, one + b"x", one[:-1], one * 2, one.upper())))


def _nested(rng: random.Random, content: bytes) -> bytes:
    depth, (opening, closing) = rng.choice((3, 30, 1000, 100_000)), rng.choice(BRACKETS)
    return _replaced(rng, content, NUMBER, lambda one: opening * depth + one + closing * depth)


def _lines(rng: random.Random, content: bytes) -> bytes:
    """A line dropped, moved, exchanged with another, repeated, or made longer."""
    lines = content.split(b"\n")
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(5):
        case 0:
            del lines[i]
        case 1:
            lines.insert(j, lines.pop(i))
        case 2:
            lines[i], lines[j] = lines[j], lines[i]
        case 3:
            lines[i : i + 1] = [lines[i]] * rng.choice((2, 30, 1000))
        case _:
            lines[i] += lines[i][-1:] * rng.choice((100, 10_000, 300_000))
    return b"\n".join(lines)


def _key(rng: random.Random, content: bytes) -> bytes:
    """A key of a table renamed, or given another value."""
    lines = content.split(b"\n")
    with_keys = [i for i, line in enumerate(lines) if b" = " in line or b'": ' in line]
    if not with_keys:
        return content
    i = rng.choice(with_keys)
    between = b" = " if b" = " in lines[i] else b'": '
    key, value = lines[i].split(between, 1)
    comma = b"," if value.rstrip().endswith(b",") else b""
    lines[i] = rng.choice(
        (key + b"x" + between + value, key + between + rng.choice(TEXTS) + comma, key + between + value.swapcase())
    )
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


_BYTES: tuple[Damage, ...] = (_flipped, _cut, _cut, _cut, _encoded)
_TEXT: tuple[Damage, ...] = (_number, _number, _all_numbers, _word, _lines, _nested, _key)
