"""Triangles as they are read from a file, where it is damaged, and the words of those that are text.

Work and memory are bounded by the bytes of the file. Comments, names and materials may hold any bytes.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from manifold3d import triangulate

from fmopt.geometry.body_names import told_apart
from fmopt.geometry.facets import Indices, compact
from fmopt.spatial.values import Array

MAX_TRIANGLES = 100_000
MAX_POINTS = 3 * MAX_TRIANGLES
AGAIN = "export it again"
COARSER = "export it coarser: the planner takes parts of some hundred faces"
LONGEST_LINE = 200_000  # bytes, comments aside: a face of ten thousand corners
_LARGEST = 1e9  # coordinates in the file's own unit: 1 km in µm
_FLAT = 1e-12  # of its longest diagonal, or of the square of that, below which a polygon has no width or no area
_COVERED = 1e-9  # of its area, by which the area of its ears may be off
_LINE = re.compile(rb"([^\r\n]*)(\r\n|\r|\n|\Z)")
# Narrower than float(), which also takes 'nan', 'inf' and underscores.
_NUMBER = re.compile(rb"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,4})?")
_INDEX = re.compile(rb"[+-]?[0-9]{1,9}")


class Damage(Exception):
    """What is wrong with a file and where in it."""

    def __init__(self, message: str, where: str = "", advice: str = AGAIN) -> None:
        super().__init__(message)
        self.message, self.where, self.advice = message, where, advice


@dataclass
class MeshSurface:
    """Points and triangles as they are read; polygons and named objects, each with the number of its first triangle.

    A polygon holds its place as a fan; one that is not convex becomes ears once all points are known.
    """

    points: list[tuple[float, float, float]] = field(default_factory=list)
    triangles: list[tuple[int, int, int]] = field(default_factory=list)
    polygons: list[tuple[int, tuple[int, ...], str]] = field(default_factory=list)
    objects: list[tuple[str, int]] = field(default_factory=list)

    def point(self, numbers: Sequence[float], where: str) -> None:
        """Takes a point."""
        x, y, z = numbers
        # Written so that nan, which binary files may hold, is refused as well.
        if not (abs(x) <= _LARGEST and abs(y) <= _LARGEST and abs(z) <= _LARGEST):
            raise Damage(f"a coordinate is not a number of at most {_LARGEST:g}", where)
        if len(self.points) >= MAX_POINTS:
            raise Damage(f"there are more than {MAX_POINTS} points", where, COARSER)
        self.points.append((x, y, z))

    def face(self, corners: Sequence[int], where: str) -> None:
        """Takes a polygon, as triangles."""
        count = len(corners)
        if count < 3:
            raise Damage(f"a face has {count} corners", where)
        if len(self.triangles) + count - 2 > MAX_TRIANGLES:
            raise Damage(f"there are more than {MAX_TRIANGLES} triangles", where, COARSER)
        if count > 3:
            self.polygons.append((len(self.triangles), tuple(corners), where))
        if count == 4:
            a, b, c, d = corners
            self.triangles += [(a, b, c), (c, d, a)]
        else:
            first = corners[0]
            self.triangles += [(first, corners[i], corners[i + 1]) for i in range(1, count - 1)]

    def bodies(self) -> tuple[tuple[str, Array, Indices], ...]:
        """Name, "" for what is in none, points (n, 3), in the file's own unit, and triangles (m, 3) of each object."""
        points, triangles = self.arrays()
        begins = self.objects if self.objects and self.objects[0][1] == 0 else [("", 0), *self.objects]
        ends = [*(first for _, first in begins[1:]), len(triangles)]
        spans = [(name, first, end) for (name, first), end in zip(begins, ends, strict=True) if first < end]
        names = told_apart([name for name, *_ in spans])
        return tuple((n, *compact(points, triangles[a:b])) for n, (_, a, b) in zip(names, spans, strict=True))

    def _not_convex(self, points: Array) -> Iterator[tuple[int, tuple[int, ...], str]]:
        """Polygons that a fan may not cover: that turn right somewhere, or go round more than once."""
        for count in sorted({len(corners) for _, corners, _ in self.polygons}):
            alike = [polygon for polygon in self.polygons if len(polygon[1]) == count]
            corners = points[np.array([polygon[1] for polygon in alike])]
            sides = np.roll(corners, -1, axis=1) - corners
            normals = np.cross(corners - corners[:, :1], sides).sum(axis=1, keepdims=True)
            turns = np.cross(np.roll(sides, 1, axis=1), sides)
            left = (turns * normals).sum(axis=2) > 0.0
            angles = np.arctan2(np.linalg.norm(turns, axis=2), (np.roll(sides, 1, axis=1) * sides).sum(axis=2))
            plain = left.all(axis=1) & (angles.sum(axis=1) < 3.0 * np.pi)
            yield from (polygon for polygon, fine in zip(alike, plain, strict=True) if not fine)

    def arrays(self) -> tuple[Array, Indices]:
        """The points in use (n, 3) and the triangles (m, 3) over them."""
        if not self.triangles:
            raise Damage("the file holds no triangles", advice="export the solid, not a drawing or a point cloud")
        triangles = np.array(self.triangles, dtype=np.int64)
        last = int(triangles.max())
        points = np.array(self.points, dtype=np.float64).reshape(-1, 3)
        if last >= len(points):
            number = int(np.flatnonzero((triangles >= len(points)).any(axis=1))[0])
            raise Damage(f"triangle {number} names point {last} of {len(points)}, counted from 0")
        for first, corners, where in self._not_convex(points):
            ears = _ears(points[list(corners)], where)
            triangles[first : first + len(ears)] = np.array(corners)[ears]
        return compact(points, triangles)


