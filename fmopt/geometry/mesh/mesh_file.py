"""STL, OBJ, PLY, 3MF and GLB files: strict readers of their triangles, which refuse what a file does not say plainly.

Work and memory are bounded by the bytes of the file. Comments, names and materials may hold any bytes. Polygons become
fans of triangles; points that no face uses are left out.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fmopt.errors import GeometryError, ResourceError
from fmopt.geometry.facets import Indices
from fmopt.spatial.values import Array

FORMATS = ("stl", "obj", "ply", "3mf", "glb")
OWN_UNIT = ("3mf", "glb")  # formats that say their unit: their numbers become m
MAX_BYTES = 50_000_000
MAX_TRIANGLES = 100_000
_MAX_POINTS = 3 * MAX_TRIANGLES
_MAX_ROWS = 1_000_000  # of elements of a PLY file that are no points and no faces
_LONGEST_LINE = 200_000  # bytes, comments aside: a face of ten thousand corners
_LARGEST = 1e9  # coordinates in the file's own unit: 1 km in µm
_AGAIN = "export it again"
_COARSER = "export it coarser: the planner takes parts of some hundred faces"
_LINE = re.compile(rb"([^\r\n]*)(\r\n|\r|\n|\Z)")
_NUMBER = re.compile(rb"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,4})?")
_INDEX = re.compile(rb"[+-]?[0-9]{1,9}")


class _Damage(Exception):
    """What is wrong with a file and where in it."""

    def __init__(self, message: str, where: str = "", advice: str = _AGAIN) -> None:
        super().__init__(message)
        self.message, self.where, self.advice = message, where, advice


@dataclass
class _Surface:
    """Points and triangles as they are read."""

    points: list[tuple[float, float, float]] = field(default_factory=list)
    triangles: list[tuple[int, int, int]] = field(default_factory=list)

    def point(self, numbers: Sequence[float], where: str) -> None:
        """Takes a point."""
        x, y, z = numbers
        if not (abs(x) <= _LARGEST and abs(y) <= _LARGEST and abs(z) <= _LARGEST):
            raise _Damage(f"a coordinate is not a number of at most {_LARGEST:g}", where)
        if len(self.points) >= _MAX_POINTS:
            raise _Damage(f"there are more than {_MAX_POINTS} points", where, _COARSER)
        self.points.append((x, y, z))

    def face(self, corners: Sequence[int], where: str) -> None:
        """Takes a polygon, as triangles."""
        count = len(corners)
        if count < 3:
            raise _Damage(f"a face has {count} corners", where)
        if len(self.triangles) + count - 2 > MAX_TRIANGLES:
            raise _Damage(f"there are more than {MAX_TRIANGLES} triangles", where, _COARSER)
        if count == 4:
            a, b, c, d = corners
            self.triangles += [(a, b, c), (c, d, a)]
        else:
            first = corners[0]
            self.triangles += [(first, corners[i], corners[i + 1]) for i in range(1, count - 1)]

    def arrays(self) -> tuple[Array, Indices]:
        """The points in use (n, 3) and the triangles (m, 3) over them."""
        if not self.triangles:
            raise _Damage("the file holds no triangles", advice="export the solid, not a drawing or a point cloud")
        triangles = np.array(self.triangles, dtype=np.int64)
        used, renumbered = np.unique(triangles, return_inverse=True)
        points = np.array(self.points, dtype=np.float64).reshape(-1, 3)
        if used[-1] >= len(points):
            number = int(np.flatnonzero((triangles >= len(points)).any(axis=1))[0])
            raise _Damage(f"triangle {number} names point {used[-1]} of {len(points)}, counted from 0")
        return points[used], renumbered.reshape(-1, 3).astype(np.int64)


def read_triangles(path: Path) -> tuple[Array, Indices]:
    """Points (n, 3) and triangles (m, 3) of a mesh file as they stand there, in the file's own unit, or m (`OWN_UNIT`).

    Raises:
        ResourceError: the file cannot be read.
        GeometryError: no mesh format, damaged, empty or too large; says where.
    """
    kind = path.suffix.lower().removeprefix(".")
    if kind not in FORMATS:
        advice = "use .stl, .obj, .ply, .3mf or .glb, or .step with the extra step"
        raise GeometryError(f"{path}: {path.suffix or 'a name without suffix'} is no mesh format", advice)
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise ResourceError(f"cannot read mesh {path}: {error.strerror}", "check the path") from error
    readers: dict[str, Callable[[bytes], _Surface]] = {"stl": _stl, "obj": _obj, "ply": _ply}
    readers |= {"3mf": _three_mf, "glb": _glb}
    try:
        if len(data) > MAX_BYTES:
            raise _Damage(f"the file has more than {MAX_BYTES} bytes", advice=_COARSER)
        return readers[kind](data).arrays()
    except _Damage as damage:
        place = f"{path}, {damage.where}" if damage.where else str(path)
        raise GeometryError(f"{place}: {damage.message}", damage.advice) from None


def _three_mf(data: bytes) -> _Surface:
    from fmopt.geometry.mesh.archive import METRES, Broken, three_mf, together

    try:
        unit, shells = three_mf(data, MAX_BYTES)
        points, triangles = together(shells)
    except Broken as error:
        raise _Damage(str(error)) from None
    return _packed(METRES[unit] * points, triangles)


def _glb(data: bytes) -> _Surface:
    from fmopt.geometry.mesh.archive import Broken, glb, together

    try:
        return _packed(*together(glb(data)))
    except Broken as error:
        raise _Damage(str(error)) from None


def _packed(points: Array, triangles: Indices) -> _Surface:
    """Points and triangles of a package, as if read one by one."""
    surface = _Surface()
    for number, point in enumerate(points.tolist()):
        surface.point(point, f"point {number}")
    for number, corners in enumerate(triangles.tolist()):
        surface.face(corners, f"triangle {number}")
    return surface


def _lines(data: bytes, first: int = 1) -> Iterator[tuple[str, list[bytes]]]:
    """Where each line stands and its words; comments and blank lines are left out."""
    for number, found in enumerate(_LINE.finditer(data), first):
        line = found[1].lstrip()
        if not line or line.startswith((b"#", b"comment ", b"obj_info ")):
            continue
        where = f"line {number}"
        if len(line) > _LONGEST_LINE:
            raise _Damage(f"the line has {len(line)} bytes, more than {_LONGEST_LINE}", where)
        if words := line.split():
            yield where, words


def _number(word: bytes, where: str) -> float:
    if len(word) > 64 or not _NUMBER.fullmatch(word):
        raise _Damage(f"{_quoted(word)} is no finite number", where)
    return float(word)


def _index(word: bytes, where: str) -> int:
    if not _INDEX.fullmatch(word):
        raise _Damage(f"{_quoted(word)} is no index", where)
    return int(word)


def _quoted(word: bytes) -> str:
    return ascii(word[:40].decode("latin-1"))


def _stl(data: bytes) -> _Surface:
    """An STL file: binary if its size is what its count of triangles makes it, else text."""
    count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
    if len(data) == 84 + 50 * count:
        return _binary_stl(data, count)
    if data[:200].lstrip()[:5].lower() == b"solid":
        return _text_stl(data)
    if count < 0:
        raise _Damage("the file is neither a text that begins with 'solid' nor long enough for a binary STL file")
    room = (len(data) - 84) // 50
    raise _Damage(f"the header says {count} triangles, and the file holds {room} and {(len(data) - 84) % 50} bytes")


def _binary_stl(data: bytes, count: int) -> _Surface:
    if count > MAX_TRIANGLES:
        raise _Damage(f"there are {count} triangles, more than {MAX_TRIANGLES}", "the header", _COARSER)
    surface = _Surface()
    for number in range(count):
        at = 84 + 50 * number
        where = f"triangle {number}"
        for values in struct.iter_unpack("<3f", data[at + 12 : at + 48]):
            surface.point(values, where)
        surface.face((3 * number, 3 * number + 1, 3 * number + 2), where)
    return surface


_FACET: tuple[tuple[bytes, ...], ...] = (
    *((b"facet", b"normal"), (b"outer", b"loop"), (b"vertex",), (b"vertex",), (b"vertex",)),
    *((b"endloop",), (b"endfacet",)),
)


def _text_stl(data: bytes) -> _Surface:
    """Solids one after the other, each of facets in seven lines."""
    surface = _Surface()
    step, inside, where = 0, False, "line 1"
    for where, words in _lines(data):
        word = words[0].lower()
        if step == 0 and word == (b"endsolid" if inside else b"solid"):
            inside = not inside
            continue
        wanted = _FACET[step] if inside else (b"solid",)
        if tuple(each.lower() for each in words[: len(wanted)]) != wanted:
            raise _Damage(f"{_quoted(words[0])} stands where '{b' '.join(wanted).decode()}' is due", where)
        if wanted == (b"vertex",):
            if len(words) != 4:
                raise _Damage(f"a vertex has {len(words) - 1} coordinates", where)
            surface.point([_number(each, where) for each in words[1:]], where)
        step = (step + 1) % len(_FACET)
        if step == 0:
            last = len(surface.points)
            surface.face((last - 3, last - 2, last - 1), where)
    if inside:
        raise _Damage("the file ends without 'endsolid': it is not whole", where)
    return surface


_OBJ_IGNORED = frozenset(
    b"vt vn vp cstype deg bmat step l p curv curv2 surf parm trim hole scrv sp end con g s mg o bevel c_interp "
    b"d_interp lod usemtl mtllib usemap maplib shadow_obj trace_obj ctech stech call csh".split()
)


def _obj(data: bytes) -> _Surface:
    """An OBJ file: points `v`, faces `f` whose corners count from 1, or back from the last point so far."""
    surface = _Surface()
    for where, words in _lines(re.sub(rb"\\(\r\n|\r|\n)", b" ", data)):
        if words[0] == b"v":
            if not 4 <= len(words) <= 9:
                raise _Damage(f"a point has {len(words) - 1} numbers", where)
            surface.point([_number(word, where) for word in words[1:4]], where)
        elif words[0] == b"f":
            surface.face([_corner(word, len(surface.points), where) for word in words[1:]], where)
        elif words[0] not in _OBJ_IGNORED:
            raise _Damage(f"{_quoted(words[0])} is no keyword of OBJ files", where)
    return surface


def _corner(word: bytes, count: int, where: str) -> int:
    """The point, from 0, of a corner such as `3`, `3/1`, `3//2`, `3/1/2`, when there are `count` points so far."""
    index = _index(word.split(b"/", 1)[0], where)
    if index == 0 or index < -count:
        raise _Damage(f"a face names point {index} when there are {count}, counted from 1", where)
    return index - 1 if index > 0 else count + index


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
            _Damage: it has none of them.
        """
        for i, each in enumerate(self.properties):
            if each.name in names:
                return i
        raise _Damage(f"the element {self.name!r} has no property {names[0]!r}", "the header")


