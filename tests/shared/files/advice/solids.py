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
from tests.shared.files.advice.case import Case, compared, volume
from tests.shared.files.mesh_files import at

Outline = tuple[tuple[float, float], ...]
EDGES = (0.01, 0.01, 0.01)
CUBE = Box(EDGES)
SIZE = 0.01**3
TRIANGLE: Outline = ((0.0, 0.0), (0.01, 0.0), (0.0, 0.01))
ARROW: Outline = ((0.0, 0.0), (0.02, 0.0), (0.005, 0.005), (0.0, 0.02))
SQUARE: Outline = ((0.0, 0.0), (0.01, 0.0), (0.01, 0.01), (0.0, 0.01))
FLAT = ((0.0, 0.0, 0.0), (0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.01, 0.01, 0.0))
TOP = (0.0, 0.0, 0.01)
LENGTHS, CORNERS = "make every length positive", "give at least three finite ones"
CONVEX = "list the corners of a convex polygon counter-clockwise; build others as Union or Difference"
FEWER = "give curved surfaces fewer facets, by a coarser export or by lower 'sides'"
OVERLAP = "let the operands overlap there or leave a gap"
THICKNESS = "turn the faces round or give it thickness"
PLANE = "give the part faces that are plane, with at most three at a corner"
SOLID = "give four or more that are not flat"


def made(solid: Solid) -> float:
    """The volume of a solid; its convex pieces are there as well."""
    assert pieces(solid)
    return volume(polyhedron(solid))


def less(width: float) -> Solid:
    """The cube, a tool of this width taken away."""
    return Difference(CUBE, (Box((width, width, 0.02)),))


def prism(outline: Outline) -> float:
    """The volume of a prism of 10 mm."""
    return made(Prism(outline, 0.01))


def hull(points: Sequence[tuple[float, float, float]]) -> float:
    """The volume of a convex hull."""
    return made(Hull(tuple(points)))


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
    compared(
        "all taken away", "make the tools smaller", lambda width: made(less(width)), 0.02, 0.005, gives=0.75 * SIZE
    ),
    compared("no piece left", "make the tools smaller", lambda width: len(pieces(less(width))), 0.02, 0.005, gives=4),
    compared(
        "edge on edge", OVERLAP, made, *map(together, (0.01, 0.009, 0.011)), gives=(2.0 * SIZE - 1e-8, 2.0 * SIZE)
    ),
    compared(
        "a length that is none", "give lengths in metres", lambda x: made(Box((x, x, x))), math.nan, 0.01, gives=SIZE
    ),
    Case("a length of nothing", LENGTHS, lambda f: Box((0.01, 0.0, 0.01)), lambda f: made(CUBE), SIZE),
    compared(
        "a cone of two points", LENGTHS, lambda r: made(Cone(r, 0, 0.03, 64)), 0, 0.01, gives=math.pi * 0.9984 * SIZE
    ),
    compared(
        "two sides", "use 3 to 1998", lambda n: len(polyhedron(Cylinder(1, 1, n)).faces), 2, 3, 1998, gives=(5, 2000)
    ),
    compared(
        "meridians", "use 3 to 62", lambda n: made(Sphere(0.01, n)), 1000, 4, 62, gives=(4.0 / 3.0 * SIZE, 4.1709e-6)
    ),
    compared(
        "many sides",
        FEWER,
        lambda n: volume(polyhedron(rods(n))),
        1200,
        60,
        gives=240.0 * math.sin(math.pi / 30.0) * SIZE,
    ),
    compared("a corner that is none", CORNERS, prism, (*TRIANGLE[:2], (math.inf, 0.0)), TRIANGLE, gives=0.5 * SIZE),
    compared("a prism the wrong way round", CONVEX, prism, TRIANGLE[::-1], TRIANGLE, gives=0.5 * SIZE),
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
    compared(
        "a long top",
        "set top_x between 0 and size x",
        lambda x: made(Wedge(EDGES, x)),
        0.02,
        0,
        0.01,
        gives=(SIZE / 2, SIZE),
    ),
    compared("three points", SOLID, hull, FLAT[:3], (*FLAT[:3], TOP), gives=SIZE / 6.0),
    compared("flat points", SOLID, hull, FLAT, (*FLAT, TOP), gives=SIZE / 3.0),
    Case("no parts", "name at least one part", lambda f: Union(()), lambda f: made(Union((CUBE,))), SIZE),
    compared("a long chamfer", "shorten it", lambda x: made(chamfered_box(EDGES, x)), 0.005, 0.001, gives=0.98 * SIZE),
    compared("a box without a face", "close the surface and orient all faces outward", of_faces, 1, 0, gives=SIZE),
    compared("a surface turned round", THICKNESS, lambda turn: of_faces(turn=turn), True, False, gives=SIZE),
    compared("a sheet", THICKNESS, sheet, 0.0, 0.01, gives=SIZE),
    compared("a face of no area", "drop it or merge its vertices", cut_corner, True, False, gives=36.0),
    compared("triangles turned round", "reverse the corners of every triangle", of_triangles, True, False, gives=SIZE),
    compared("no triangles", "check that the operands overlap as meant", common, 0.02, 0.005, gives=0.25 * SIZE),
    compared("next to no thickness", "make no solid thinner than 1e-9 of its size", thin, 0.9e-9, 2e-9, gives=2e-15),
    compared("a bent face", PLANE, lambda by: len(exact_vertices(bent(by))), 1e-9, 0.0, gives=0),
)
