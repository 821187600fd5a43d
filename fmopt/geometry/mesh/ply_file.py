"""PLY files, as text or binary in either order of bytes."""

import math
import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field

from fmopt.geometry.mesh.surface import (
    COARSER,
    LONGEST_LINE,
    MAX_POINTS,
    MAX_TRIANGLES,
    Damage,
    Surface,
    index_of,
    lines_of,
    number_of,
    quoted,
)

_MAX_ROWS = 1_000_000  # of elements that are no points and no faces
_NAMES = "char uchar short ushort int uint float double int8 uint8 int16 uint16 int32 uint32 float32 float64"
_TYPES = dict(zip(_NAMES.split(), "bBhHiIfdbBhHiIfd", strict=True))
_INTEGERS = frozenset("bBhHiI")
_WHOLE = {name: letter for name, letter in _TYPES.items() if letter in _INTEGERS}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True)
class _Property:
    """A property of an element: the letters of its type and, of a list, of the type of its length."""

    name: str
    type: str
    length: str | None


@dataclass(frozen=True)
class _Element:
    """A kind of row of a PLY file, and how many there are."""

    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)

    def column(self, *names: str) -> int:
        """Where the first of these properties stands.

        Raises:
            Damage: it has none of them.
        """
        for i, each in enumerate(self.properties):
            if each.name in names:
                return i
        raise Damage(f"the element {self.name!r} has no property {names[0]!r}", "the header")


def read_ply(data: bytes) -> Surface:
    """The elements `vertex` and `face` of a PLY file."""
    # Only in the beginning, so that no large file is searched for what it does not have.
    ending = re.search(rb"(?m)^end_header[ \t]*(\r\n|\r|\n)", data[:LONGEST_LINE])
    if not data.startswith(b"ply") or ending is None:
        raise Damage("the file has no header from 'ply' to 'end_header'")
    order, elements = _header(data[: ending.start()])
    rows = _BinaryRows(data, ending.end(), order) if order else _TextRows(data, ending.end())
    surface = Surface()
    for element in elements:
        if element.name == "vertex":
            x, y, z = (element.column(axis) for axis in "xyz")
            for number in range(element.count):
                where, values = rows.row(element, number)
                surface.point((values[x][0], values[y][0], values[z][0]), where)
        elif element.name == "face":
            corners = element.column("vertex_indices", "vertex_index")
            for number in range(element.count):
                where, values = rows.row(element, number)
                surface.face([_corner(value, where) for value in values[corners]], where)
        else:
            # Lists give each row a length of its own, so that rows cannot be skipped unread.
            for number in range(element.count):
                rows.row(element, number)
    rows.end()
    return surface


def _corner(value: float, where: str) -> int:
    # In a file of floats a corner may be none that there is an integer of.
    if not math.isfinite(value) or value < 0 or value != int(value):
        raise Damage(f"a face names point {value:g}", where)
    return int(value)


def _header(head: bytes) -> tuple[str, list[_Element]]:
    """The letter of the order of bytes, none of a text, and the elements, in the order of their rows."""
    order: str | None = None
    elements: list[_Element] = []
    for where, words in lines_of(head):
        match [word.decode("latin-1") for word in words]:
            case ["ply"] if where == "line 1":
                continue
            case ["format", name, "1.0"] if name in _ORDERS and order is None:
                order = _ORDERS[name]
            case ["element", name, _] if all(each.name != name for each in elements):
                elements.append(_Element(name, index_of(words[2], where)))
                most = {"vertex": MAX_POINTS, "face": MAX_TRIANGLES}.get(name, _MAX_ROWS)
                if not 0 <= elements[-1].count <= most:
                    message = f"the header says {elements[-1].count} of the element {name!a}, more than {most}"
                    raise Damage(message, where, COARSER)
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties.append(_Property(name, _TYPES[kind], None))
            case ["property", "list", length, kind, name] if elements and kind in _TYPES and length in _WHOLE:
                elements[-1].properties.append(_Property(name, _TYPES[kind], _WHOLE[length]))
            case _:
                raise Damage(f"the header is not understood at {quoted(b' '.join(words))}", where)
    # Rows without properties would have no bytes, and their count no bound in the file.
    if order is None or any(not element.properties for element in elements):
        raise Damage("the header names no format, or an element without properties")
    return order, elements


class _TextRows:
    """The rows of a PLY file as text, a line each."""

    def __init__(self, data: bytes, begin: int) -> None:
        self._lines = lines_of(data[begin:], 1 + len(re.findall(rb"\r\n|\r|\n", data[:begin])))

    def row(self, element: _Element, number: int) -> tuple[str, list[Sequence[float]]]:
        """Where the next row stands, and the values of each property."""
        where, words = next(self._lines, ("its end", []))
        values: list[Sequence[float]] = []
        at = 0
        for each in element.properties:
            # Where the length itself is missing, `at` goes past the end and the row is refused below.
            count = 1 if each.length is None else index_of(words[at], where) if at < len(words) else 0
            at += each.length is not None
            if not 0 <= count <= len(words) - at:
                raise Damage(f"{element.name} {number} of {element.count} is not whole", where)
            read = index_of if each.type in _INTEGERS else number_of
            values.append([read(word, where) for word in words[at : at + count]])
            at += count
        if at != len(words):
            raise Damage(f"{element.name} {number} of {element.count} is {len(words) - at} words too long", where)
        return where, values

    def end(self) -> None:
        """Refuses rows that the header does not tell of."""
        for where, _ in self._lines:
            raise Damage("the file goes on after what its header tells of", where)


class _BinaryRows:
    """The rows of a PLY file in binary."""

    def __init__(self, data: bytes, begin: int, order: str) -> None:
        self._data, self._at, self._order = data, begin, order

    def row(self, element: _Element, number: int) -> tuple[str, list[Sequence[float]]]:
        """Where the next row stands, and the values of each property."""
        where = f"{element.name} {number} of {element.count}"
        values: list[Sequence[float]] = []
        for each in element.properties:
            count = 1 if each.length is None else int(self._take(1, each.length, where)[0])
            values.append(self._take(count, each.type, where))
        return where, values

    def _take(self, count: int, kind: str, where: str) -> tuple[float, ...]:
        # Before `struct` sees it: the count is the file's, and each value has a byte at least.
        if count < 0 or count > len(self._data) - self._at:
            raise Damage(
                f"a list of {count} values stands where the file has {len(self._data) - self._at} bytes", where
            )
        layout = f"{self._order}{count}{kind}"
        size = struct.calcsize(layout)
        if self._at + size > len(self._data):
            raise Damage("the file ends here: it is not whole", where)
        values = struct.unpack_from(layout, self._data, self._at)
        self._at += size
        return values

    def end(self) -> None:
        """Refuses rows that the header does not tell of."""
        if self._data[self._at :].strip():
            raise Damage(f"the file goes on for {len(self._data) - self._at} bytes after what its header tells of")