def _ply(data: bytes) -> _Surface:
    """A PLY file, as text or binary in either order of bytes: its elements `vertex` and `face`."""
    ending = re.search(rb"(?m)^end_header[ \t]*(\r\n|\r|\n)", data[:_LONGEST_LINE])
    if not data.startswith(b"ply") or ending is None:
        raise _Damage("the file has no header from 'ply' to 'end_header'")
    order, elements = _ply_header(data[: ending.start()])
    rows = _BinaryRows(data, ending.end(), order) if order else _TextRows(data, ending.end())
    surface = _Surface()
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
                surface.face([_ply_corner(value, where) for value in values[corners]], where)
        else:
            for number in range(element.count):
                rows.row(element, number)
    rows.end()
    return surface


def _ply_corner(value: float, where: str) -> int:
    if value < 0 or value != int(value):
        raise _Damage(f"a face names point {value:g}", where)
    return int(value)


def _ply_header(head: bytes) -> tuple[str, list[_Element]]:
    """The letter of the order of bytes, none of a text, and the elements, in the order of their rows."""
    order: str | None = None
    elements: list[_Element] = []
    for where, words in _lines(head):
        match [word.decode("latin-1") for word in words]:
            case ["ply"] if where == "line 1":
                continue
            case ["format", name, "1.0"] if name in _ORDERS and order is None:
                order = _ORDERS[name]
            case ["element", name, _] if all(each.name != name for each in elements):
                elements.append(_Element(name, _index(words[2], where)))
                most = {"vertex": _MAX_POINTS, "face": MAX_TRIANGLES}.get(name, _MAX_ROWS)
                if not 0 <= elements[-1].count <= most:
                    message = f"the header says {elements[-1].count} of the element {name!a}, more than {most}"
                    raise _Damage(message, where, _COARSER)
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties.append(_Property(name, _TYPES[kind], None))
            case ["property", "list", length, kind, name] if elements and kind in _TYPES and length in _WHOLE:
                elements[-1].properties.append(_Property(name, _TYPES[kind], _WHOLE[length]))
            case _:
                raise _Damage(f"the header is not understood at {_quoted(b' '.join(words))}", where)
    if order is None or any(not element.properties for element in elements):
        raise _Damage("the header names no format, or an element without properties")
    return order, elements


