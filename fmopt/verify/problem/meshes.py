"""Triangles of STL, OBJ, PLY, 3MF and GLB files, as they stand there; strict, and bounded by the size of the file."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

from fmopt.verify.problem.packages import NoMesh, Point, Triangle, glb, three_mf

__all__ = ["NoMesh", "Point", "Triangle", "triangles"]

MOST_TRIANGLES = 200_000
_TYPES = {
    **dict.fromkeys(("char", "int8"), "b"),
    **dict.fromkeys(("uchar", "uint8"), "B"),
    **dict.fromkeys(("short", "int16"), "h"),
    **dict.fromkeys(("ushort", "uint16"), "H"),
    **dict.fromkeys(("int", "int32"), "i"),
    **dict.fromkeys(("uint", "uint32"), "I"),
    **dict.fromkeys(("float", "float32"), "f"),
    **dict.fromkeys(("double", "float64"), "d"),
}


def triangles(content: bytes, kind: str, per_metre: float) -> list[Triangle]:
    """The triangles of a mesh file, m.

    Args:
        kind: its suffix, "stl", "obj", "ply", "3mf" or "glb"; the last two become m.
        per_metre: how many units of its numbers are a metre.

    Raises:
        NoMesh: it is none, or has too many triangles.
    """
    readers: dict[str, Callable[[bytes], Iterator[Triangle]]] = {"stl": _stl, "obj": _obj, "ply": _ply}
    readers |= {"3mf": three_mf, "glb": glb}
    if kind not in readers:
        raise NoMesh(f"{kind or 'a name without suffix'} is no mesh format")
    found: list[Triangle] = []
    try:
        for a, b, c in readers[kind](content):
            if len(found) >= MOST_TRIANGLES:
                raise NoMesh(f"has more than {MOST_TRIANGLES} triangles")
            found.append((_metres(a, per_metre), _metres(b, per_metre), _metres(c, per_metre)))
    except (IndexError, struct.error, UnicodeDecodeError):
        raise NoMesh(f"is no readable {kind.upper()} file") from None
    if not found:
        raise NoMesh("holds no triangles")
    return found


def _metres(p: Sequence[float], per_metre: float) -> Point:
    x, y, z = (value / per_metre for value in p)
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
        raise NoMesh("holds a number that is not finite")
    return x, y, z


def _number(word: bytes) -> float:
    try:
        return float(word)
    except ValueError:
        raise NoMesh(f"{word[:20]!r} is no number") from None


def _whole(word: bytes) -> int:
    try:
        return int(word)
    except ValueError:
        raise NoMesh(f"{word[:20]!r} is no whole number") from None


def _stl(content: bytes) -> Iterator[Triangle]:
    # By its size: a packed file, too, may begin with "solid", as text does.
    if len(content) >= 84 and len(content) == 84 + 50 * struct.unpack_from("<I", content, 80)[0]:
        for at in range(84, len(content), 50):
            x = struct.unpack_from("<9f", content, at + 12)  # behind 12 bytes of a normal, before 2 of attributes
            yield (x[0], x[1], x[2]), (x[3], x[4], x[5]), (x[6], x[7], x[8])
        return
    corners: list[Point] = []
    for line in content.splitlines():
        words = line.split()
        if words[:1] == [b"vertex"]:
            if len(words) != 4:
                raise NoMesh("has a vertex that is not three numbers")
            corners.append((_number(words[1]), _number(words[2]), _number(words[3])))
        elif words[:1] == [b"endloop"]:
            if len(corners) != 3:
                raise NoMesh("has a facet that is no triangle")
            yield corners[0], corners[1], corners[2]
            corners = []


def _obj(content: bytes) -> Iterator[Triangle]:
    points: list[Point] = []
    # A line whose last character is a backslash goes on in the next one.
    for line in re.sub(rb"\\(\r\n|\r|\n)", b" ", content).splitlines():
        words = line.split(b"#", 1)[0].split()
        if words[:1] == [b"v"]:
            points.append((_number(words[1]), _number(words[2]), _number(words[3])))
        elif words[:1] == [b"f"]:
            indices = [_whole(word.split(b"/")[0]) for word in words[1:]]
            # Counted from 1, or back from the last vertex that stands before the face.
            yield from _fan(points, [k - 1 if k > 0 else len(points) + k for k in indices])


def _fan(points: Sequence[Point], loop: Sequence[int]) -> Iterator[Triangle]:
    if len(loop) < 3 or not all(0 <= k < len(points) for k in loop):
        raise NoMesh("has a face of vertices that are not there")
    for b, c in pairwise(loop[1:]):
        yield points[loop[0]], points[b], points[c]


def _ply(content: bytes) -> Iterator[Triangle]:
    end = content.find(b"end_header")
    if not content.startswith(b"ply") or end < 0:
        raise NoMesh("has no PLY header")
    begin = content.index(b"\n", end) + 1 if b"\n" in content[end:] else len(content)
    encoding, elements = _header(content[:end].decode("ascii", "replace"))
    words = _Words(content[begin:]) if encoding == "ascii" else _Bytes(content[begin:], encoding)
    points: list[Point] = []
    for name, count, properties in elements:
        for _ in range(count):
            row = {key: words.take(kind, of) for key, kind, of in properties}
            if name == "vertex":
                x, y, z = (row.get(axis, [math.nan])[0] for axis in "xyz")  # no axis: not finite, refused
                points.append((x, y, z))
            elif name == "face":
                loop = row.get("vertex_indices", row.get("vertex_index", []))
                # In a file of floats they may be such that no integer is.
                if not all(map(math.isfinite, loop)):
                    raise NoMesh("has a face of vertices that are not there")
                yield from _fan(points, [int(k) for k in loop])


_Element = tuple[str, int, list[tuple[str, str, str]]]


def _header(text: str) -> tuple[str, list[_Element]]:
    encoding, elements = "", list[_Element]()
    for line in text.splitlines():
        words = line.split()
        if words[:1] == ["format"] and len(words) > 1:
            encoding = {"ascii": "ascii", "binary_little_endian": "<", "binary_big_endian": ">"}.get(words[1], "")
        elif words[:1] == ["element"] and len(words) == 3 and words[2].isascii() and words[2].isdigit():
            elements.append((words[1], int(words[2][:9]), []))
        elif words[:1] == ["property"] and elements:
            kinds = words[2:4] if words[1:2] == ["list"] else ["", *words[1:2]]
            if len(kinds) != 2 or not all(kind in _TYPES for kind in kinds if kind) or not kinds[1]:
                raise NoMesh("has a property of an unknown type")
            elements[-1][2].append((words[-1], _TYPES[kinds[1]], _TYPES.get(kinds[0], "")))
    if not encoding or not all(properties for _, _, properties in elements):
        raise NoMesh("has a header that says no format, or an element without properties")
    return encoding, elements


class _Words:
    """Numbers of a text, one after the other."""

    def __init__(self, content: bytes) -> None:
        self._words = iter(content.split())

    def take(self, kind: str, of: str) -> list[float]:
        """One number, or a list with its length before it."""
        count = self._next() if of else 1.0
        if not 0.0 <= count <= 1e6:
            raise NoMesh("has a list of no length")
        return [self._next() for _ in range(int(count))]

    def _next(self) -> float:
        word = next(self._words, None)
        if word is None:
            raise NoMesh("ends too early")
        return _number(word)


class _Bytes(_Words):
    """The same of packed numbers."""

    def __init__(self, content: bytes, order: str) -> None:
        self._content, self._order, self._at = content, order, 0

    def take(self, kind: str, of: str) -> list[float]:
        """One number, or a list with its length before it."""
        count = self._unpacked(of, 1)[0] if of else 1.0
        # A length longer than the file, taken at its word, would ask for that much memory.
        if not 0.0 <= count <= len(self._content):
            raise NoMesh("has a list of no length")
        return self._unpacked(kind, int(count))

    def _unpacked(self, kind: str, count: int) -> list[float]:
        form = f"{self._order}{count}{kind}"
        found = struct.unpack_from(form, self._content, self._at)
        self._at += struct.calcsize(form)
        return [float(x) for x in found]
