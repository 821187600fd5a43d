"""3MF and GLB files: triangles of solids in packages that say their unit and where they put each solid.

lib3mf and trimesh read them, in processes of their own.
"""

import io
import struct
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np

from fmopt.errors import GeometryError
from fmopt.geometry.mesh.surface import AGAIN
from fmopt.spatial.values import Array

_METRES = (1e-6, 1e-3, 1e-2, 0.0254, 0.3048, 1.0)  # of the units of 3MF in the order of lib3mf
_TYPES = """<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>"""
_RELATIONS = """<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
<Relationship Id="model" Target={model} Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>
</Relationships>"""
_DAMAGED = zipfile.BadZipFile, OSError, ValueError, LookupError, RuntimeError, struct.error
_NO_UNIT = 0x801E  # lib3mf's warning that a unit is none that 3MF knows
_MOST = 400_000  # solids, points and triangles that are put together: a few lines can say to put each of them twice


class Shell(NamedTuple):
    """A solid by its name, "" where it has none: points (n, 3) and triangles (m, 3)."""

    name: str
    points: Array
    triangles: Any


def solids(path: str, kind: str) -> list[tuple[str, list[list[float]], list[list[int]]]]:
    """Name, points (n, 3), m, and triangles (m, 3) of each solid of a "3mf" or "glb" package, in what JSON has.

    Raises:
        GeometryError: it is none, or cannot be read.
    """
    shells = {"3mf": three_mf_shells, "glb": glb_shells}[kind]
    found = shells(Path(path).read_bytes())
    return [(shell.name, shell.points.tolist(), shell.triangles.tolist()) for shell in found]


def three_mf_shells(data: bytes) -> list[Shell]:
    """The solids of a 3MF file where its build puts them, in m; all that are no parts of others where it has no build.

    Raises:
        GeometryError: it is none, or there is no lib3mf on this machine.
    """
    try:
        import lib3mf
    except ImportError as error:
        advice = "save it as an .stl file"
        raise GeometryError(f"3MF files need lib3mf, which is not on this machine: {error}", advice) from error
    try:
        model = lib3mf.get_wrapper().CreateModel()
        reader = model.QueryReader("3mf")
        reader.ReadFromBuffer(_with_relations(data))
        if any(reader.GetWarning(k)[0] == _NO_UNIT for k in range(reader.GetWarningCount())):
            raise GeometryError("its unit is none that 3MF knows", AGAIN)
        unit = _METRES[model.GetUnit()]
        return [shell._replace(points=unit * shell.points) for shell in _few(_built(model))]
    except lib3mf.ELib3MFException as error:
        raise GeometryError(f"the package cannot be read: {error}", AGAIN) from None


def _with_relations(data: bytes) -> bytes:
    """A package with the entries that say where its only model is, which simple writers leave out."""
    whole = io.BytesIO(data)
    try:
        with zipfile.ZipFile(whole, "a") as archive:
            names = archive.namelist()
            models = [name for name in names if name.lower().endswith(".model")]
            relations = _RELATIONS.format(model=quoteattr("/" + "".join(models)))
            entries = {"[Content_Types].xml": _TYPES, "_rels/.rels": relations}
            if len(models) != 1 or entries.keys() <= set(names):
                return data
            for name, text in entries.items():
                if name not in names:
                    archive.writestr(name, text)
    except _DAMAGED:
        return data
    return whole.getvalue()


def _built(model: Any) -> Iterator[Shell]:
    """The solids of a model of lib3mf in the file's own unit."""
    of, parts_of_others = dict[int, list[Shell]](), set[int]()
    for one in _each(model.GetObjects()):  # those that others are made of come before these
        if one.IsMeshObject():
            points = np.array([vertex.Coordinates[:] for vertex in one.GetVertices()]).reshape(-1, 3)
            triangles = np.array([each.Indices[:] for each in one.GetTriangleIndices()], np.int64).reshape(-1, 3)
            of[one.GetUniqueResourceID()] = [Shell(one.GetName(), points, triangles)]
        elif one.IsComponentsObject():
            parts = [one.GetComponent(k) for k in range(one.GetComponentCount())]
            placed = [(part.GetObjectResource(), part.GetTransform()) for part in parts]
            of[one.GetUniqueResourceID()] = [*_few(_put(of, placed))]
            parts_of_others |= {part.GetUniqueResourceID() for part, _ in placed}
        else:
            raise GeometryError(f"its object {one.GetName()[:20]!r} is not made of triangles", AGAIN)
    items = [(item.GetObjectResource(), item.GetObjectTransform()) for item in _each(model.GetBuildItems())]
    alone = (shell for name, shells in of.items() if name not in parts_of_others for shell in shells)
    yield from _put(of, items) if items else alone


def _put(of: Mapping[int, list[Shell]], placed: Iterable[tuple[Any, Any]]) -> Iterator[Shell]:
    for one, transform in placed:
        place = np.eye(4)  # rows of points are multiplied by it
        place[:, :3] = [row[:] for row in transform.Fields]
        for shell in of[one.GetUniqueResourceID()]:
            yield _moved(shell, place)


def _each(several: Any) -> Iterator[Any]:
    while several.MoveNext():
        yield several.GetCurrent()


def glb_shells(data: bytes) -> list[Shell]:
    """The solids of a GLB file where its scene puts them, in m.

    Raises:
        GeometryError: it is none, or its numbers are packed or elsewhere.
    """
    import trimesh

    try:
        scene = trimesh.load_scene(io.BytesIO(data), file_type="glb", process=False, skip_materials=True)
        nodes = [(name, scene.graph[name]) for name in scene.graph.nodes_geometry]
    except Exception as error:  # noqa: BLE001 (trimesh raises what its reading runs into)
        message = f"what the file says of its scene cannot be followed: {type(error).__name__}: {error}"
        raise GeometryError(message, AGAIN) from None
    bodies = [(name, scene.geometry[geometry], place) for name, (place, geometry) in nodes]
    if any(not hasattr(body, "faces") for _, body, _ in bodies):
        raise GeometryError("a mesh is not of plain triangles", AGAIN)
    shells = ((Shell(str(name), np.asarray(b.vertices), np.asarray(b.faces, np.int64)), at) for name, b, at in bodies)
    return [*_few(_moved(shell, np.asarray(place).T) for shell, place in shells)]


def _few(shells: Iterator[Shell]) -> Iterator[Shell]:
    """Solids as they come, refused before there are too many."""
    count = 0
    for shell in shells:
        count += 1 + len(shell.points) + len(shell.triangles)
        if count > _MOST:
            raise GeometryError(f"it puts more than {_MOST} points and triangles together", AGAIN)
        yield shell


def _moved(shell: Shell, place: Array) -> Shell:
    """A solid in its place; in a mirror its triangles are turned."""
    there = shell.points @ place[:3, :3] + place[3, :3]
    turned = shell.triangles[:, ::-1] if np.linalg.det(place[:3, :3]) < 0.0 else shell.triangles
    return Shell(shell.name, there, turned)
