"""Meshes as they come: damaged ones have the features, clearance and faces of the whole ones, or say why not."""

import contextlib
import math
import random
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest

import fmopt
from fmopt.errors import GeometryError
from fmopt.geometry.clearance import mating_clearance
from fmopt.geometry.convex_pieces import pieces, polyhedron
from fmopt.geometry.csg import Box, Difference, Moved, Prism, Solid, Union
from fmopt.geometry.facets import merged_vertices
from fmopt.geometry.fit.find import FoundFit, find
from fmopt.geometry.inverse_csg import MESH_NOISE, apart
from fmopt.geometry.mesh.archive import glb_shells, three_mf_shells
from fmopt.geometry.mesh.mesh_file import read_surface, read_triangles
from fmopt.geometry.mesh.mesh_import import load_mesh, mesh_polyhedron
from fmopt.geometry.part import Part, mesh_part, rebased
from fmopt.task.problem import load
from fmopt.task.sizes import measured_clearance
from tests.shared.files.mesh_damage import DAMAGES
from tests.shared.files.mesh_files import (
    at,
    binary_stl,
    glb,
    plate,
    rounded,
    three_mf,
    three_mf_mesh,
    three_mf_package,
    triangles_of,
    write_stl,
)
from tests.shared.files.model_text import of_file
from tests.shared.files.others import PAIRS, PARTS
from tests.shared.files.own import PROBLEM

GAP = 1e-4
SHAPES: dict[str, tuple[tuple[float, float, float, float], ...]] = {  # rectangles in mm whose union is the outline
    "L": ((0, 0, 20, 8), (0, 0, 8, 20)),
    "T": ((-10, 10, 10, 16), (-3, -6, 3, 16)),
    "U": ((-10, 0, 10, 5), (-10, 0, -5, 15), (5, 0, 10, 15)),
    "keyed": ((-6, -5, 6, 5), (-1.5, -7, 1.5, 5)),
    "rectangle": ((-10, -1, 10, 1),),
}
TEN = [
    *("singles", "noise of 1 µm", "subdivided", "decimated", "unmerged"),
    *("shuffled", "inches", "reflected", "one flipped", "turned"),
]
FAMILIES = [*(f"{n}-gon" for n in range(3, 13)), *SHAPES, "stepped"]


def bars(outline: tuple[tuple[float, float, float, float], ...], grown: float, length: float) -> Solid:
    boxes = [
        Moved(
            Box((1e-3 * (x1 - x0) + 2.0 * grown, 1e-3 * (y1 - y0) + 2.0 * grown, length)),
            at(0.5e-3 * (x0 + x1), 0.5e-3 * (y0 + y1)),
        )
        for x0, y0, x1, y1 in outline
    ]
    return boxes[0] if len(boxes) == 1 else Union(tuple(boxes))


def regular(sides: int, radius: float, length: float) -> Solid:
    angles = 2.0 * math.pi * np.arange(sides) / sides + 0.1
    return Prism(tuple((radius * math.cos(a), radius * math.sin(a)) for a in angles), length)


def pair_of(family: str) -> tuple[Solid, Solid]:
    """A peg and a plate with the hole for it, GAP wider all around."""
    if family == "stepped":
        peg = Union((Box((0.008, 0.008, 0.02)), Moved(Box((0.014, 0.012, 0.02)), at(z=0.02))))
        low = Moved(Box((0.0082, 0.0082, 0.04)), at(z=-0.005))
        return peg, Difference(Box((0.06, 0.06, 0.03)), (low, Moved(Box((0.0142, 0.0122, 0.04)), at(z=0.02))))
    if family.endswith("-gon"):
        n = int(family.removesuffix("-gon"))
        peg, tool = regular(n, 0.008, 0.03), regular(n, 0.008 + GAP / math.cos(math.pi / n), 0.06)
    else:
        peg, tool = bars(SHAPES[family], 0.0, 0.03), bars(SHAPES[family], GAP, 0.06)
    return peg, Difference(Box((0.06, 0.06, 0.01)), (Moved(tool, at(z=-0.02)),))


