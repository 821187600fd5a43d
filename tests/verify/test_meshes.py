"""Meshes in the check: its own readers, surfaces held against parts, frames that the planner found, damaged files."""

from __future__ import annotations

import random
import struct
from pathlib import Path

import numpy as np
import pytest

from fmopt.geometry.csg import Box, Cylinder, Difference, Placed, Solid
from fmopt.task.problem import load
from fmopt.verify.problem.meshes import NoMesh, Triangle, triangles
from fmopt.verify.problem.parts import Compared, chord_error, part_beside_its_model
from fmopt.verify.problem.problem import load_problem
from tests.shared.files.mesh_files import at, plate, ply_text, rounded, stl_text, triangles_of, write_stl
from tests.shared.files.own import MODEL, PROBLEM
from tests.shared.files.packed import body, packed_stl, part

DECLARED = """
[features.{name}]
kind = "{kind}"
at = [{at}]
length = {length}
"""


def obj_text(points: np.ndarray, faces: np.ndarray) -> str:
    rows = [f"v {x!r} {y!r} {z!r} # a corner" for x, y, z in points.tolist()]
    loops = ["f " + " ".join(f"{k + 1}/1/1" if i % 2 else str(k - len(points)) for k in f) for i, f in enumerate(faces)]
    return "\n".join([*rows, "vn 0 0 1", "g part", *loops, ""])


def packed_ply(points: np.ndarray, faces: np.ndarray, order: str) -> bytes:
    name = {"<": "little", ">": "big"}[order]
    axes = "".join(f"property double {axis}\n" for axis in "xyz")
    head = f"ply\nformat binary_{name}_endian 1.0\nelement vertex {len(points)}\n{axes}element face {len(faces)}\n"
    head += "property uchar flags\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [struct.pack(f"{order}3d", *p) for p in points.tolist()]
    return head.encode() + b"".join(rows + [struct.pack(f"{order}BB3i", 7, 3, *f) for f in faces.tolist()])


def rod() -> tuple[np.ndarray, np.ndarray]:
    return triangles_of(rounded((0.012, 0.008), 0.03, 0.0005))


def files() -> dict[str, tuple[str, bytes]]:
    """One solid in every form of file."""
    points, faces = rod()
    return {
        "STL": ("stl", stl_text(points, faces).encode()),
        "packed STL": ("stl", packed_stl(points, faces)),
        "OBJ": ("obj", obj_text(points, faces).encode()),
        "PLY": ("ply", ply_text(points, faces).encode()),
        "packed PLY": ("ply", packed_ply(points, faces, "<")),
        "PLY of the other order": ("ply", packed_ply(points, faces, ">")),
    }


@pytest.mark.parametrize("form", files())
def test_triangles_are_read_as_they_were_written(form: str) -> None:
    points, faces = rod()
    kind, content = files()[form]
    found = np.array(triangles(content, kind, 1e3))
    assert found == pytest.approx(1e-3 * points[faces], abs=1e-9)


@pytest.mark.parametrize("form", files())
def test_damaged_files_are_refused_or_read_and_nothing_else(form: str) -> None:
    kind, content = files()[form]
    draw = random.Random(f"{form} 7")
    for _ in range(100):
        damaged = bytearray(content)
        for _ in range(draw.randint(1, 20)):
            damaged[draw.randrange(len(damaged))] = draw.randrange(256)
        cut = draw.choice((len(damaged), draw.randrange(len(damaged))))
        try:
            found: list[Triangle] = triangles(bytes(damaged[:cut]), kind, 1e3)
        except NoMesh:
            continue
        assert found


def folder(path: Path, moving: Solid, fixed: Solid, features: tuple[str, str] = ("", "")) -> Path:
    for name, solid, told in zip(("rod", "plate"), (moving, fixed), features, strict=True):
        write_stl(path / f"{name}.stl", solid)
        (path / f"{name}.toml").write_text(MODEL.format(name=name) + told)
    (path / "problem.toml").write_text(PROBLEM)
    return path / "problem.toml"


TOLD = (
    DECLARED.format(name="peg", kind="solid", at="0, 0, 0", length=30),
    DECLARED.format(name="hole", kind="hollow", at="0, 0, 10", length=10) + "through = true\n",
)
OWN = rounded((0.012, 0.008), 0.03, 0.0005), plate((0.0123, 0.0083))


