"""STL, OBJ, PLY, 3MF and GLB files: strict readers of their triangles, which refuse what a file does not say plainly.

Work and memory are bounded by the bytes of the file. Comments, names and materials may hold any bytes. Polygons become
triangles, ears where they are not convex; points that no face uses are left out.
"""

import struct
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

from fmopt.errors import GeometryError, ResourceError
from fmopt.geometry.facets import Indices
from fmopt.geometry.mesh.ply_file import read_ply
from fmopt.geometry.mesh.surface import (
    AGAIN,
    COARSER,
    MAX_TRIANGLES,
    Damage,
    MeshSurface,
    index_of,
    lines_of,
    number_of,
    quoted,
)
from fmopt.runtime import confined
from fmopt.spatial.values import Array

T = TypeVar("T")
FORMATS = ("stl", "obj", "ply", "3mf", "glb")
OWN_UNIT = ("3mf", "glb")  # formats that say their unit: their numbers become m
MAX_BYTES = 50_000_000
_PACKAGES = {"3mf": "lib3mf", "glb": "trimesh"}  # what reads them, in a process of its own


def read_triangles(path: Path) -> tuple[Array, Indices]:
    """Points (n, 3) and triangles (m, 3) of a mesh file as they stand there, in the file's own unit, or m (`OWN_UNIT`).

    Raises:
        ResourceError: the file cannot be read.
        GeometryError: no mesh format, damaged, empty or too large; says where.
    """
    return read_surface(path, MeshSurface.arrays)


def read_surface(path: Path, taken: Callable[[MeshSurface], T]) -> T:
    """Reads a mesh file and returns `taken` of its surface, such as `Surface.bodies`, in the file's own unit.

    Raises:
        ResourceError, GeometryError: as of `read_triangles`.
    """
    kind = path.suffix.lower().removeprefix(".")
    if kind not in FORMATS:
        advice = "use .stl, .obj, .ply, .3mf or .glb, or .step with the extra step"
        raise GeometryError(f"{path}: {path.suffix or 'a name without suffix'} is no mesh format", advice)
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)  # one byte more tells that a file is too large, without reading all of it
    except OSError as error:
        raise ResourceError(f"cannot read mesh {path}: {error.strerror}", "check the path") from error
    try:
        if len(data) > MAX_BYTES:
            raise Damage(f"the file has more than {MAX_BYTES} bytes", advice=COARSER)
        return taken(_surface(path, kind, data))
    except Damage as damage:
        place = f"{path}, {damage.where}" if damage.where else str(path)
        raise GeometryError(f"{place}: {damage.message}", damage.advice) from None


@lru_cache(maxsize=2)
def _surface(path: Path, kind: str, data: bytes) -> MeshSurface:
    """What a file holds; it is not read again before it changes."""
    readers: dict[str, Callable[[bytes], MeshSurface]] = {"stl": _stl, "obj": _obj, "ply": read_ply}
    if kind in readers:
        return readers[kind](data)
    reader = confined.FileReader(_PACKAGES[kind], "fmopt.geometry.mesh.archive:solids", COARSER, AGAIN)
    surface = MeshSurface()
    for name, points, triangles in confined.read(path, reader, kind):
        first, count = len(surface.points), len(points)
        surface.objects.append((name[:80], len(surface.triangles)))
        for number, point in enumerate(points, first):
            surface.point(point, f"point {number}")
        for number, corners in enumerate(triangles, len(surface.triangles)):
            if min(corners) < 0 or max(corners) >= count:
                raise Damage(f"a triangle names a point that is none of {count}")
            surface.face([first + corner for corner in corners], f"triangle {number}")
    return surface


def _stl(data: bytes) -> MeshSurface:
    """An STL file: binary if its size is what its count of triangles makes it, else text."""
    count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
    # The size first: headers of binary files may begin with 'solid', too.
    if len(data) == 84 + 50 * count:
        return _binary_stl(data, count)
    if data[:200].lstrip()[:5].lower() == b"solid":
        return _text_stl(data)
    if count < 0:
        raise Damage("the file is neither a text that begins with 'solid' nor long enough for a binary STL file")
    room = (len(data) - 84) // 50
    raise Damage(f"the header says {count} triangles, and the file holds {room} and {(len(data) - 84) % 50} bytes")