def read(pair: Iterable[tuple[np.ndarray, np.ndarray]]) -> tuple[Part, Part, FoundFit]:
    """A peg and a plate of points in mm and triangles, and how they mate."""
    moving, fixed = (mesh_part("part", mesh_polyhedron(1e-3 * points, corners)) for points, corners in pair)
    return moving, fixed, find(moving.polyhedron, fixed.polyhedron)


def found_on(moving: Part, fixed: Part, fit: FoundFit) -> tuple[tuple[bool, bool, int], list[int]]:
    return (fit.exchanged, fit.through, fit.alike), [len(each.polyhedron.faces) for each in (moving, fixed)]


def clearance_of(moving: Part, fixed: Part, fit: FoundFit) -> float:
    depth = 0.9 * min(fit.hole, fit.peg)
    return mating_clearance(rebased(moving, fit.solid), rebased(fixed, fit.hollow), depth).per_side


@cache
def whole(family: str) -> tuple[Part, Part, FoundFit]:
    return read(map(triangles_of, pair_of(family)))


@pytest.mark.parametrize("family", FAMILIES)
def test_damaged_prisms_are_what_the_whole_ones_are(family: str) -> None:
    draw = random.Random(f"{family} 1")
    for name in draw.sample(list(DAMAGES), 10):
        rng = np.random.default_rng(draw.randrange(2**32))
        after = read([DAMAGES[name](*triangles_of(solid), rng) for solid in pair_of(family)])
        assert found_on(*after) == found_on(*whole(family)), name
        off = after[0].off + after[1].off
        assert clearance_of(*after) == pytest.approx(clearance_of(*whole(family)), abs=1e-6 + off), name


@pytest.mark.parametrize("name", [name for name in PAIRS if (PARTS / name).is_dir()])
def test_damaged_meshes_of_others_are_what_the_whole_ones_are(name: str) -> None:
    *files, unit, _ = PAIRS[name]
    meshes = [merged_vertices(*read_triangles(PARTS / name / file), 0.0)[:2] for file in files]
    meshes = [({"m": 1e3, "mm": 1.0}[unit] * points, corners) for points, corners in meshes]
    before = read(meshes)
    faces = found_on(*before)[1]
    for number, damage in enumerate(TEN):
        rng = np.random.default_rng(number)
        after = read([DAMAGES[damage](*mesh, rng) for mesh in meshes])
        assert found_on(*after)[0] == found_on(*before)[0], damage
        assert found_on(*after)[1] == pytest.approx(faces, abs=2 if damage == "decimated" else 0), damage
        off = sum(each.off for each in (*before[:2], *after[:2]))
        assert clearance_of(*after) == pytest.approx(clearance_of(*before), abs=1e-6 + off), damage


@pytest.mark.parametrize("size", [1e-4, 1e-3, 1e-2])
def test_what_is_stated_is_how_far_the_file_lies_off(size: float) -> None:
    rng = np.random.default_rng(round(1e6 * size))
    for family in ("5-gon", "T", "stepped"):
        points, corners = DAMAGES["subdivided"](*triangles_of(pair_of(family)[0]), rng)
        noisy = points + rng.uniform(-size, size, points.shape)
        mesh = mesh_polyhedron(1e-3 * noisy, corners)
        assert 0.3e-3 * size < mesh.off < 4e-3 * size
        heights = 1e-3 * noisy @ mesh.body.normals.T - mesh.body.offsets
        assert np.abs(heights).min(axis=1).max() <= mesh.off + 1e-12