class _TextRows:
    """The rows of a PLY file as text, a line each."""

    def __init__(self, data: bytes, begin: int) -> None:
        self._lines = _lines(data[begin:], 1 + len(re.findall(rb"\r\n|\r|\n", data[:begin])))

    def row(self, element: _Element, number: int) -> tuple[str, list[Sequence[float]]]:
        """Where the next row stands, and the values of each property."""
        where, words = next(self._lines, ("its end", []))
        values: list[Sequence[float]] = []
        at = 0
        for each in element.properties:
            count = 1 if each.length is None else _index(words[at], where) if at < len(words) else 0
            at += each.length is not None
            if not 0 <= count <= len(words) - at:
                raise _Damage(f"{element.name} {number} of {element.count} is not whole", where)
            read = _index if each.type in _INTEGERS else _number
            values.append([read(word, where) for word in words[at : at + count]])
            at += count
        if at != len(words):
            raise _Damage(f"{element.name} {number} of {element.count} is {len(words) - at} words too long", where)
        return where, values

    def end(self) -> None:
        """Refuses rows that the header does not tell of."""
        for where, _ in self._lines:
            raise _Damage("the file goes on after what its header tells of", where)


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
        if count < 0 or count > len(self._data) - self._at:
            raise _Damage(
                f"a list of {count} values stands where the file has {len(self._data) - self._at} bytes", where
            )
        layout = f"{self._order}{count}{kind}"
        size = struct.calcsize(layout)
        if self._at + size > len(self._data):
            raise _Damage("the file ends here: it is not whole", where)
        values = struct.unpack_from(layout, self._data, self._at)
        self._at += size
        return values

    def end(self) -> None:
        """Refuses rows that the header does not tell of."""
        if self._data[self._at :].strip():
            raise _Damage(f"the file goes on for {len(self._data) - self._at} bytes after what its header tells of")