def _binary_stl(data: bytes, count: int) -> MeshSurface:
    if count > MAX_TRIANGLES:
        raise Damage(f"there are {count} triangles, more than {MAX_TRIANGLES}", "the header", COARSER)
    surface = MeshSurface()
    for number in range(count):
        at = 84 + 50 * number
        where = f"triangle {number}"
        # A normal before the corners and two bytes behind them are passed over: the order of corners tells the side.
        for values in struct.iter_unpack("<3f", data[at + 12 : at + 48]):
            surface.point(values, where)
        surface.face((3 * number, 3 * number + 1, 3 * number + 2), where)
    return surface


_FACET: tuple[tuple[bytes, ...], ...] = (
    *((b"facet", b"normal"), (b"outer", b"loop"), (b"vertex",), (b"vertex",), (b"vertex",)),
    *((b"endloop",), (b"endfacet",)),
)


def _text_stl(data: bytes) -> MeshSurface:
    """Solids one after the other, each of facets in seven lines."""
    surface = MeshSurface()
    step, inside, where = 0, False, "line 1"
    for where, words in lines_of(data):
        word = words[0].lower()
        if step == 0 and word == (b"endsolid" if inside else b"solid"):
            inside = not inside
            continue
        wanted = _FACET[step] if inside else (b"solid",)
        if tuple(each.lower() for each in words[: len(wanted)]) != wanted:
            raise Damage(f"{quoted(words[0])} stands where '{b' '.join(wanted).decode()}' is due", where)
        if wanted == (b"vertex",):
            if len(words) != 4:
                raise Damage(f"a vertex has {len(words) - 1} coordinates", where)
            surface.point([number_of(each, where) for each in words[1:]], where)
        step = (step + 1) % len(_FACET)
        if step == 0:
            last = len(surface.points)
            surface.face((last - 3, last - 2, last - 1), where)
    if inside:
        raise Damage("the file ends without 'endsolid': it is not whole", where)
    return surface


_OBJ_IGNORED = frozenset(
    b"vt vn vp cstype deg bmat step l p curv curv2 surf parm trim hole scrv sp end con g s mg bevel c_interp "
    b"d_interp lod usemtl mtllib usemap maplib shadow_obj trace_obj ctech stech call csh".split()
)


def _obj(data: bytes) -> MeshSurface:
    """An OBJ file: points `v`, faces `f` whose corners count from 1, or back from the last point so far."""
    surface = MeshSurface()
    for where, words in lines_of(_whole_lines(data)):
        if words[0] == b"v":
            if not 4 <= len(words) <= 9:
                raise Damage(f"a point has {len(words) - 1} numbers", where)
            surface.point([number_of(word, where) for word in words[1:4]], where)
        elif words[0] == b"f":
            surface.face([_corner(word, len(surface.points), where) for word in words[1:]], where)
        elif words[0] == b"o":
            surface.objects.append((b" ".join(words[1:])[:80].decode("utf-8", "replace"), len(surface.triangles)))
        elif words[0] not in _OBJ_IGNORED:
            raise Damage(f"{quoted(words[0])} is no keyword of OBJ files", where)
    return surface


def _whole_lines(data: bytes) -> bytes:
    """Text whose lines do not go on after a backslash; blank ones behind them keep the numbers of all others."""
    if b"\\" not in data:
        return data
    lines, begun = list[bytes](), list[bytes]()
    for line in data.splitlines():
        begun.append(line.removesuffix(b"\\"))
        if not line.endswith(b"\\"):
            lines += [b" ".join(begun), *[b""] * (len(begun) - 1)]
            begun = []
    return b"\n".join([*lines, b" ".join(begun)])


def _corner(word: bytes, count: int, where: str) -> int:
    """The point, from 0, of a corner such as `3`, `3/1`, `3//2`, `3/1/2`, when there are `count` points so far."""
    index = index_of(word.split(b"/", 1)[0], where)
    if index == 0 or index < -count:
        raise Damage(f"a face names point {index} when there are {count}, counted from 1", where)
    return index - 1 if index > 0 else count + index