@pytest.mark.parametrize("width", [8.2, 8.25])
@pytest.mark.parametrize("shift", [(0.0, -6.0, 60.0), (0.0, 0.0, 21.0), (4.1, -6.0, 21.0)])
def test_an_angle_cut_by_two_boxes_comes_apart(width: float, shift: tuple[float, float, float]) -> None:
    x, y, length = (1e-3 * value for value in shift)
    one = Moved(Box((0.0202, 1e-3 * width, length)), at(x, y, -0.01 if length > 0.05 else 0.02))
    other = Moved(Box((1e-3 * width, 0.0202, length)), at(x - 0.006, y + 0.006, -0.01 if length > 0.05 else 0.02))
    body = polyhedron(Difference(Box((0.06, 0.06, 0.04)), (one, other)))
    again = apart(body, MESH_NOISE * body.diameter)[0]
    assert polyhedron(again).volume == pytest.approx(body.volume, rel=1e-9)
    assert len(pieces(again)) >= 4


def folder(path: Path, size: float) -> Path:
    """A problem of a rod and a plate as binary STL, turned and with noise of that size (mm)."""
    rng = np.random.default_rng(4)
    for name, solid in (("rod", rounded((0.012, 0.008), 0.03, 0.0005)), ("plate", plate((0.0123, 0.0083)))):
        points, corners = DAMAGES["turned"](*triangles_of(solid), rng)
        (path / f"{name}.stl").write_bytes(binary_stl(points + rng.uniform(-size, size, points.shape), corners))
        (path / f"{name}.toml").write_text(of_file(f"{name}.stl"))
    (path / "problem.toml").write_text(PROBLEM)
    return path / "problem.toml"


def test_a_noisy_pair_anywhere_in_space_is_certified_and_checked(tmp_path: Path) -> None:
    problem = fmopt.load(folder(tmp_path, 1e-3))
    plan = fmopt.solve(problem)
    assert (plan.verdict, plan.verify(problem).verdict) == ("CERTIFIED", "CERTIFIED")


def test_noise_beyond_the_clearance_is_refused_with_its_place(tmp_path: Path) -> None:
    write_stl(tmp_path / "rod.stl", rounded((0.012, 0.008), 0.03))
    points, corners = triangles_of(plate((0.01202, 0.00802)))
    dense = DAMAGES["subdivided"](points, corners, np.random.default_rng(1))
    noisy = DAMAGES["noise of 10 µm"](*dense, np.random.default_rng(1))
    (tmp_path / "plate.stl").write_bytes(binary_stl(*noisy))
    for name in ("rod", "plate"):
        (tmp_path / f"{name}.toml").write_text(of_file(f"{name}.stl"))
    (tmp_path / "problem.toml").write_text(PROBLEM.replace("x = 0.2\ny = 0.15", "x = 0.01\ny = 0.01"))
    with pytest.raises(fmopt.FmoptError, match=r"facets of 'plate' are up to [\d.]+ µm off plane faces, mos") as told:
        measured_clearance(load(tmp_path / "problem.toml"))
    assert "the clearance is" in str(told.value)