@pytest.mark.parametrize("features", [TOLD, ("", "")], ids=["declared", "found"])
def test_parts_of_meshes_are_those_of_their_files(tmp_path: Path, features: tuple[str, str]) -> None:
    file = folder(tmp_path, *OWN, features)
    problem, read = load(file), load_problem(file)
    assert read.sha256 == problem.sha256
    for side, planners in (("moving", problem.moving), ("fixed", problem.fixed)):
        found = part_beside_its_model(part(planners), read, side, None)
        assert found.differences == ()
        assert len(found.remarks) == (features == ("", ""))
        assert found.chord.least == planners.chord_error == 0.0


def other(tmp_path: Path, features: tuple[str, str], moving: Solid, fixed: Solid) -> tuple[Compared, Compared]:
    """The parts of the problem, held against the meshes of other solids."""
    problem = load(folder(tmp_path, *OWN, features))
    read = load_problem(folder(tmp_path, moving, fixed, features))
    one = part_beside_its_model(part(problem.moving), read, "moving", None)
    return one, part_beside_its_model(part(problem.fixed), read, "fixed", None)


@pytest.mark.parametrize("features", [TOLD, ("", "")], ids=["declared", "found"])
def test_other_meshes_are_noticed(tmp_path: Path, features: tuple[str, str]) -> None:
    blind = Difference(Box((0.04, 0.04, 0.01)), (Placed(rounded((0.0123, 0.0083), 0.02), at(z=0.001)),))
    longer, floor = other(tmp_path, features, rounded((0.012, 0.008), 0.0302, 0.0005), blind)
    assert "for another moving part than the mesh rod.stl" in longer.differences[0]
    assert "for another fixed part than the mesh plate.stl" in floor.differences[0]
    thicker, wider = other(tmp_path, features, rounded((0.0121, 0.008), 0.03, 0.0005), plate((0.0124, 0.0083)))
    assert thicker.differences
    assert wider.differences


def test_a_mesh_that_is_elsewhere_is_noticed_where_features_are_declared(tmp_path: Path) -> None:
    moved, plate_ = other(tmp_path, TOLD, Placed(OWN[0], at(x=0.0001)), OWN[1])
    assert moved.differences
    assert not plate_.differences


def test_facets_add_what_the_planner_says_they_add(tmp_path: Path) -> None:
    bore = Difference(Box((0.04, 0.04, 0.01)), (Placed(Cylinder(0.0077, 0.02), at(z=-0.005)),))
    file = folder(tmp_path, OWN[0], bore, TOLD)
    problem, read = load(file), load_problem(file)
    assert chord_error(body(problem.fixed.polyhedron)) == pytest.approx(problem.fixed.chord_error, rel=1e-4)
    found = part_beside_its_model(part(problem.fixed), read, "fixed", None)
    assert found.differences == ()
    assert found.chord.least <= problem.fixed.chord_error <= found.chord.most
    (tmp_path / "plate.toml").write_text(
        (tmp_path / "plate.toml").read_text().replace("unit =", "deviation = 1\nunit =")
    )
    assert part_beside_its_model(part(problem.fixed), load_problem(file), "fixed", None).chord.least == 1e-3


def test_step_files_are_held_against_what_the_planner_makes_of_them(tmp_path: Path) -> None:
    from fmopt.notebook.checking import given

    file = folder(tmp_path, *OWN, TOLD)
    problem = load(file)
    plate_ = (tmp_path / "plate.toml").read_text().replace('file = "plate.stl"\nunit = "mm"\n', 'file = "plate.step"\n')
    (tmp_path / "plate.toml").write_text(plate_)
    (tmp_path / "plate.step").write_text("ISO-10303-21;")
    read = load_problem(file)
    alone = part_beside_its_model(part(problem.fixed), read, "fixed", None)
    assert alone.differences == (
        "parts.fixed: the part was not compared with plate.step: the check reads no STEP files",
    )
    beside = part_beside_its_model(part(problem.fixed), read, "fixed", lambda: given(problem))
    assert beside.differences == ()
    assert "by way of the planner's reader" in beside.remarks[0]
    wrong = part_beside_its_model(part(problem.moving), read, "fixed", lambda: given(problem))
    assert "for another fixed part" in wrong.differences[0]
