"""Refusals of solids, meshes, STEP files and objects of Python that no other test meets: message and advice."""

import math
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import manifold3d
import numpy as np
import pytest
import trimesh

from fmopt.errors import FmoptError
from fmopt.geometry.clearance import checked_clearance
from fmopt.geometry.convex_pieces import pieces, polyhedron
from fmopt.geometry.csg import Box, Cone, Cylinder, Difference, Hull, Moved, Prism, Sphere, Union, Wedge, chamfered_box
from fmopt.geometry.exact_coordinates import exact_vertices
from fmopt.geometry.mating_features import Feature
from fmopt.geometry.mesh.archive import three_mf_shells
from fmopt.geometry.mesh.mesh_import import load_mesh
from fmopt.geometry.outline_solids import stack
from fmopt.geometry.part import part_of, rebased, with_balls
from fmopt.geometry.polyhedron import convex_hull_polyhedron, from_faces, from_triangles
from fmopt.geometry.python_objects import imported_of
from fmopt.geometry.step import step_import
from tests.shared.files.mesh_files import at, binary_stl, stl_text, triangles_of
from tests.shared.files.step_files import write_step
from tests.shared.files.step_parts import cylinder

CUBE = Box((0.01, 0.01, 0.01))
BODY = polyhedron(CUBE)
FACES = [face.loops for face in BODY.faces]
TRIANGLE = ((0.0, 0.0), (0.01, 0.0), (0.0, 0.01))
SQUARE = ((0.0, 0.0), (0.01, 0.0), (0.01, 0.01), (0.0, 0.01))
FLAT = ((0.0, 0.0, 0.0), (0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.01, 0.01, 0.0))
RODS = Union(tuple(Moved(Cylinder(0.01, 0.02, 1200), at(0.03 * i)) for i in range(4)))
POINTS, TRIANGLES = triangles_of(Box((0.008, 0.008, 0.008)))
SHOULDERS = [[(-2, -9), (2, -9), (2, -z), (6, -z), (6, 9), (-6, 9), (-6, z), (-2, z)] for z in (-2, 2)]


def of_faces(points: np.ndarray = BODY.vertices, left_out: int = 0, turn: int = 1) -> object:
    return from_faces(points, [[loop[::turn] for loop in face] for face in FACES[left_out:]])


def bent() -> object:
    """A cube with one corner out of the planes of its faces."""
    points = BODY.vertices.copy()
    points[0, 2] += 1e-9
    return exact_vertices(replace(BODY, vertices=points))


def cut_corner() -> object:
    """A tetrahedron, one of whose edges has a corner in its middle, closed by a face of no area."""
    points = np.array([(0, 0, 0), (2, 4, 6), (6, 0, 0), (0, 6, 0), (1, 2, 3)], dtype=np.float64)
    return from_faces(points, [[(0, 3, 2)], [(1, 2, 3)], [(0, 1, 3)], [(1, 4, 0, 2)], [(1, 0, 4)]])


def without_lib3mf() -> object:
    with mock.patch.dict(sys.modules, {"lib3mf": None}):
        return three_mf_shells(b"")


def coarse() -> object:
    """A rod that is larger than the part that it encloses, and a bore that its facets do not go into."""
    bore = Difference(Box((0.06, 0.06, 0.04)), (Moved(Cylinder(0.01005, 0.03, 24), at(z=0.01)),))
    rod = replace(part_of("rod", Cylinder(0.01, 0.05, 63)), larger=1e-4)
    return checked_clearance(rod, rebased(part_of("block", bore), at(z=0.04)), at(z=-0.03), 0.03)


def workplane(solids: int) -> object:
    """A workplane of so many solids."""
    import cadquery

    plane = cadquery.Workplane()
    for k in range(solids):
        plane = plane.add(cadquery.Workplane().box(9, 9, 9, (k == 0,) * 3))
    return imported_of(plane, "mm")


def shape_of_nothing() -> object:
    from OCP.TopoDS import TopoDS_Shape

    return imported_of(TopoDS_Shape(), "mm")