@pytest.mark.parametrize("form", ["3mf", "glb"])
def test_packages_say_unit_and_place(form: str, tmp_path: Path) -> None:
    points, corners = triangles_of(rounded((0.012, 0.008), 0.03))
    if form == "3mf":
        content = three_mf(points / 25.4, corners, "inch", (1.0, 2.0, 3.0))
        moved = points + 25.4 * np.array([1.0, 2.0, 3.0])
    else:
        node = {"scale": [0.5] * 3, "rotation": [0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)], "translation": [1e-3, 0, 0]}
        content = glb(2e-3 * points, corners, node)
        moved = points @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) + (1.0, 0.0, 0.0)
    (tmp_path / f"rod.{form}").write_bytes(content)
    body = load_mesh(tmp_path / f"rod.{form}", "m").body
    np.testing.assert_allclose(np.sort(body.vertices, axis=0), 1e-3 * np.sort(moved, axis=0), atol=1e-8)
    if form == "3mf":
        with ZipFile(tmp_path / "rod.3mf") as whole, ZipFile(tmp_path / "bare.3mf", "w") as bare:
            bare.writestr("3D/3dmodel.model", whole.read("3D/3dmodel.model"))
        assert load_mesh(tmp_path / "bare.3mf", "m").body.volume == body.volume
    draw = random.Random(f"{form} 3")
    read = glb_shells if form == "glb" else three_mf_shells
    for _ in range(150):
        damaged = bytearray(content)
        for _ in range(draw.randint(1, 12)):
            damaged[draw.randrange(len(damaged))] = draw.randrange(256)
        cut = bytes(damaged[: draw.choice((len(damaged), draw.randrange(len(damaged))))])
        with contextlib.suppress(GeometryError):
            read(cut)
    (tmp_path / f"a.{form}").write_bytes(content[: len(content) // 2])
    with pytest.raises(GeometryError, match=rf"a\.{form}: .*; export it again"):
        read_triangles(tmp_path / f"a.{form}")


def twice(number: int, place: str = "1 0 0 0 1 0 0 0 1 0 0 0") -> str:
    """The object of a 3MF file that is made of the one before it twice, the second time in a place."""
    one = f'<component objectid="{number - 1}"'
    return f'<object id="{number}" type="model"><components>{one}/>{one} transform="{place}"/></components></object>'


def test_solids_that_are_put_together_without_end_are_refused(tmp_path: Path) -> None:
    """Each holds the next one twice: a file of some kilobytes would be 2³¹ solids."""
    points, corners = triangles_of(rounded((0.012, 0.008), 0.03))
    mesh = f'<object id="1" type="model">{three_mf_mesh(points, corners)}</object>'
    doubled = mesh + "".join(map(twice, range(2, 20)))
    for objects, items in ((doubled, '<item objectid="19"/>'), (mesh, 20001 * '<item objectid="1"/>')):
        (tmp_path / "a.3mf").write_bytes(three_mf_package(objects, items))
        with pytest.raises(GeometryError, match="more than 400000 points and triangles"):
            read_triangles(tmp_path / "a.3mf")


def test_solids_of_solids_of_a_package_stand_where_each_puts_them(tmp_path: Path) -> None:
    """Four rods by two levels, one of them in a mirror, and a second name in the build."""
    points, corners = triangles_of(rounded((0.012, 0.008), 0.03))
    mesh = f'<object id="1" name="rod" type="model">{three_mf_mesh(points, corners)}</object>'
    pairs = twice(2, "-1 0 0 0 1 0 0 0 1 50 0 0") + twice(3, "1 0 0 0 1 0 0 0 1 200 0 0")
    (tmp_path / "a.3mf").write_bytes(three_mf_package(mesh + pairs, '<item objectid="3"/><item objectid="1"/>'))
    bodies = read_surface(tmp_path / "a.3mf", lambda surface: surface.bodies())
    assert [name for name, _, _ in bodies] == [f"rod_{k}" for k in range(1, 6)]
    middles = [1e3 * (np.min(points, axis=0) + np.max(points, axis=0))[0] / 2 for _, points, _ in bodies]
    np.testing.assert_allclose(middles, [0.0, 50.0, 200.0, 250.0, 0.0], atol=1e-5)
    for _, points, corners in bodies:
        volume = float(np.linalg.det(points[corners]).sum()) / 6.0
        assert volume == pytest.approx(0.012 * 0.008 * 0.03, rel=1e-6)


def test_a_package_takes_no_unit(tmp_path: Path) -> None:
    file = folder(tmp_path, 0.0)
    points, corners = triangles_of(rounded((0.012, 0.008), 0.03, 0.0005))
    (tmp_path / "rod.3mf").write_bytes(three_mf(points, corners, "millimeter", (0.0, 0.0, 0.0)))
    model = (tmp_path / "rod.toml").read_text().replace("rod.stl", "rod.3mf")
    (tmp_path / "rod.toml").write_text(model)
    with pytest.raises(fmopt.InputError, match="a 3MF file says its unit itself; remove 'unit'"):
        load(file)
    (tmp_path / "rod.toml").write_text(model.replace('unit = "mm"\n', ""))
    assert load(file).moving.polyhedron.volume > 0.0
