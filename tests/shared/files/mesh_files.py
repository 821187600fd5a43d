"""Mesh files of known solids, as a foreign program would write them, whole or with faults."""

import io
import json
import struct
import zipfile
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path

import numpy as np

from fmopt.geometry.convex_pieces import polyhedron
from fmopt.geometry.csg import Box, Difference, Moved, Prism, Solid
from fmopt.geometry.polyhedron import triangulated
from fmopt.spatial.se3 import Pose


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Pose:
    return Pose(np.array([x, y, z]), np.eye(3))


def triangles_of(solid: Solid) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) in mm and outward triangles (m, 3) of a solid."""
    body = polyhedron(solid)
    return 1e3 * body.vertices, triangulated(body)


def stl_text(points: np.ndarray, triangles: Iterable[Iterable[int]]) -> str:
    """An ASCII STL file with nine digits."""
    lines = ["solid part"]
    for triangle in triangles:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex {:.9g} {:.9g} {:.9g}".format(*points[i]) for i in triangle]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid part"])


def obj_text(points: np.ndarray, triangles: np.ndarray) -> str:
    """An OBJ file with nine digits, its comments, names and materials with it."""
    rows = ["v {:.9g} {:.9g} {:.9g}".format(*point) for point in points]
    faces = ["f {} {} {}".format(*(triangle + 1)) for triangle in triangles]
    return "\n".join(["# a part", "mtllib part.mtl", "o part", *rows, "vn 0 0 1", "usemtl steel", "s off", *faces, ""])


def binary_stl(points: np.ndarray, triangles: np.ndarray) -> bytes:
    """A binary STL file."""
    facets = np.zeros(len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
    facets["corners"] = points[triangles]
    return b"binary".ljust(80) + len(triangles).to_bytes(4, "little") + facets.tobytes()


def binary_ply(points: np.ndarray, triangles: np.ndarray, order: str) -> bytes:
    """A binary PLY file, little ("<") or big (">") bytes first."""
    text = ply_text(points, triangles)
    name = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = text[: text.index("end_header\n")].replace("ascii", name).encode() + b"end_header\n"
    faces = np.zeros(len(triangles), dtype=[("count", "u1"), ("corners", f"{order}i4", 3)])
    faces["count"], faces["corners"] = 3, triangles
    return head + points.astype(f"{order}f8").tobytes() + faces.tobytes()


def polygons_obj(points: np.ndarray, faces: Iterable[Sequence[int]]) -> str:
    """An OBJ file of polygons, in all digits."""
    rows = [f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
    return "\n".join([*rows, *("f " + " ".join(str(k + 1) for k in face) for face in faces), ""])


def ply_text(points: np.ndarray, faces: Collection[Sequence[int]]) -> str:
    """An ASCII PLY file of triangles or polygons, in all digits."""
    axes = [f"property double {axis}" for axis in "xyz"]
    head = ["ply", "format ascii 1.0", f"element vertex {len(points)}", *axes, f"element face {len(faces)}"]
    rows = [" ".join(map(repr, point)) for point in points.tolist()]
    loops = [" ".join(map(str, (len(face), *face))) for face in faces]
    return "\n".join([*head, "property list uchar int vertex_indices", "end_header", *rows, *loops, ""])


def write_stl(path: Path, solid: Solid) -> None:
    path.write_text(stl_text(*triangles_of(solid)))


def plate(across: tuple[float, float], corner: float = 0.0, size: float = 0.04, thick: float = 0.01) -> Solid:
    """A plate on z = 0 with a through hole of this width, its upright edges cut."""
    return Difference(Box((size, size, thick)), (Moved(rounded(across, 2.0 * thick, corner), at(z=-0.5 * thick)),))


def rounded(across: tuple[float, float], length: float, corner: float = 0.0) -> Solid:
    """A rectangular bar on z = 0 with its upright edges cut at 45°."""
    x, y = 0.5 * across[0], 0.5 * across[1]
    if corner == 0.0:
        return Box((*across, length))
    outline = [(x, y - corner), (x - corner, y), (corner - x, y), (-x, y - corner)]
    return Prism(tuple(outline + [(-a, -b) for a, b in outline]), length)


_TYPES = """<?xml version="1.0"?><Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>"""
_RELATIONS = """<?xml version="1.0"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship Id="rel0"
Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel" Target="/3D/3dmodel.model"/></Relationships>"""


def three_mf(points: np.ndarray, triangles: np.ndarray, unit: str, shift: tuple[float, float, float]) -> bytes:
    """A 3MF file of one solid, built where the shift puts it."""
    place = " ".join(map(str, (1, 0, 0, 0, 1, 0, 0, 0, 1, *shift)))
    solid = f'<object id="1" type="model">{three_mf_mesh(points, triangles)}</object>'
    return three_mf_package(solid, f'<item objectid="1" transform="{place}"/>', unit)


def three_mf_mesh(points: np.ndarray, triangles: np.ndarray) -> str:
    vertices = "".join(f'<vertex x="{x!r}" y="{y!r}" z="{z!r}"/>' for x, y, z in points.tolist())
    rows = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in triangles.tolist())
    return f"<mesh><vertices>{vertices}</vertices><triangles>{rows}</triangles></mesh>"


def three_mf_package(objects: str, items: str, unit: str = "millimeter") -> bytes:
    """A 3MF file with these objects and items of its build, in XML."""
    model = (
        f'<?xml version="1.0"?><model unit="{unit}" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">'
        f"<resources>{objects}</resources><build>{items}</build></model>"
    )
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("[Content_Types].xml", _TYPES)
        archive.writestr("_rels/.rels", _RELATIONS)
        archive.writestr("3D/3dmodel.model", model)
    return out.getvalue()


def glb(points: np.ndarray, triangles: np.ndarray, node: dict[str, object]) -> bytes:
    """A GLB file of one solid, its points in m, in a node that places it."""
    block = points.astype("<f4").tobytes() + triangles.astype("<u4").tobytes()
    size = 12 * len(points)
    scene = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, **node}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 3 * len(triangles), "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": size},
            {"buffer": 0, "byteOffset": size, "byteLength": len(block) - size},
        ],
        "buffers": [{"byteLength": len(block)}],
    }
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(block), 0x004E4942) + block
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
