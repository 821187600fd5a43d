"""Advice on solids, polyhedra and outlines that are made in Python or described in a model file, followed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fmopt.geometry.convex_pieces import pieces, polyhedron
from fmopt.geometry.csg import (
    Box,
    Cone,
    Cylinder,
    Difference,
    Hull,
    Placed,
    Prism,
    Solid,
    Sphere,
    Union,
    Wedge,
    chamfered_box,
)
from fmopt.geometry.exact_coordinates import exact_vertices
from fmopt.geometry.polyhedron import Polyhedron, convex_hull_polyhedron, from_faces, from_triangles, triangulated
from tests.shared.files.advice.case import Case, volume
from tests.shared.files.mesh_files import at

Outline = tuple[tuple[float, float], ...]
CUBE = Box((0.01, 0.01, 0.01))
SIZE = 0.01**3
TRIANGLE: Outline = ((0.0, 0.0), (0.01, 0.0), (0.0, 0.01))
ARROW: Outline = ((0.0, 0.0), (0.02, 0.0), (0.005, 0.005), (0.0, 0.02))
SQUARE: Outline = ((0.0, 0.0), (0.01, 0.0), (0.01, 0.01), (0.0, 0.01))
FLAT = ((0.0, 0.0, 0.0), (0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.01, 0.01, 0.0))
LENGTHS, CORNERS = "make every length positive", "give at least three finite ones"
CONVEX = "list the corners of a convex polygon counter-clockwise; build others as Union or Difference"
FEWER = "give curved surfaces fewer facets, by a coarser export or by lower 'sides'"
SOLID = "give four or more that are not flat"


def made(solid: Solid) -> float:
    """The volume of a solid; its convex pieces are there as well."""
    assert pieces(solid)
    return volume(polyhedron(solid))


def cube_faces() -> tuple[np.ndarray, list[tuple[tuple[int, ...], ...]]]:
    """Corners (8, 3) and the loops of the faces of a cube."""
    body = polyhedron(CUBE)
    return body.vertices, [face.loops for face in body.faces]


def of_faces(left_out: int = 0, turn: bool = False) -> float:
    """The volume of the cube from its faces, some left out, or all turned round."""
    points, faces = cube_faces()
    return volume(from_faces(points, [[loop[::-1] if turn else loop for loop in face] for face in faces[left_out:]]))


def sheet(thick: float) -> float:
    """The volume of a prism of this thickness from its faces."""
    points, faces = cube_faces()
    return volume(from_faces(points * (1.0, 1.0, 100.0 * thick), faces))


def cut_corner(sliver: bool) -> float:
    """The volume of a tetrahedron, one of whose edges has a corner in its middle, closed by a face of no area."""
    points = np.array([(0, 0, 0), (2, 4, 6), (6, 0, 0), (0, 6, 0), (1, 2, 3)], dtype=np.float64)
    faces: list[Sequence[Sequence[int]]] = [[(0, 3, 2)], [(1, 2, 3)], [(0, 1, 3)], [(1, 0, 2)]]
    if sliver:
        faces[3:] = [[(1, 4, 0, 2)], [(1, 0, 4)]]
    return volume(from_faces(points, faces))


def of_triangles(turn: bool = False) -> float:
    """The volume of the cube from its triangles, or from all of them turned round."""
    body = polyhedron(CUBE)
    triangles = triangulated(body)
    return volume(from_triangles(body.vertices, triangles[:, ::-1] if turn else triangles))


def bent(by: float) -> Polyhedron:
    """A cube with one corner out of the planes of its faces, m."""
    body = polyhedron(CUBE)
    points = body.vertices.copy()
    points[0, 2] += by
    return replace(body, vertices=points)


def together(shift: float, tall: float = 0.01) -> Union:
    """Two cubes, one shifted along x and y."""
    return Union((CUBE, Placed(Box((0.01, 0.01, tall)), at(shift, shift))))


def convex_faces(sides: int) -> tuple[object, ...]:
    """The faces of a cylinder."""
    return polyhedron(Cylinder(0.01, 0.02, sides)).faces


def rods(sides: int) -> Solid:
    """Four rods beside each other."""
    return Union(tuple(Placed(Cylinder(0.01, 0.02, sides), at(0.03 * i)) for i in range(4)))


def thin(share: float) -> float:
    """The volume of a square of 10 mm that is thick by a share of its side."""
    return volume(convex_hull_polyhedron([*FLAT, *((x, y, 0.01 * share) for x, y, _ in FLAT)]))


def common(shift: float) -> float:
    """The volume of what two cubes, one shifted along x and y, have in common."""
    from fmopt.geometry.convex_pieces import convex_manifold

    shifted = polyhedron(Placed(CUBE, at(shift, shift)))
    mesh = (convex_manifold(polyhedron(CUBE)) ^ convex_manifold(shifted)).to_mesh64()
    return volume(from_triangles(np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts, dtype=np.int64)))


CASES = (
    Case(
        "all taken away",
        "make the tools smaller",
        lambda f: made(Difference(CUBE, (Box((0.02, 0.02, 0.02)),))),
        lambda f: made(Difference(CUBE, (Box((0.005, 0.005, 0.02)),))),
        0.75 * SIZE,
    ),
    Case(
        "no piece left",
        "make the tools smaller",
        lambda f: pieces(Difference(CUBE, (Box((0.02, 0.02, 0.02)),))),
        lambda f: len(pieces(Difference(CUBE, (Box((0.005, 0.005, 0.02)),)))),
        4,
    ),
    Case(
        "edge on edge",
        "let the operands overlap there or leave a gap",
        lambda f: made(together(0.01)),
        lambda f: (made(together(0.009)), made(together(0.011))),
        (2.0 * SIZE - 0.001**2 * 0.01, 2.0 * SIZE),
    ),
    Case(
        "a length that is none",
        "give lengths in metres",
        lambda f: Box((0.01, 0.01, math.nan)),
        lambda f: made(Box((0.01, 0.01, 0.01))),
        SIZE,
    ),
    Case("a length of nothing", LENGTHS, lambda f: Box((0.01, 0.0, 0.01)), lambda f: made(CUBE), SIZE),
    Case(
        "a cone of two points",
        LENGTHS,
        lambda f: Cone(0.0, 0.0, 0.01),
        lambda f: made(Cone(0.01, 0.0, 0.03, 64)),
        math.pi * 0.01**3 * 0.9984,
    ),
    Case(
        "two sides",
        "use 3 to 1998",
        lambda f: Cylinder(0.01, 0.02, 2),
        lambda f: tuple(len(convex_faces(sides)) for sides in (3, 1998)),
        (5, 2000),
    ),
    Case(
        "a thousand meridians",
        "use 3 to 62",
        lambda f: Sphere(0.01, 1000),
        lambda f: (made(Sphere(0.01, 4)), volume(polyhedron(Sphere(0.01, 62)))),
        (4.0 / 3.0 * 0.01**3, 4.1709e-6),
    ),
    Case(
        "many sides together",
        FEWER,
        lambda f: volume(polyhedron(rods(1200))),
        lambda f: volume(polyhedron(rods(60))),
        4.0 * 30.0 * math.sin(math.pi / 30.0) * 0.01**2 * 0.02,
    ),
    Case(
        "a corner that is none",
        CORNERS,
        lambda f: Prism((*TRIANGLE[:2], (math.inf, 0.0)), 0.01),
        lambda f: made(Prism(TRIANGLE, 0.01)),
        0.5 * SIZE,
    ),
    Case(
        "a prism the wrong way round",
        CONVEX,
        lambda f: Prism(TRIANGLE[::-1], 0.01),
        lambda f: made(Prism(TRIANGLE, 0.01)),
        0.5 * SIZE,
    ),
    Case(
        "a prism that is not convex",
        CONVEX,
        lambda f: Prism(ARROW, 0.01),
        lambda f: (
            made(Union((Prism(ARROW[:3], 0.01), Prism((ARROW[0], *ARROW[2:]), 0.01)))),
            made(Difference(Prism((*ARROW[:2], ARROW[3]), 0.01), (Placed(Prism(ARROW[:0:-1], 0.03), at(z=-0.01)),))),
        ),
        (1e-6, 1e-6),
    ),
    Case(
        "a top too long",
        "set top_x between 0 and size x",
        lambda f: Wedge((0.01, 0.01, 0.01), 0.02),
        lambda f: tuple(made(Wedge((0.01, 0.01, 0.01), top)) for top in (0.0, 0.01)),
        (0.5 * SIZE, SIZE),
    ),
    Case(
        "three points", SOLID, lambda f: Hull(FLAT[:3]), lambda f: made(Hull((*FLAT[:3], (0.0, 0.0, 0.01)))), SIZE / 6.0
    ),
    Case("flat points", SOLID, lambda f: made(Hull(FLAT)), lambda f: made(Hull((*FLAT, (0.0, 0.0, 0.01)))), SIZE / 3.0),
    Case("no parts", "name at least one part", lambda f: Union(()), lambda f: made(Union((CUBE,))), SIZE),
    Case(
        "a long chamfer",
        "shorten it",
        lambda f: chamfered_box((0.01, 0.01, 0.01), 0.005),
        lambda f: made(chamfered_box((0.01, 0.01, 0.01), 0.001)),
        SIZE * (1.0 - 2.0 * 0.1**2),
    ),
    Case(
        "a box without a face",
        "close the surface and orient all faces outward",
        lambda f: of_faces(1),
        lambda f: of_faces(),
        SIZE,
    ),
    Case(
        "a surface turned round",
        "turn the faces round or give it thickness",
        lambda f: of_faces(turn=True),
        lambda f: of_faces(),
        SIZE,
    ),
    Case("a sheet", "turn the faces round or give it thickness", lambda f: sheet(0.0), lambda f: sheet(0.01), SIZE),
    Case(
        "a face of no area",
        "drop it or merge its vertices",
        lambda f: cut_corner(True),
        lambda f: cut_corner(False),
        36.0,
    ),
    Case(
        "triangles turned round",
        "reverse the corners of every triangle",
        lambda f: of_triangles(turn=True),
        lambda f: of_triangles(),
        SIZE,
    ),
    Case(
        "no triangles",
        "check that the operands overlap as meant",
        lambda f: common(0.02),
        lambda f: common(0.005),
        0.25 * SIZE,
    ),
    Case(
        "next to no thickness",
        "make no solid thinner than 1e-9 of its size",
        lambda f: thin(0.9e-9),
        lambda f: thin(2e-9),
        2e-15,
    ),
    Case(
        "a bent face",
        "give the part faces that are plane, with at most three at a corner",
        lambda f: exact_vertices(bent(1e-9)),
        lambda f: len(exact_vertices(bent(0.0))),
        0,
    ),
)
