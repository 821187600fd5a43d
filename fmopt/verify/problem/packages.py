"""Triangles of 3MF and GLB files in m, where their build or scene puts them."""

from __future__ import annotations

import io
import json
import lzma
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any
from xml.parsers import expat

Point = tuple[float, float, float]
Triangle = tuple[Point, Point, Point]
Matrix = tuple[tuple[float, ...], ...]
_METRES = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "inch": 0.0254, "foot": 0.3048, "meter": 1.0}
_ONE: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
_DEEPEST, _LARGEST = 32, 50_000_000
_MOST = 1_000_000  # solids that are put together and their points: a few lines can say to put each of them twice
_COUNTS = (5121, 5123, 5125)  # kinds of numbers that are whole and not negative
_LETTERS = {5120: "b", 5121: "B", 5122: "h", 5123: "H", 5125: "I", 5126: "f"}

_UNREADABLE = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error),
    *(EOFError, NotImplementedError, RuntimeError, OSError, ValueError, LookupError),
)


class NoMesh(ValueError):
    """A file that is no mesh, in words."""


def three_mf(content: bytes) -> Iterator[Triangle]:
    """The triangles of a 3MF file, m.

    Raises:
        NoMesh: it is none.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            names = [name for name in archive.namelist() if name.lower().endswith(".model")]
            if len(names) != 1:
                raise NoMesh("holds no model, or several")
            with archive.open(names[0]) as file:
                text = file.read(_LARGEST + 1)  # no more is unpacked, whatever size is stated
    except NoMesh:  # a ValueError, and no broken archive
        raise
    except _UNREADABLE:
        raise NoMesh("is no readable archive") from None
    if len(text) > _LARGEST:
        raise NoMesh("has a model that is too large")
    return _Model(text).triangles()


class _Model:
    """A 3MF model: meshes, solids made of others, and what is built, each with a matrix."""

    def __init__(self, text: bytes) -> None:
        self.unit, self.now, self.put = 1e-3, "", _Put()
        self.points: dict[str, list[Point]] = {}
        self.faces: dict[str, list[tuple[int, int, int]]] = {}
        self.parts: dict[str, list[tuple[str, Matrix]]] = {}
        self.build: list[tuple[str, Matrix]] = []
        parser = expat.ParserCreate()
        parser.StartElementHandler = self._element
        parser.StartDoctypeDeclHandler = self._refuse  # its entities could grow without end
        try:
            parser.Parse(text, True)
        except NoMesh:
            raise
        except (expat.ExpatError, KeyError, ValueError, OverflowError):
            raise NoMesh("has a model that cannot be read") from None

    @staticmethod
    def _refuse(*_: object) -> None:
        raise NoMesh("declares a document type")

    def _element(self, name: str, of: Mapping[str, str]) -> None:
        tag = name.rpartition(":")[2]  # without the prefix of a namespace
        if tag == "model":
            self.unit = _METRES[of.get("unit", "millimeter")]
        elif tag == "object":
            self.now = of["id"]
        elif tag == "vertex":
            self.points.setdefault(self.now, []).append((float(of["x"]), float(of["y"]), float(of["z"])))
        elif tag == "triangle":
            self.faces.setdefault(self.now, []).append((int(of["v1"]), int(of["v2"]), int(of["v3"])))
        elif tag == "component":
            self.parts.setdefault(self.now, []).append((of["objectid"], _twelve(of.get("transform"))))
        elif tag == "item":
            self.build.append((of["objectid"], _twelve(of.get("transform"))))

    def triangles(self) -> Iterator[Triangle]:
        """The triangles of what is built, or of all that is no part of another where nothing is."""
        within = {name for made in self.parts.values() for name, _ in made}
        alone = [(name, _ONE) for name in {**self.faces, **self.parts} if name not in within]
        for name, place in self.build or alone:
            for corners in self._of(name, place, 0):
                yield _scaled(corners, self.unit)

    def _of(self, name: str, place: Matrix, depth: int) -> Iterator[Triangle]:
        if depth > _DEEPEST or not (name in self.faces or name in self.parts):
            raise NoMesh("is built of a solid that is not there, or made of itself")
        self.put.more(1 + len(self.points.get(name, [])))
        if name in self.faces:
            yield from _placed(self.points.get(name, []), self.faces[name], place)
        for part, own in self.parts.get(name, ()):
            yield from self._of(part, _after(own, place), depth + 1)


def _twelve(text: str | None) -> Matrix:
    if text is None:
        return _ONE
    x = [float(word) for word in text.split()]
    if len(x) != 12:
        raise NoMesh("has a transform that is not twelve numbers")
    return tuple(tuple(x[3 * i : 3 * i + 3]) for i in range(4))


def _after(first: Matrix, then: Matrix) -> Matrix:
    """The matrix (4 rows of 3, the last one the shift) of one placing after another."""
    rows = [[sum(row[k] * then[k][j] for k in range(3)) for j in range(3)] for row in first]
    rows[3] = [x + s for x, s in zip(rows[3], then[3], strict=True)]
    return tuple(map(tuple, rows))


def _placed(points: Sequence[Point], faces: Sequence[Sequence[int]], place: Matrix) -> Iterator[Triangle]:
    there = [
        (
            x * place[0][0] + y * place[1][0] + z * place[2][0] + place[3][0],
            x * place[0][1] + y * place[1][1] + z * place[2][1] + place[3][1],
            x * place[0][2] + y * place[1][2] + z * place[2][2] + place[3][2],
        )
        for x, y, z in points
    ]
    for a, b, c in faces:
        if min(a, b, c) < 0 or max(a, b, c) >= len(there):
            raise NoMesh("has a face of vertices that are not there")
        yield there[a], there[b], there[c]


def _scaled(corners: Triangle, unit: float) -> Triangle:
    (a, b, c), (d, e, f), (g, h, i) = corners
    return (a * unit, b * unit, c * unit), (d * unit, e * unit, f * unit), (g * unit, h * unit, i * unit)


def glb(content: bytes) -> Iterator[Triangle]:
    """The triangles of a GLB file, m.

    Raises:
        NoMesh: it is none.
    """
    try:
        magic, version, length = struct.unpack_from("<4sII", content)
        if magic != b"glTF" or version != 2 or length != len(content):
            raise NoMesh("is no GLB file of version 2")
        chunks: dict[int, bytes] = {}
        at = 12
        while at < len(content):
            size, kind = struct.unpack_from("<II", content, at)
            chunks.setdefault(kind, content[at + 8 : at + 8 + size])
            at += 8 + size
        scene = json.loads(chunks[0x4E4F534A])  # the chunk "JSON"
        yield from _scene(scene, chunks.get(0x004E4942, b""))  # and "BIN"
    except NoMesh:
        raise
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, struct.error, RecursionError):
        raise NoMesh("has a scene that cannot be followed") from None


def _scene(scene: Any, block: bytes) -> Iterator[Triangle]:
    put = _Put()
    if "nodes" not in scene:
        for mesh in scene.get("meshes", []):
            yield from _primitives(scene, block, mesh, _ONE, put)
        return
    listed = [child for node in scene["nodes"] for child in node.get("children", [])]
    within = {*listed}
    if len(within) < len(listed):
        raise NoMesh("has a node that is a part of two others")
    roots = set(range(len(scene["nodes"]))) - within
    if "scenes" in scene:
        roots = scene["scenes"][scene.get("scene", 0)]["nodes"]
    for root in roots:
        yield from _node(scene, block, root, (_ONE, 0), put)


class _Put:
    """How many solids and points have been put together."""

    def __init__(self) -> None:
        self._count = 0

    def more(self, count: int) -> None:
        """So many more.

        Raises:
            NoMesh: they are too many.
        """
        self._count += count
        if self._count > _MOST:
            raise NoMesh("puts too many solids together")


def _node(scene: Any, block: bytes, number: int, above: tuple[Matrix, int], put: _Put) -> Iterator[Triangle]:
    place, depth = above
    if depth > _DEEPEST:
        raise NoMesh("has a node that is a part of itself")
    put.more(1)
    node = scene["nodes"][number]
    here = _after(_matrix(node), place)
    if "mesh" in node:
        yield from _primitives(scene, block, scene["meshes"][node["mesh"]], here, put)
    for child in node.get("children", []):
        yield from _node(scene, block, child, (here, depth + 1), put)


def _matrix(node: Mapping[str, Any]) -> Matrix:
    if "matrix" in node:
        m = [float(x) for x in node["matrix"]]
        # Columns in the file are rows here, as points stand before their matrix.
        return tuple(tuple(m[4 * i : 4 * i + 3]) for i in range(4))
    x, y, z, w = (float(q) for q in node.get("rotation", (0.0, 0.0, 0.0, 1.0)))
    turn = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)),
        (2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)),
        (2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)),
    )
    sizes = [float(s) for s in node.get("scale", (1.0, 1.0, 1.0))]
    rows = [tuple(s * t for t in row) for s, row in zip(sizes, turn, strict=True)]
    return (*rows, tuple(float(t) for t in node.get("translation", (0.0, 0.0, 0.0))))


def _primitives(scene: Any, block: bytes, mesh: Any, place: Matrix, put: _Put) -> Iterator[Triangle]:
    for part in mesh["primitives"]:
        if part.get("mode", 4) != 4 or "extensions" in part:
            raise NoMesh("has a mesh that is not of plain triangles")
        rows = _numbers(scene, block, part["attributes"]["POSITION"])
        points = [(x, y, z) for x, y, z in rows]
        put.more(1 + len(points))
        order: Sequence[int] = range(len(points))
        if "indices" in part:
            if scene["accessors"][part["indices"]]["componentType"] not in _COUNTS:
                raise NoMesh("has a triangle whose corners are no counts")
            order = [int(row[0]) for row in _numbers(scene, block, part["indices"])]
        if len(order) % 3:
            raise NoMesh("has a triangle that is not whole")
        yield from _placed(points, [order[k : k + 3] for k in range(0, len(order), 3)], place)


def _numbers(scene: Any, block: bytes, number: int) -> list[tuple[float, ...]]:
    accessor = scene["accessors"][number]
    view = scene["bufferViews"][accessor["bufferView"]]
    if view.get("buffer", 0) != 0 or "uri" in scene["buffers"][0] or "sparse" in accessor:
        raise NoMesh("has numbers that are not in its own block")
    form = f"<{({'SCALAR': 1, 'VEC3': 3})[accessor['type']]}{_LETTERS[accessor['componentType']]}"
    step = int(view.get("byteStride", struct.calcsize(form)))
    at = int(view.get("byteOffset", 0)) + int(accessor.get("byteOffset", 0))
    count = int(accessor["count"])
    # A number takes a byte at least: no list is made that the block cannot fill.
    if min(at, count) < 0 or step < struct.calcsize(form) or count > len(block):
        raise NoMesh("has numbers outside of its block")
    return [struct.unpack_from(form, block, at + k * step) for k in range(count)]
