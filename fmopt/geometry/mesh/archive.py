"""3MF and GLB files: triangles of solids in packages that say their unit and where they put each solid.

3MF is a ZIP archive with a model in XML, no more of which is unpacked than a mesh file may have; GLB is a binary glTF,
which trimesh reads, in a process of its own.
"""

from __future__ import annotations

import io
import lzma
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from fmopt.errors import GeometryError
from fmopt.geometry.mesh.surface import AGAIN
from fmopt.spatial.values import Array

METRES = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "inch": 0.0254, "foot": 0.3048, "meter": 1.0}
_DEEPEST = 32  # levels of solids that are made of solids
_MOST = 400_000  # solids that are put together, points and triangles: a few lines can say to put each of them twice

# What the standard library raises on archives that are damaged, encrypted or packed in a way that it does not know.
_UNREADABLE = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError),
    *(EOFError, NotImplementedError, RuntimeError, OSError, ValueError, LookupError),
)


class Shell(NamedTuple):
    """A solid by its name, "" where it has none: points (n, 3) and triangles (m, 3)."""

    name: str
    points: Array
    triangles: Any


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
    return _built(text)


def _built(text: bytes) -> tuple[str, list[Shell]]:
    """The unit of a 3MF model, and the solids of its build in their places: all that are no parts where it has none."""
    # With a document type come entities, which a few lines can make to expand without end.
    if b"<!DOCTYPE" in text.replace(b"\0", b""):
        raise Broken("its model declares a document type")
    try:
        root = ElementTree.fromstring(text)
        meshes = {one.attrib["id"]: _mesh(one) for one in _all(root, "object")}
        made_of = {one.attrib["id"]: _placed(one, "component") for one in _all(root, "object")}
        items = _placed(root, "item")
    except ElementTree.ParseError as error:
        raise Broken(f"its model is no XML: {error}") from None
    except (LookupError, ValueError, OverflowError) as error:
        if isinstance(error, Broken):
            raise
        raise Broken(f"its model lacks, or has no number for, {error}") from None
    unit = root.get("unit", "millimeter")
    if unit not in METRES:
        raise Broken(f"its unit {unit[:20]!r} is none of {', '.join(METRES)}")
    put = iter(range(_MOST))

    def solids(name: str, place: Array, depth: int) -> Iterator[Shell]:
        if depth > _DEEPEST or name not in meshes:
            raise Broken(f"the solid {name[:20]!r} is not there, or made of itself")
        if next(put, None) is None:
            raise Broken(f"it puts more than {_MOST} solids together")
        if all(map(len, meshes[name][1:])):
            yield _moved(meshes[name], place)
        for part, own in made_of[name]:
            yield from solids(part, own @ place, depth + 1)

    parts = {name for made in made_of.values() for name, _ in made}
    alone = [(name, np.eye(4)) for name in meshes if name not in parts]
    return unit, [*_few(shell for name, place in items or alone for shell in solids(name, place, 0))]


def _all(one: ElementTree.Element, name: str) -> list[ElementTree.Element]:
    return one.findall(f".//{{*}}{name}")


def _mesh(one: ElementTree.Element) -> Shell:
    points = [[float(vertex.attrib[axis]) for axis in "xyz"] for vertex in _all(one, "vertex")]
    corners = [[int(triangle.attrib[corner]) for corner in ("v1", "v2", "v3")] for triangle in _all(one, "triangle")]
    return Shell(one.get("name", ""), np.array(points, dtype=np.float64), np.array(corners, dtype=np.int64))


def _placed(one: ElementTree.Element, name: str) -> list[tuple[str, Array]]:
    return [(element.attrib["objectid"], _transform(element.attrib)) for element in _all(one, name)]


def _transform(of: Mapping[str, str]) -> Array:
    """The matrix (4, 4) that rows of points are multiplied by."""
    made = np.eye(4)
    if "transform" in of:
        numbers = [float(word) for word in of["transform"].split()]
        if len(numbers) != 12:
            raise Broken("a transform has not twelve numbers")
        made[:, :3] = np.array(numbers).reshape(4, 3)
    return made


def glb(path: str) -> list[tuple[str, list[list[float]], list[list[int]]]]:
    """Name, points (n, 3), m, and triangles (m, 3) of each solid of a GLB file where its scene puts them.

    Raises:
        GeometryError: it is none, or its numbers are packed or elsewhere.
    """
    with open(path, "rb") as file:
        data = file.read()
    try:
        return [(shell.name, shell.points.tolist(), shell.triangles.tolist()) for shell in glb_shells(data)]
    except Broken as error:
        raise GeometryError(str(error), AGAIN) from None


def glb_shells(data: bytes) -> list[Shell]:
    """The solids of a GLB file where its scene puts them, in m.

    Raises:
        Broken: it is none, or its numbers are packed or elsewhere.
    """
    import trimesh

    try:
        scene = trimesh.load_scene(io.BytesIO(data), file_type="glb", process=False, skip_materials=True)
        nodes = [(name, scene.graph[name]) for name in scene.graph.nodes_geometry]
    except Exception as error:  # noqa: BLE001 (trimesh raises what its reading runs into)
        raise Broken(f"what the file says of its scene cannot be followed: {type(error).__name__}: {error}") from None
    bodies = [(name, scene.geometry[geometry], place) for name, (place, geometry) in nodes]
    if any(not hasattr(body, "faces") for _, body, _ in bodies):
        raise Broken("a mesh is not of plain triangles")
    shells = ((Shell(str(name), np.asarray(b.vertices), np.asarray(b.faces, np.int64)), at) for name, b, at in bodies)
    return [*_few(_moved(shell, np.asarray(place).T) for shell, place in shells)]


def _few(shells: Iterator[Shell]) -> Iterator[Shell]:
    """Solids as they come, refused before there are too many."""
    count = 0
    for shell in shells:
        count += 1 + len(shell.points) + len(shell.triangles)
        if count > _MOST:
            raise Broken(f"it puts more than {_MOST} points and triangles together")
        yield shell


def _moved(shell: Shell, place: Array) -> Shell:
    """A solid in its place; in a mirror its triangles are turned."""
    there = shell.points @ place[:3, :3] + place[3, :3]
    turned = shell.triangles[:, ::-1] if np.linalg.det(place[:3, :3]) < 0.0 else shell.triangles
    return Shell(shell.name, there, turned)