def _ears(corners: Array, where: str) -> Indices:
    """Triangles (n − 2, 3) of a polygon (n, 3) that is not convex, in its mean plane; a fan where it has no area.

    Raises:
        Damage: it crosses itself.
    """
    count, corners = len(corners), corners - corners[0]
    fan = np.stack([np.zeros(count - 2, np.int64), np.arange(1, count - 1), np.arange(2, count)], axis=1)
    kept = np.flatnonzero((corners != np.roll(corners, 1, axis=0)).any(axis=1))
    following = np.roll(corners, -1, axis=0)
    normal = np.cross(corners, following).sum(axis=0)  # Newell's, of twice the area
    size, longest = float(np.linalg.norm(normal)), float(np.linalg.norm(corners, axis=1).max())
    if len(kept) < 3 or np.linalg.matrix_rank(corners, _FLAT * longest) < 2:
        return fan
    if size <= _FLAT * longest**2:
        raise Damage("the polygon crosses itself", where)
    sides = following - corners
    u = sides[int(np.argmax(np.linalg.norm(sides, axis=1)))]
    u = u - (u @ normal) / size**2 * normal
    u /= np.linalg.norm(u)
    flat = corners[kept] @ np.stack([u, np.cross(normal / size, u)], axis=1)
    found = np.array(triangulate([flat]), dtype=np.int64).reshape(-1, 3)
    a, b, c = (flat[found[:, k]] for k in range(3))
    (x, y), (z, w) = (b - a).T, (c - a).T
    areas = x * w - y * z  # twice
    if len(found) != len(kept) - 2 or abs(float(np.abs(areas).sum()) - size) > _COVERED * size:
        raise Damage("the polygon crosses itself", where)
    # Corners that stand twice leave triangles without area, which are left out with their like.
    return np.vstack([kept[found], np.zeros((count - 2 - len(found), 3), np.int64)])


def lines_of(data: bytes) -> Iterator[tuple[str, list[bytes]]]:
    """Where each line stands and its words; comments and blank lines are left out."""
    for number, found in enumerate(_LINE.finditer(data), 1):
        line = found[1].lstrip()
        if not line or line.startswith((b"#", b"comment ", b"obj_info ")):
            continue
        where = f"line {number}"
        if len(line) > LONGEST_LINE:
            raise Damage(f"the line has {len(line)} bytes, more than {LONGEST_LINE}", where)
        if words := line.split():
            yield where, words


def number_of(word: bytes, where: str) -> float:
    """The number that a word is; refused where it is none."""
    if len(word) > 64 or not _NUMBER.fullmatch(word):
        raise Damage(f"{quoted(word)} is no finite number", where)
    return float(word)


def index_of(word: bytes, where: str) -> int:
    """The index that a word is; refused where it is none."""
    if not _INDEX.fullmatch(word):
        raise Damage(f"{quoted(word)} is no index", where)
    return int(word)


def quoted(word: bytes) -> str:
    """The beginning of a word as it may be shown."""
    # Latin-1 reads any byte, and ascii() leaves none that a terminal would obey.
    return ascii(word[:40].decode("latin-1"))
