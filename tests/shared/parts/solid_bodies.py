"""Bodies for the check: boxes, blocks with pockets, solids of unit cubes, and what CSG makes, as plans hold them."""

import math
from collections.abc import Iterable, Sequence
from itertools import product

from fmopt.geometry.polyhedron import Polyhedron
from fmopt.verify.parts.solids import Shape
from fmopt.verify.reading.document import Body

MM = 1e-3
Vertices = list[list[float]]
Faces = list[list[list[int]]]
Cube = tuple[int, int, int]
QUADS = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
TOP = [1, 5, 7, 3]
CORNERS = tuple(product((0, 1), repeat=3))


def shape(vertices: Sequence[Sequence[float]], faces: Sequence[Sequence[Sequence[int]]]) -> Shape:
    points = tuple(tuple(map(float, v)) for v in vertices)
    return Shape(Body(points, tuple(tuple(tuple(map(int, loop)) for loop in face) for face in faces)))


def of_polyhedron(body: Polyhedron) -> Shape:
    return shape(body.vertices.tolist(), [[list(loop) for loop in face.loops] for face in body.faces])


def corners(low: Sequence[float], high: Sequence[float]) -> Vertices:
    return [list(p) for p in product(*zip(low, high, strict=True))]


def box(*sides: float) -> Shape:
    """The box from x to x', y to y', z to z', in mm."""
    return shape(corners([x * MM for x in sides[::2]], [x * MM for x in sides[1::2]]), [[q] for q in QUADS])


def pocket() -> tuple[Vertices, Faces]:
    """A block of 60 × 60 × 40 mm with a square blind hole of 20 mm, 30 mm deep."""
    vertices = corners((-0.03, -0.03, -0.04), (0.03, 0.03, 0.0)) + corners((-0.01, -0.01, -0.03), (0.01, 0.01, 0.0))
    faces: Faces = [[list(q)] for q in QUADS if list(q) != TOP]
    faces.append([TOP, [9, 11, 15, 13]])
    faces += [[[8 + i for i in reversed(q)]] for q in QUADS if list(q) != TOP]
    return vertices, faces


WALLS = (-30, -10, -30, 30), (10, 30, -30, 30), (-30, 30, -30, -10), (-30, 30, 10, 30)
SLABS = [box(-30, 30, -30, 30, -40, -30), *(box(*wall, -40, 0) for wall in WALLS)]


def with_box(
    body: tuple[Vertices, Faces], low: Sequence[float], high: Sequence[float], inside_out: bool
) -> tuple[Vertices, Faces]:
    """A body with the faces of a box besides, in m."""
    vertices, faces = body
    n = len(vertices)
    quads = [q[::-1] if inside_out else q for q in QUADS]
    return vertices + corners(low, high), faces + [[[n + i for i in q]] for q in quads]


def of_cubes(cubes: Iterable[Cube], size: float = 0.01) -> Shape:
    """The surface of unit cubes at integer places, each face a square."""
    filled = set(cubes)
    index: dict[Cube, int] = {}
    faces = []
    for cube in sorted(filled):
        ends = corners(cube, [x + 1 for x in cube])
        for q in QUADS:
            square = [ends[i] for i in q]
            beside = [sum(p[k] for p in square) / 4 - cube[k] - 0.5 for k in range(3)]
            if tuple(round(cube[k] + 2 * beside[k]) for k in range(3)) not in filled:
                loop = [index.setdefault((int(p[0]), int(p[1]), int(p[2])), len(index)) for p in square]
                faces.append([loop])
    return shape([[x * size for x in p] for p in index], faces)


def block_of_cubes(low: Cube, high: Cube, size: float = 0.01) -> Shape:
    """A box of cubes from one to another."""
    return shape(corners([x * size for x in low], [(x + 1) * size for x in high]), [[q] for q in QUADS])


def is_surface(cubes: set[Cube]) -> bool:
    """Whether cubes meet in nothing but faces or not at all: their surface then is one about each edge and corner."""
    around = {tuple(c + s for c, s in zip(cube, step, strict=True)) for cube in cubes for step in CORNERS}
    for place in around:
        near = [tuple(p - s for p, s in zip(place, step, strict=True)) for step in CORNERS]
        for group in ({c for c in near if c in cubes}, {c for c in near if c not in cubes}):
            if group and len(_joined(group)) != len(group):
                return False
    return True


def _joined(group: set[tuple[int, ...]]) -> set[tuple[int, ...]]:
    """The cubes of a group that one of them is joined to by faces."""
    found = {min(group)}
    while more := {c for c in group - found if any(math.dist(c, d) == 1.0 for d in found)}:
        found |= more
    return found
