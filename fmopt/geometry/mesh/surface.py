"""Triangles as they are read from a file, where it is damaged, and the words of those that are text.

Work and memory are bounded by the bytes of the file. Comments, names and materials may hold any bytes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from fmopt.geometry.facets import Indices
from fmopt.spatial.values import Array

MAX_TRIANGLES = 100_000
MAX_POINTS = 3 * MAX_TRIANGLES
AGAIN = "export it again"
COARSER = "export it coarser: the planner takes parts of some hundred faces"
LONGEST_LINE = 200_000  # bytes, comments aside: a face of ten thousand corners
_LARGEST = 1e9  # coordinates in the file's own unit: 1 km in µm
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
class Surface:
    """Points and triangles as they are read."""

    points: list[tuple[float, float, float]] = field(default_factory=list)
    triangles: list[tuple[int, int, int]] = field(default_factory=list)

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
        if count == 4:
            a, b, c, d = corners
            self.triangles += [(a, b, c), (c, d, a)]
        else:
            first = corners[0]
            self.triangles += [(first, corners[i], corners[i + 1]) for i in range(1, count - 1)]

    def arrays(self) -> tuple[Array, Indices]:
        """The points in use (n, 3) and the triangles (m, 3) over them."""
        if not self.triangles:
            raise Damage("the file holds no triangles", advice="export the solid, not a drawing or a point cloud")
        triangles = np.array(self.triangles, dtype=np.int64)
        used, renumbered = np.unique(triangles, return_inverse=True)
        points = np.array(self.points, dtype=np.float64).reshape(-1, 3)
        if used[-1] >= len(points):
            number = int(np.flatnonzero((triangles >= len(points)).any(axis=1))[0])
            raise Damage(f"triangle {number} names point {used[-1]} of {len(points)}, counted from 0")
        return points[used], renumbered.reshape(-1, 3).astype(np.int64)


def lines_of(data: bytes, first: int = 1) -> Iterator[tuple[str, list[bytes]]]:
    """Where each line stands and its words; comments and blank lines are left out."""
    for number, found in enumerate(_LINE.finditer(data), first):
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
