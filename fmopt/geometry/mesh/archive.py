"""3MF and GLB files: triangles of solids in packages that say their unit and where they put each solid.

3MF is a ZIP archive with a model in XML, GLB a binary glTF: JSON and a block of numbers. Both are read as strictly as
the other formats, and no more of them is unpacked than a mesh file may have.
"""

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

import numpy as np

from fmopt.spatial.values import Array

METRES = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "inch": 0.0254, "foot": 0.3048, "meter": 1.0}
_DEEPEST = 32  # levels of solids that are made of solids
_MOST = 400_000  # solids that are put together, points and triangles: a few lines can say to put each of them twice
_JSON, _BINARY = 0x4E4F534A, 0x004E4942  # kinds of chunks: the letters "JSON" and "BIN" as numbers
_KINDS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}

# What the standard library raises on archives that are damaged, encrypted or packed in a way that it does not know.
_UNREADABLE = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error),
    *(EOFError, NotImplementedError, RuntimeError, OSError, ValueError, LookupError),
)
Shell = tuple[Array, Any]  # points (n, 3), triangles (m, 3)


class Broken(ValueError):
    """What is wrong with a package, in words."""


def three_mf(data: bytes, most: int) -> tuple[str, list[Shell]]:
    """The unit of a 3MF file, and its solids where its build puts them.

    Raises:
        Broken: it is none.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            names = [name for name in archive.namelist() if name.lower().endswith(".model")]
            if len(names) != 1:
                raise Broken(f"the archive holds {len(names)} models; only one is read")
            with archive.open(names[0]) as model:
                text = model.read(most + 1)  # a small archive may unpack to any size
    # It is a ValueError, which the next branch would take for damage of the archive.
    except Broken:
        raise
    except _UNREADABLE as error:
        raise Broken(f"the archive cannot be read: {error}") from None
    if len(text) > most:
        raise Broken(f"its model has more than {most} bytes")
    reader = _Model(most)
    reader.parse(text)
    return reader.unit, [*_few(reader.built())]


class _Model:
    """The elements of a 3MF model as they come."""

    def __init__(self, most: int) -> None:
        self.unit = "millimeter"
        self._most = most
        self._meshes: dict[str, tuple[list[tuple[float, float, float]], list[tuple[int, int, int]]]] = {}
        self._made_of: dict[str, list[tuple[str, Array]]] = {}
        self._items: list[tuple[str, Array]] = []
        self._object = ""
        self._put = 0

    def parse(self, text: bytes) -> None:
        """Reads the text.

        Raises:
            Broken: it is no model.
        """
        parser = expat.ParserCreate()
        parser.StartElementHandler = self._start
        # With a document type come entities, which a few lines can make to expand without end.
        parser.StartDoctypeDeclHandler = self._refuse
        try:
            parser.Parse(text, True)
        except expat.ExpatError as error:
            raise Broken(f"its model is no XML: {error}") from None
        except (KeyError, ValueError, OverflowError) as error:
            if isinstance(error, Broken):
                raise
            raise Broken(
                f"its model lacks, or has no number for, {error}, in line {parser.CurrentLineNumber}"
            ) from None

    def built(self) -> Iterator[Shell]:
        """The solids of the build in their places; all solids that are no parts of others where nothing is built."""
        parts = {name for made in self._made_of.values() for name, _ in made}
        alone = [(name, np.eye(4)) for name in {**self._meshes, **self._made_of} if name not in parts]
        for name, place in self._items or alone:
            yield from self._solids(name, place, 0)

    def _solids(self, name: str, place: Array, depth: int) -> Iterator[Shell]:
        if depth > _DEEPEST or (name not in self._meshes and name not in self._made_of):
            raise Broken(f"the solid {name[:20]!r} is not there, or made of itself")
        self._put += 1
        if self._put > _MOST:
            raise Broken(f"it puts more than {_MOST} solids together")
        if name in self._meshes:
            points, triangles = self._meshes[name]
            if points and triangles:
                yield _moved(np.array(points, dtype=np.float64), np.array(triangles, dtype=np.int64), place)
        for part, own in self._made_of.get(name, ()):
            yield from self._solids(part, own @ place, depth + 1)

    @staticmethod
    def _refuse(*_: object) -> None:
        raise Broken("its model declares a document type")

    def _start(self, name: str, of: Mapping[str, str]) -> None:
        # Programs differ in the prefixes that they give to namespaces.
        match name.rpartition(":")[2]:
            case "model":
                self.unit = of.get("unit", "millimeter")
                if self.unit not in METRES:
                    raise Broken(f"its unit {self.unit[:20]!r} is none of {', '.join(METRES)}")
            case "object":
                self._object = of["id"]
            case "vertex":
                points, _ = self._meshes.setdefault(self._object, ([], []))
                points.append((float(of["x"]), float(of["y"]), float(of["z"])))
            case "triangle":
                _, triangles = self._meshes.setdefault(self._object, ([], []))
                triangles.append((int(of["v1"]), int(of["v2"]), int(of["v3"])))
            case "component":
                self._made_of.setdefault(self._object, []).append((of["objectid"], _transform(of)))
            case "item":
                self._items.append((of["objectid"], _transform(of)))


def _transform(of: Mapping[str, str]) -> Array:
    """The matrix (4, 4) that rows of points are multiplied by."""
    made = np.eye(4)
    if "transform" in of:
        numbers = [float(word) for word in of["transform"].split()]
        if len(numbers) != 12:
            raise Broken("a transform has not twelve numbers")
        made[:, :3] = np.array(numbers).reshape(4, 3)
    return made


def glb(data: bytes) -> list[Shell]:
    """The solids of a GLB file where its scene puts them, in m.

    Raises:
        Broken: it is none, or its numbers are packed or elsewhere.
    """
    try:
        magic, version, length = struct.unpack_from("<4sII", data)
        if magic != b"glTF" or version != 2 or length != len(data):
            raise Broken("the file does not begin as a GLB file of version 2 and of its own length")
        chunks: dict[int, bytes] = {}
        at = 12
        while at < len(data):
            size, kind = struct.unpack_from("<II", data, at)
            chunks.setdefault(kind, data[at + 8 : at + 8 + size])
            at += 8 + size
        scene = json.loads(chunks[_JSON])
        return [*_few(_scene(scene, chunks.get(_BINARY, b"")))]
    except Broken:
        raise
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, struct.error, RecursionError) as error:
        raise Broken(f"what the file says of its scene cannot be followed: {type(error).__name__}: {error}") from None


def _scene(scene: Any, block: bytes) -> Iterator[Shell]:
    nodes = scene.get("nodes", [])
    if "nodes" in scene:
        listed = [child for node in nodes for child in node.get("children", [])]
        children = {*listed}
        if len(children) < len(listed):
            raise Broken("a node is a part of two others")
        roots = (
            scene["scenes"][scene.get("scene", 0)]["nodes"] if "scenes" in scene else set(range(len(nodes))) - children
        )
        for root in roots:
            yield from _node(scene, block, root, (np.eye(4), 0))
    else:
        for mesh in scene.get("meshes", []):
            yield from _primitives(scene, block, mesh, np.eye(4))


def _node(scene: Any, block: bytes, number: int, above: tuple[Array, int]) -> Iterator[Shell]:
    place, depth = above
    if depth > _DEEPEST:
        raise Broken("a node is a part of itself")
    node = scene["nodes"][number]
    here = _node_matrix(node) @ place
    if "mesh" in node:
        yield from _primitives(scene, block, scene["meshes"][node["mesh"]], here)
    for child in node.get("children", []):
        yield from _node(scene, block, child, (here, depth + 1))


def _node_matrix(node: Mapping[str, Any]) -> Array:
    """The matrix (4, 4) that rows of points are multiplied by."""
    if "matrix" in node:
        # glTF lists matrices by columns, so that these rows make the transposed one, as rows of points need.
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4)
    x, y, z, w = (float(part) for part in node.get("rotation", (0.0, 0.0, 0.0, 1.0)))
    # Transposed likewise; the scale below comes before the turn, as glTF has it.
    turn = np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)],
            [2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)],
            [2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )
    made = np.eye(4)
    made[:3, :3] = np.array(node.get("scale", (1.0, 1.0, 1.0)), dtype=np.float64)[:, None] * turn
    made[3, :3] = node.get("translation", (0.0, 0.0, 0.0))
    return made


def _primitives(scene: Any, block: bytes, mesh: Any, place: Array) -> Iterator[Shell]:
    for part in mesh["primitives"]:
        # Mode 4 is triangles one by one; extensions may keep numbers packed.
        if part.get("mode", 4) != 4 or "extensions" in part:
            raise Broken("a mesh is not of plain triangles")
        points = _accessor(scene, block, part["attributes"]["POSITION"]).astype(np.float64).reshape(-1, 3)
        if "indices" in part:
            indices = _accessor(scene, block, part["indices"])
            if indices.dtype.kind != "u":  # others need not be whole, nor finite
                raise Broken("its triangles name points by other numbers than counts")
            triangles = indices.astype(np.int64).reshape(-1, 3)
        else:
            triangles = np.arange(len(points), dtype=np.int64).reshape(-1, 3)
        yield _moved(points, triangles, place)


def _accessor(scene: Any, block: bytes, number: int) -> Any:
    """The numbers of an accessor (n, k)."""
    accessor = scene["accessors"][number]
    view = scene["bufferViews"][accessor["bufferView"]]
    if view.get("buffer", 0) != 0 or "uri" in scene["buffers"][0] or "sparse" in accessor:
        raise Broken("numbers are not in the file's own block")
    kind = np.dtype(_KINDS[accessor["componentType"]])
    width = {"SCALAR": 1, "VEC3": 3}[accessor["type"]]
    count, stride = int(accessor["count"]), int(view.get("byteStride", width * kind.itemsize))
    at = int(view.get("byteOffset", 0)) + int(accessor.get("byteOffset", 0))
    end = at + stride * (count - 1) + width * kind.itemsize
    if min(count, at) < 0 or stride < width * kind.itemsize or (count and end > len(block)):
        raise Broken("numbers lie outside the file's block")
    return np.ndarray((count, width), kind, block, at, (stride, kind.itemsize))


def _few(shells: Iterator[Shell]) -> Iterator[Shell]:
    """Solids as they come, refused before there are too many."""
    count = 0
    for points, triangles in shells:
        count += 1 + len(points) + len(triangles)
        if count > _MOST:
            raise Broken(f"it puts more than {_MOST} points and triangles together")
        yield points, triangles


def _moved(points: Array, triangles: Any, place: Array) -> Shell:
    """A solid in its place; in a mirror its triangles are turned."""
    there = points @ place[:3, :3] + place[3, :3]
    return there, triangles[:, ::-1] if np.linalg.det(place[:3, :3]) < 0.0 else triangles


def together(shells: Sequence[Shell]) -> Shell:
    """Solids as one list of points and triangles."""
    starts = np.cumsum([0, *(len(points) for points, _ in shells[:-1])])
    for points, triangles in shells:
        if len(triangles) and (triangles.min() < 0 or triangles.max() >= len(points)):
            raise Broken(f"a triangle names a point that is none of {len(points)}")
    if not shells:
        raise Broken("it holds no triangles")
    return (
        np.vstack([points for points, _ in shells]),
        np.vstack([triangles + start for (_, triangles), start in zip(shells, starts, strict=True)]),
    )