SECTION = manifold3d.CrossSection.square((12.0, 8.0))
SCENE = trimesh.Scene([trimesh.creation.box((9, 9, 9)), trimesh.creation.box((9, 9, 9))])
PEG = part_of("peg", Box((0.02, 0.02, 0.05)))
REFUSED: tuple[tuple[Callable[[], object], str], ...] = (
    (lambda: pieces(Difference(CUBE, (Moved(Box((0.02, 0.02, 0.03)), at(z=-0.01)),))), "make the tools smaller"),
    (lambda: polyhedron(Union((CUBE, Moved(CUBE, at(0.01, 0.01))))), "let the operands overlap there or leave a gap"),
    (lambda: Box((math.nan, 0.01, 0.01)), "give lengths in metres"),
    (lambda: Box((0.01, 0.0, 0.01)), "has no volume; make every length positive"),
    (lambda: Cylinder(-0.01, 0.02), "has no volume; make every length positive"),
    (lambda: Cone(0.0, 0.0, 0.03), "has no volume; make every length positive"),
    (lambda: Cylinder(1.0, 1.0, 2), "Cylinder has 2 sides; use 3 to 1998"),
    (lambda: Sphere(0.01, 1000), "Sphere has 1000 sides; use 3 to 62"),
    (lambda: polyhedron(RODS), "it has 4808 faces, of which 2000 are taken; give curved surfaces fewer facets"),
    (lambda: Prism((*TRIANGLE[:2], (math.inf, 0.0)), 0.01), "give at least three finite ones"),
    (lambda: Prism(TRIANGLE[::-1], 0.01), "list the corners of a convex polygon counter-clockwise; build others as"),
    (lambda: Wedge((0.01, 0.01, 0.01), 0.02), "set top_x between 0 and size x"),
    (lambda: Hull(FLAT[:3]), "Hull has 3 points; give four or more that are not flat"),
    (lambda: polyhedron(Hull(FLAT)), "4 points span no volume; give four or more that are not flat"),
    (lambda: Union(()), "name at least one part"),
    (lambda: chamfered_box((0.01, 0.01, 0.01), 0.005), "does not fit a section of 0.01 x 0.01 m; shorten it"),
    (lambda: stack([(1e-2 * i, [(1e-3 * x, 1e-3 * y) for x, y in SHOULDERS[i]]) for i in (0, 1)]), "unite several"),
    (lambda: of_faces(left_out=1), "has face 0 only; close the surface and orient all faces outward"),
    (lambda: of_faces(turn=-1), "the volume is -1e-06 m³, not positive; turn the faces round or give it thickness"),
    (lambda: of_faces(BODY.vertices * (1.0, 1.0, 0.0)), "turn the faces round or give it thickness"),
    (cut_corner, "has no area; drop it or merge its vertices"),
    (lambda: from_triangles(BODY.vertices, np.zeros((0, 3), dtype=np.int64)), "check that the operands overlap as"),
    (lambda: convex_hull_polyhedron([*FLAT, *((x, y, 9e-12) for x, y, _ in FLAT)]), "no solid thinner than 1e-9 of"),
    (bent, "give the part faces that are plane, with at most three at a corner"),
    (without_lib3mf, "3MF files need lib3mf, which is not on this machine"),
    (coarse, "describe 'rod' by shapes: an enclosure is larger than the part"),
    (lambda: workplane(0), "the Workplane holds no shape; give it once it is built"),
    (lambda: workplane(2), "give one of its solids"),
    (shape_of_nothing, "the CAD kernel cannot write the shape; give one solid"),
    (lambda: imported_of(SCENE, "mm"), "a Scene of trimesh is no mesh; give one Trimesh"),
    (lambda: imported_of(SECTION, "mm"), "a CrossSection of manifold3d is no solid; give a Manifold"),
    (lambda: Feature("tip", "solid", at(), 0.0), "has length 0.0 m; make it positive"),
    (lambda: Feature("tip", "solid", at(), 0.1, through=True), "is solid and cannot be through; drop `through`"),
    (lambda: with_balls(PEG, [([0.0, 0.0, -0.01], 0.0)]), "has a radius of 0 m; give it a positive one"),
    (lambda: with_balls(PEG, [([0.01, 0.01, 0.0], 0.004)]), "is where a corner or another ball is; move it a little"),
    (lambda: step_import.load_step(Path("prat.step")), "there is no such file; check the path"),
    (lambda: load_mesh(Path("rob.stl"), "mm"), "No such file or directory; check the path"),
)


