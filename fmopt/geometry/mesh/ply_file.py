"""PLY files, as text or binary in either order of bytes: parsed by plyfile within the limits of a file's size."""

import io
import math
import re
from itertools import takewhile
from typing import Any

from plyfile import PlyData, PlyElement, PlyElementParseError, PlyHeaderParseError

from fmopt.geometry.mesh.surface import COARSER, LONGEST_LINE, MAX_POINTS, MAX_TRIANGLES, Damage, MeshSurface

_MAX_ROWS = 1_000_000  # of elements that are no points and no faces
_NOT_ASCII = re.compile(rb"[^\x00-\x7f]")


def read_ply(data: bytes) -> MeshSurface:
    """The elements `vertex` and `face` of a PLY file."""
    # Only in the beginning, so that no large file is searched for what it does not have.
    ending = re.search(rb"(?m)^end_header[ \t]*(\r\n|\r|\n)", data[:LONGEST_LINE])
    if not data.startswith(b"ply") or ending is None:
        raise Damage("the file has no header from 'ply' to 'end_header'")
    head = _NOT_ASCII.sub(b"?", data[: ending.end()])  # comments hold any bytes
    rows, lines = data[ending.end() :], head.replace(b"\r", b"\n")
    for name, count in re.findall(rb"(?m)^element[ \t]+(\w+)[ \t]+(\d{1,18})[ \t]*$", lines):
        # A row has a byte at least.
        most = min({b"vertex": MAX_POINTS, b"face": MAX_TRIANGLES}.get(name, _MAX_ROWS), len(rows) + 1)
        if int(count) > most:
            message = f"the header says {int(count)} of the element {name.decode()!r}, more than {most}"
            raise Damage(message, "the header", COARSER)
    first = 1 + len(re.findall(rb"\r\n|\r|\n", head))
    stream: io.BytesIO | io.StringIO = io.BytesIO(head + rows)
    if text := re.search(rb"(?m)^format[ \t]+ascii", lines) is not None:
        # As doubles, since digits of a text say more than the type that it names.
        exact = (re.sub(rb"\bfloat(32)?\b", b"double", head) + rows).decode("latin-1")
        stream = io.StringIO(exact, newline=None)
    try:
        found = PlyData.read(stream, mmap=False)
    except PlyElementParseError as error:
        raise Damage(f"{error.message}: the row is not whole", _place(error.element, error.row or 0)) from None
    except PlyHeaderParseError as error:
        raise Damage(f"the header is not understood: {error.message}", f"line {error.line}") from None
    except (ValueError, OverflowError, TypeError, MemoryError) as error:
        raise Damage(f"the file is not understood: {error}") from None
    if stream.read().strip():
        raise Damage("the file goes on after what its header tells of")
    surface = MeshSurface()
    points, faces = (_element(found, name) for name in ("vertex", "face"))
    columns = [_column(points, axis).tolist() for axis in "xyz"]
    for number, point in enumerate(zip(*columns, strict=True)):
        surface.point(point, _place(points, number))
    # A row is a line.
    first += sum(one.count for one in takewhile(lambda one: one is not faces, found))
    for number, corners in enumerate(_column(faces, "vertex_indices", "vertex_index")):
        where = f"line {first + number}" if text else _place(faces, number)
        surface.face([_corner(float(value), where) for value in corners], where)
    return surface


def _place(element: PlyElement, number: int) -> str:
    return f"{element.name} {number} of {element.count}"


def _element(found: PlyData, name: str) -> PlyElement:
    if name not in found:
        raise Damage(f"there is no element {name!r}", "the header")
    return found[name]


def _column(element: PlyElement, *names: str) -> Any:
    """The values of the first of these properties that an element has, a row each."""
    for one in element.properties:
        if one.name in names:
            return element.data[one.name]
    raise Damage(f"the element {element.name!r} has no property {names[0]!r}", "the header")


def _corner(value: float, where: str) -> int:
    # In a file of floats a corner may be none that there is an integer of.
    if not math.isfinite(value) or value < 0 or value != int(value):
        raise Damage(f"a face names point {value:g}", where)
    return int(value)
