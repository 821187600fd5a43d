"""Advice on mesh files, followed: what is damaged is exported again, what is too fine coarser, what is open closed."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from unittest.mock import patch

import numpy as np

from fmopt.geometry.csg import Box, Cylinder, Difference, Placed, Solid, Union
from fmopt.geometry.mating_features import Feature
from fmopt.geometry.mesh.archive import three_mf_shells
from fmopt.geometry.mesh.mesh_file import OWN_UNIT
from fmopt.geometry.mesh.mesh_import import load_mesh, mesh_polyhedron
from fmopt.geometry.part import Part, mesh_part
from tests.shared.files.advice.case import Case, filed, modelled, volume
from tests.shared.files.mesh_damage import Mesh, subdivided
from tests.shared.files.mesh_files import at, glb, plate, ply_text, stl_text, three_mf, triangles_of
from tests.shared.files.step_files import write_step
from tests.shared.files.step_parts import box
from tests.shared.fuzz.files import binary_stl, obj_text

ROD = triangles_of(Box((0.012, 0.008, 0.03)))
PLATE = triangles_of(plate((0.0123, 0.0083)))
RNG = np.random.default_rng(0)  # asked for by what draws nothing
HOLE = Feature("hole", "hollow", at(z=0.01), 0.01, through=True)
ROD_SIZE = 0.012 * 0.008 * 0.03
PLATE_SIZE = 0.01 * (0.04**2 - 0.0123 * 0.0083)
COARSER = "export it coarser: the planner takes parts of some hundred faces"
SPREAD = "export the mesh again: its points must be spread over its surface"
REPAIR = "repair the mesh: close it, orient all triangles outward, keep the solid free of edges of no thickness"


def read(folder: Path, content: bytes | str, name: str = "part.stl", unit: str = "mm") -> float:
    """The volume of a mesh file."""
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return volume(load_mesh(path, "m" if unit == "m" else "mm"))


def of_obj(folder: Path, text: str) -> float:
    return read(folder, text, "a.obj")


def in_unit(folder: Path, unit: str) -> float:
    return read(folder, stl_text(*ROD), unit=unit)


def meshed(name: str, mesh: Mesh, features: Sequence[Feature] = ()) -> Part:
    """The part of points (n, 3) in mm and triangles (m, 3)."""
    return mesh_part(name, mesh_polyhedron(1e-3 * mesh[0], mesh[1]), features)


def fine(mesh: Mesh, times: int) -> Mesh:
    """Each triangle cut in four, so many times."""
    for _ in range(times):
        mesh = subdivided(*mesh, RNG)
    return mesh


def both(mesh: Mesh, move: Callable[[np.ndarray], np.ndarray]) -> Mesh:
    """A mesh and its moved copy, as two bodies of one file whose triangles alternate, so that none ends first."""
    triangles = np.stack([mesh[1], mesh[1] + len(mesh[0])], axis=1).reshape(-1, 3)
    return np.vstack([mesh[0], move(mesh[0])]), triangles


def without(mesh: Mesh, height: float) -> Mesh:
    """A mesh without the triangles that lie at a height."""
    return mesh[0], mesh[1][~np.all(mesh[0][mesh[1]][:, :, 2] == height, axis=1)]


def many_sided(sides: int) -> Mesh:
    """A cylinder of 12 x 30 mm with its ends as fans about one corner, as exporters make them."""
    angles = 2.0 * np.pi * np.arange(sides) / sides
    ring = 6.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    points = np.vstack([np.column_stack([ring, np.full(sides, z)]) for z in (0.0, 30.0)])
    one, fan = np.arange(sides), np.arange(1, sides - 1)
    two, first = np.roll(one, -1), np.zeros(sides - 2, dtype=np.int64)
    walls = [(one, two, two + sides), (one, two + sides, one + sides)]
    ends = [(first, fan + 1, fan), (first + sides, fan + sides, fan + 1 + sides)]
    return points, np.vstack([np.column_stack(each) for each in (*walls, *ends)])


def spindle(sides: int) -> Mesh:
    """A double cone of 12 x 16 mm, of slivers that lie over each other in planes of their own."""
    ring, one = many_sided(sides)[0][:sides], np.arange(sides)
    two, low, high = np.roll(one, -1), np.full(sides, sides), np.full(sides, sides + 1)
    points = np.vstack([ring, [(0.0, 0.0, -8.0), (0.0, 0.0, 8.0)]])
    return points, np.vstack([np.column_stack([two, one, low]), np.column_stack([one, two, high])])


def every_format(folder: Path) -> tuple[float, ...]:
    """The volume of the rod from a file of each format."""
    points, triangles = ROD
    written: dict[str, bytes | str] = {
        "stl": stl_text(points, triangles),
        "obj": obj_text(points, triangles),
        "ply": ply_text(points, triangles),
        "3mf": three_mf(points, triangles, "millimeter", (0.0, 0.0, 0.0)),
        "glb": glb(1e-3 * points, triangles, {}),
    }
    found = [
        read(folder, content, f"rod.{form}", "m" if form in OWN_UNIT else "mm") for form, content in written.items()
    ]
    write_step(folder / "rod.step", box(12.0, 8.0, 30.0))
    return *found, volume(modelled(folder, '[mesh]\nfile = "rod.step"'))


SOLID_CUBE = Box((0.008, 0.008, 0.008))
CUBE = triangles_of(SOLID_CUBE)
LINES = "v 0 0 0\nv 9 0 0\nl 1 2\n"
THIN = (ROD[0] * (1.0, 1.0, 3e-7), ROD[1])
BESIDE = np.array([16.0, 0.0, 8.0])
HOLES = tuple(
    Placed(Cylinder(0.006, 0.03, 128), at(0.02 * i, 0.04 * j, -0.01)) for i in range(-4, 5) for j in (-2, 0, 2)
)
FEWER = tuple(Placed(Cylinder(0.006, 0.03, 12), hole.pose) for hole in HOLES)
PERFORATED = Box((0.2, 0.2, 0.01))


def level_gaps(open_: bool) -> Mesh:
    """Two cubes, one upon the height of the other; open where both end at one height, or not."""
    low, up = (without(CUBE, 8.0), without(CUBE, 0.0)) if open_ else (CUBE, CUBE)
    return np.round(np.vstack([low[0], up[0] + BESIDE])), np.vstack([low[1], up[1] + len(low[0])])


def heap() -> Mesh:
    """Triangles as good as in one point, but for two corners."""
    near = 1e-9 * np.random.default_rng(1).normal(size=(90_000, 3))
    near[:2] = [[10.0, 0.0, 0.0], [-10.0, 0.0, 0.0]]
    return near, np.arange(90_000).reshape(-1, 3)


def from_mesh(folder: Path, mesh: Mesh) -> float:
    """The volume of a mesh from a binary STL file."""
    return read(folder, binary_stl(*mesh))


def from_solid(folder: Path, solid: Solid) -> float:
    """The volume of a solid from a binary STL file."""
    return read(folder, binary_stl(*triangles_of(solid)))


def moved(*by: float) -> Callable[[np.ndarray], np.ndarray]:
    """A shift, mm."""
    return lambda points: points + np.array(by)


def shared_edge(gap: float) -> Mesh:
    """Two cubes beside each other at an edge, or with a gap there, mm."""
    return both(CUBE, moved(8.0 + gap, 8.0 + gap, 0.0))


def in_metres(folder: Path, mesh: Mesh, decimals: int) -> float:
    """The volume of a mesh from an STL file in m with so many decimals."""
    return read(folder, stl_text(np.round(1e-3 * mesh[0], decimals), mesh[1]), unit="m")


def without_lib3mf(_: Path) -> None:
    with patch.dict(sys.modules, {"lib3mf": None}):
        three_mf_shells(b"")


ROUND, ROUNDER = (0.03 * 0.5 * n * 0.006**2 * math.sin(2.0 * math.pi / n) for n in (64, 200))

CASES = (
    filed("cut short", "export it again", read, stl_text(*ROD)[:-9], stl_text(*ROD), gives=ROD_SIZE),
    Case("too many triangles", COARSER, lambda f: from_mesh(f, fine(ROD, 7)), lambda f: from_mesh(f, ROD), ROD_SIZE),
    filed(
        "lines only", "export the solid, not a drawing or a point cloud", of_obj, LINES, obj_text(*ROD), gives=ROD_SIZE
    ),
    Case(
        "no mesh format",
        "use .stl, .obj, .ply, .3mf or .glb, or .step with the extra step",
        lambda f: read(f, "", "rod.iges"),
        every_format,
        (ROD_SIZE,) * 6,
    ),
    Case("no lib3mf", "save it as an .stl file", without_lib3mf, lambda f: from_mesh(f, ROD), ROD_SIZE),
    Case(
        "no such mesh",
        "check the path",
        lambda f: load_mesh(f / "rob.stl", "mm"),
        lambda f: read(f, stl_text(*ROD), "rod.stl"),
        ROD_SIZE,
    ),
    filed("another unit", "check the unit of its numbers", in_unit, "m", "mm", gives=ROD_SIZE),
    Case(
        "metres with three decimals",
        "export the mesh again, in mm or with more digits",
        lambda f: in_metres(f, many_sided(200), 3),
        lambda f: (
            read(f, stl_text(np.round(many_sided(200)[0], 3), many_sided(200)[1])),
            in_metres(f, many_sided(200), 6),
        ),
        (ROUNDER, ROUNDER),
    ),
    Case(
        "bodies that cross",
        "unite the bodies in the program that made the mesh, and export it again",
        lambda f: from_mesh(f, both(CUBE, moved(2.0, 2.0, 2.0))),
        lambda f: from_solid(f, Union((SOLID_CUBE, Placed(SOLID_CUBE, at(0.002, 0.002, 0.002))))),
        2 * 0.008**3 - 0.006**3,
    ),
    Case(
        "a body in another",
        "unite them in the program that made the mesh",
        lambda f: from_mesh(f, both(CUBE, lambda points: 0.5 * points + (0.0, 0.0, 2.0))),
        lambda f: from_solid(f, Union((SOLID_CUBE, Placed(Box((0.004, 0.004, 0.004)), at(z=0.002))))),
        0.008**3,
    ),
    Case(
        "gaps in one plane",
        "close the mesh",
        lambda f: from_mesh(f, level_gaps(True)),
        lambda f: volume(mesh_polyhedron(1e-3 * level_gaps(False)[0], level_gaps(False)[1])),
        2 * 0.008**3,
    ),
    filed("fans of thousands", "export the mesh coarser", from_mesh, spindle(4200), many_sided(64), gives=ROUND),
    Case(
        "too many faces",
        "give curved surfaces fewer facets, by a coarser export or by lower 'sides'",
        lambda f: from_solid(f, Difference(PERFORATED, HOLES)),
        lambda f: from_solid(f, Difference(PERFORATED, FEWER)),
        0.2 * 0.2 * 0.01 - 27 * 0.01 * 3.0 * 0.006**2,
    ),
    filed("a lost corner", REPAIR, from_mesh, (ROD[0], ROD[1][4:]), ROD, gives=ROD_SIZE),
    filed("an edge of no thickness", REPAIR, from_mesh, shared_edge(0.0), shared_edge(0.5), gives=2 * 0.008**3),
    filed("heap", SPREAD, from_mesh, heap(), ROD, gives=ROD_SIZE),
    filed("no thickness", "export the mesh again: it bounds no solid there", from_mesh, THIN, ROD, gives=ROD_SIZE),
    Case(
        "a gap in a mating face",
        "close the mesh in the program that made it; a gap may be left open at a feature's far end only",
        lambda f: meshed("plate", without(PLATE, 10.0), [HOLE]),
        lambda f: (volume(meshed("plate", PLATE, [HOLE])), volume(meshed("plate", without(PLATE, 0.0), [HOLE]))),
        (PLATE_SIZE, PLATE_SIZE),
    ),
)