@pytest.mark.parametrize(("make", "words"), REFUSED, ids=[row[1][:40] for row in REFUSED])
def test_what_bounds_no_solid_is_refused_with_advice(make: Callable[[], object], words: str) -> None:
    with pytest.raises(FmoptError, match=re.escape(words)):
        make()


def two_cubes(move: Callable[[np.ndarray], np.ndarray], one: Any = slice(None), other: Any = slice(None)) -> bytes:
    """A cube and its moved copy in one file, their triangles in turn, so that neither ends first."""
    triangles = np.stack([TRIANGLES[one], TRIANGLES[other] + len(POINTS)], axis=1).reshape(-1, 3)
    return binary_stl(np.vstack([POINTS, move(POINTS)]), triangles)


def spindle(sides: int = 4200) -> bytes:
    """A double cone of 12 x 16 mm, of slivers that lie over each other in planes of their own."""
    one = np.arange(sides)
    ring = 6.0 * np.exp(2j * np.pi * one / sides)
    points = np.vstack([np.column_stack([ring.real, ring.imag, 0.0 * one]), [(0.0, 0.0, -8.0), (0.0, 0.0, 8.0)]])
    low, high = np.full((2, sides), [[sides], [sides + 1]])
    sides_of = [np.column_stack([np.roll(one, -1), one, low]), np.column_stack([one, np.roll(one, -1), high])]
    return binary_stl(points, np.vstack(sides_of))


def coarse_numbers() -> bytes:
    """A rod of 200 sides in metres with three decimals."""
    points, triangles = triangles_of(Cylinder(0.006, 0.03, 200))
    return stl_text(np.round(1e-3 * points, 3), triangles).encode()


FLOOR, TOP = (np.all(POINTS[TRIANGLES][:, :, 2] == z, axis=1) for z in (0.0, 8.0))
ASIDE = np.array([16.0, 0.0, 8.0])
MESHES: tuple[tuple[str, str, bytes, str], ...] = (
    ("rod.iges", "mm", b"", ".iges is no mesh format; use .stl, .obj, .ply, .3mf or .glb, or .step with the extra"),
    ("a.stl", "m", binary_stl(POINTS, TRIANGLES), "m long, more than 4 m; check the unit of its numbers"),
    ("a.stl", "m", coarse_numbers(), "export the mesh again, in mm or with more digits"),
    ("a.stl", "mm", two_cubes(lambda p: 0.5 * p + (0.0, 0.0, 2.0)), "unite them in the program that made the mesh"),
    ("a.stl", "mm", two_cubes(lambda p: p + ASIDE, ~TOP, ~FLOOR), "open along two equal loops; close the mesh"),
    ("a.stl", "mm", spindle(), "too many of the 8400 triangles lie over each other; export the mesh coarser"),
    ("a.stl", "mm", binary_stl(POINTS * (1.0, 1.0, 3e-7), TRIANGLES), "it bounds no solid there"),
)


@pytest.mark.parametrize(("name", "unit", "content", "words"), MESHES, ids=[row[3][:40] for row in MESHES])
def test_meshes_of_no_solid_are_refused(name: str, unit: Any, content: bytes, words: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FmoptError, match=re.escape(words)):
        load_mesh(tmp_path / name, unit)


def test_a_step_file_of_too_many_facets_is_refused_with_advice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(step_import, "MAX_TRIANGLES", 200)
    write_step(tmp_path / "rod.step", cylinder(6.0, 30.0))
    with pytest.raises(FmoptError, match="it becomes 252 facets; give a larger 'deviation' under"):
        step_import.load_step(tmp_path / "rod.step", 1e-5)
