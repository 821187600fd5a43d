"""Meshes made by others: features found, gaps closed or refused, faults named by triangle, facets of curves judged."""

import math
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from fmopt.errors import GeometryError
from fmopt.geometry.clearance import Clearance, mating_clearance
from fmopt.geometry.csg import Box, Cylinder, Difference, Moved, Prism, Solid, Union
from fmopt.geometry.fit.find import FoundFit, find
from fmopt.geometry.mating_features import Feature
from fmopt.geometry.mesh.mesh_import import Imported, load_mesh, mesh_polyhedron
from fmopt.geometry.part import Part, mesh_part, rebased
from fmopt.spatial.se3 import Pose, exp
from tests.shared.files.mesh_files import at, plate, rounded, stl_text, triangles_of
from tests.shared.solids import frustum

ROD = rounded((0.012, 0.008), 0.03, 0.0005)
PLATE = plate((0.0123, 0.0083))
HOLE = Feature("hole", "hollow", at(z=0.01), 0.01, through=True)


def mesh_of(solid: Solid) -> Imported:
    points, triangles = triangles_of(solid)
    return mesh_polyhedron(1e-3 * points, triangles)


def part_of(name: str, solid: Solid) -> Part:
    return mesh_part(name, mesh_of(solid))


def found(moving: Solid, fixed: Solid) -> FoundFit:
    return find(mesh_of(moving).body, mesh_of(fixed).body)


def measured(moving: Part, fixed: Part) -> Clearance:
    """In the frames in which they are found to mate."""
    fit = find(moving.polyhedron, fixed.polyhedron)
    return mating_clearance(rebased(moving, fit.solid), rebased(fixed, fit.hollow), 0.01)


def test_peg_and_hole_are_found_with_frames_that_agree() -> None:
    peg, block = part_of("rod", ROD), part_of("plate", PLATE)
    fit = find(peg.polyhedron, block.polyhedron)
    assert (fit.exchanged, fit.depth, fit.hole, fit.peg, fit.through, fit.alike) == (False, 0.01, 0.01, 0.03, True, 1)
    np.testing.assert_array_equal(fit.hollow.p, [0.0, 0.0, 0.01])
    clearance = measured(peg, block)
    assert clearance.play == pytest.approx((3e-4, 3e-4), abs=1e-9)
    assert clearance.per_side == pytest.approx(1.5e-4, abs=1e-9)
    assert fit.clearance == pytest.approx(1.5e-4, abs=1e-9)


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (0.5, -0.3, 0.8), (0.0, 1.5707963267948966, 0.0), (3.0, 0.2, 0.1)])
def test_features_move_with_the_part(turn: tuple[float, float, float]) -> None:
    angles = np.linspace(-0.7, 0.7, 9) * np.pi
    key, wider = (Prism(tuple((r * np.cos(a), r * np.sin(a)) for a in angles), 0.05) for r in (0.01, 0.0101))
    bore = Difference(Box((0.05, 0.05, 0.02)), (Moved(wider, at(z=-0.01)),))
    pose = Pose(np.array([0.01, -0.02, 0.03]), exp(turn))
    still = found(key, bore)
    peg, hole = found(Moved(key, pose), bore), found(key, Moved(bore, pose))
    for own, frame, long in ((still.solid, peg.solid, still.peg), (still.hollow, hole.hollow, -still.hole)):
        there = pose.compose(own)
        ends = [there.p, there.p + long * there.R[:, 2]]
        near = min(ends, key=lambda end: float(np.linalg.norm(end - frame.p)))
        np.testing.assert_allclose(frame.p, near, atol=3e-8)
        assert abs(frame.R[:, 2] @ there.R[:, 2]) == pytest.approx(1.0, abs=1e-6)
        assert abs(frame.R[:, 1] @ there.R[:, 1]) == pytest.approx(1.0, abs=1e-4)
        np.testing.assert_allclose(frame.R.T @ frame.R, np.eye(3), atol=1e-9)
    assert [peg.clearance, hole.clearance] == pytest.approx(2 * [still.clearance], abs=1e-9)


def test_a_headed_pin_leads_with_its_shank_and_a_chamfered_mouth_is_the_mouth() -> None:
    pin = Union((Box((0.008, 0.008, 0.03)), Moved(Box((0.02, 0.02, 0.005)), at(z=0.03))))
    mouth = Moved(frustum((0.0083, 0.0083), (0.0103, 0.0103), 0.001), at(z=0.009))
    fit = found(pin, Difference(plate((0.0083, 0.0083)), (mouth,)))
    np.testing.assert_allclose(fit.solid.vector(), 0.0, atol=1e-9)
    np.testing.assert_allclose(fit.hollow.vector(), [0.0, 0.0, 0.01, 0.0, 0.0, 0.0], atol=1e-9)
    assert (fit.through, fit.depth) == (True, pytest.approx(0.03))


def test_a_far_rim_left_open_is_closed_and_told() -> None:
    points, triangles = triangles_of(PLATE)
    open_below = triangles[~np.all(points[triangles][:, :, 2] == 0.0, axis=1)]  # without the face on z = 0
    mesh = mesh_polyhedron(1e-3 * points, open_below)
    whole = mesh_of(PLATE)
    assert mesh.body.volume == pytest.approx(whole.body.volume, rel=1e-12)
    assert len(mesh.body.faces) == len(whole.body.faces)
    (note,) = mesh.notes
    assert "open beside triangle" in note
    part = mesh_part("plate", mesh, [HOLE])
    assert part.notes == (f"warning: plate: {note}",)


@pytest.mark.parametrize("gap", [0.0, 0.2])
def test_a_slit_around_the_far_rim_is_closed(gap: float) -> None:
    points, triangles = triangles_of(PLATE)
    rim = np.flatnonzero((points[:, 2] == 0.0) & (np.abs(points[:, 0]) < 7.0))
    walls = np.any(points[triangles][:, :, 2] > 0.0, axis=1)
    lifted = points[rim] * (1.0, 1.0, 0.0) + (0.0, 0.0, gap) + 0.05 * np.sign(points[rim]) * (gap == 0.0)
    moved = np.vstack([points, lifted])
    swap = np.arange(len(moved))
    swap[rim] = np.arange(len(points), len(moved))
    split = np.where(walls[:, None], triangles, swap[triangles]) if gap == 0.0 else np.where(
        walls[:, None], swap[triangles], triangles
    )  # fmt: skip
    mesh = mesh_polyhedron(1e-3 * moved, split)
    assert len(mesh.mended) == 1
    assert mesh.body.volume == pytest.approx(mesh_of(PLATE).body.volume, rel=1e-6)
    assert find(mesh_of(ROD).body, mesh_part("plate", mesh, [HOLE]).polyhedron).through


def test_gaps_in_mating_faces_are_refused_with_their_triangle() -> None:
    points, triangles = triangles_of(PLATE)
    wall = np.all(np.abs(points[triangles][:, :, 0]) < 7.0, axis=1) & (np.ptp(points[triangles][:, :, 2], axis=1) > 5.0)
    side = wall & (points[triangles][:, :, 0].max(axis=1) < 0.0) & (np.ptp(points[triangles][:, :, 0], axis=1) == 0.0)
    mesh = mesh_polyhedron(1e-3 * points, triangles[~side])
    with pytest.raises(GeometryError, match=r"mesh 'plate' is open beside triangle \d+, .* feature 'hole' of 10 mm"):
        mesh_part("plate", mesh, [HOLE])
    half = mesh_polyhedron(1e-3 * points, np.delete(triangles, int(np.flatnonzero(side)[0]), axis=0))
    assert mesh_part("plate", half, [HOLE]).polyhedron.volume == pytest.approx(mesh_of(PLATE).body.volume, rel=1e-12)
    mouthless = triangles[~np.all(points[triangles][:, :, 2] == 10.0, axis=1)]
    with pytest.raises(GeometryError, match="which is 0 mm along feature 'hole'"):
        mesh_part("plate", mesh_polyhedron(1e-3 * points, mouthless), [HOLE])
    half = triangles[np.all(points[triangles][:, :, 2] == 0.0, axis=1)]
    with pytest.raises(GeometryError, match="the surface is open: edge"):
        mesh_polyhedron(1e-3 * points, half)


def test_faults_name_the_triangle_of_the_file(tmp_path: Path) -> None:
    points, triangles = triangles_of(ROD)
    flat = np.array([[0, 0, 1]])
    path = tmp_path / "rod.stl"
    path.write_text(stl_text(points, np.vstack([flat, triangles])))
    (note,) = load_mesh(path, "mm").notes
    assert note.startswith("triangle 0 at (")
    assert note.endswith("mm has no area and was left out")
    turned = np.vstack([flat, triangles])
    turned[7] = turned[7, ::-1]
    path.write_text(stl_text(points, turned))
    assert "triangle 7 at (" in " ".join(load_mesh(path, "mm").notes)
    crossing = np.vstack([points, points @ exp([0.3, 0.0, 0.4]).T + 0.5])
    inward = triangles[:, ::-1] + len(points)  # a shell of its own would be a cavity: it is not united
    path.write_text(stl_text(crossing, np.vstack([triangles, inward])))
    with pytest.raises(GeometryError, match=r"itself: triangles \d+ and \d+ cross at \(") as told:
        load_mesh(path, "mm")
    assert told.value.advice
    nested = np.vstack([points, 0.5 * points + (0.0, 0.0, 5.0)])
    path.write_text(stl_text(nested, np.vstack([triangles, triangles + len(points)])))
    one = load_mesh(path, "mm")
    assert "are one solid" in one.notes[0]
    assert one.body.volume == pytest.approx(mesh_of(ROD).body.volume, rel=1e-6)


def test_crossings_are_found_where_there_are_some_and_only_there() -> None:
    rng = np.random.default_rng(3)
    points, triangles = triangles_of(ROD)
    both = np.vstack([triangles, triangles + len(points)])
    for _ in range(20):
        shift = exp(rng.normal(size=3)) @ np.array([40.0, 0.0, 0.0])
        assert mesh_polyhedron(1e-3 * np.vstack([points, points + shift]), both).body.volume > 0.0
        shift = rng.uniform(0.3, 3.0, 3)
        one = mesh_polyhedron(1e-3 * np.vstack([points, points + shift]), both)
        rods = [trimesh.Trimesh(points + off, triangles) for off in (0.0, shift)]
        together = float(trimesh.boolean.union(rods, engine="manifold").volume)
        assert one.body.volume == pytest.approx(1e-9 * together, rel=1e-6)


@pytest.mark.parametrize("corner", ["1e9999", "nan", "-1"])
def test_a_corner_that_is_no_number_of_a_point_is_damage(tmp_path: Path, corner: str) -> None:
    header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    header += "element face 1\nproperty list uchar float vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_text(f"{header}0 0 0\n1 0 0\n0 1 0\n3 0 1 {corner}\n")
    with pytest.raises(GeometryError, match=r"a\.ply, line 13: "):
        load_mesh(tmp_path / "a.ply", "mm")
    packed = header.replace("ascii", "binary_little_endian").encode() + struct.pack("<9f", *range(9))
    packed += struct.pack("<B3f", 3, 0.0, 1.0, math.inf if corner == "1e9999" else float(corner))
    (tmp_path / "b.ply").write_bytes(packed)
    with pytest.raises(GeometryError, match=r"b\.ply, "):
        load_mesh(tmp_path / "b.ply", "mm")


def test_lines_keep_their_numbers_where_others_go_on(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 \\\n0 0\nv 1 0 \\\r\n\\\n0\nv 0 1 0\nf 1 2 \\\n3\nv 0 one 0\n")
    with pytest.raises(GeometryError, match=r"a\.obj, line 9: 'one' is no finite number"):
        load_mesh(tmp_path / "a.obj", "mm")


@pytest.mark.parametrize("sides", [12, 24, 64])
def test_facets_of_a_cylinder_lie_a_sagitta_inside(sides: int) -> None:
    radius = 0.01
    gap = radius * (1.0 - np.cos(np.pi / sides))
    assert mesh_of(Cylinder(radius, 0.03, sides)).chord_error == pytest.approx(gap, rel=1e-5)
    bored = Difference(Box((0.05, 0.05, 0.02)), (Moved(Cylinder(radius, 0.04, sides), at(z=-0.01)),))
    assert mesh_of(bored).chord_error == pytest.approx(gap, rel=1e-5)


@pytest.mark.parametrize("solid", [ROD, PLATE, Cylinder(0.01, 0.03, 8), frustum((0.02, 0.02), (0.016, 0.016), 0.02)])
def test_plane_parts_stand_for_nothing_curved(solid: Solid) -> None:
    assert mesh_of(solid).chord_error == 0.0


def test_stated_features_and_deviations_are_taken() -> None:
    stated = Feature("shank", "solid", at(), 0.02)
    part = mesh_part("rod", mesh_of(ROD), [stated], 2e-6)
    assert (part.features, part.chord_error) == ((stated,), 2e-6)


def finely(solid: Solid, times: int, cut: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of a solid, each cut in four that many times; corners beyond (x, y) mm on the 45° cuts only."""
    from trimesh.remesh import subdivide

    points, triangles = triangles_of(solid)
    for _ in range(times):
        points, triangles = subdivide(points, triangles)
    assert np.any((np.abs(points[:, 0]) > cut[0]) & (np.abs(points[:, 1]) > cut[1]))
    return points, triangles


@pytest.mark.parametrize("times", [2, 3])
def test_a_chamfer_that_is_plane_but_for_rounding_is_plane(tmp_path: Path, times: int) -> None:
    bar = rounded((0.008201, 0.006911), 0.05, 0.000257)
    points, triangles = finely(bar, times, (3.85, 3.2))
    path = tmp_path / "bar.stl"
    path.write_text(stl_text(np.round(points, 3), triangles))
    part = mesh_part("bar", load_mesh(path, "mm"))
    assert (len(part.pieces), len(part.polyhedron.faces)) == (1, 10)
    assert 0.0 < part.form < 2e-6
    (note,) = part.notes
    assert note.startswith("warning: bar: facets are up to")
    assert note.endswith("they were made plane, which is a tolerance of form")
    hole = part_of("plate", plate((0.0085, 0.0073)))
    pair = [measured(one, hole) for one in (part, part_of("bar", bar))]
    assert pair[0].per_side == pytest.approx(pair[1].per_side, abs=1e-6)


def test_facets_that_are_not_plane_are_named() -> None:
    points, triangles = finely(rounded((0.008201, 0.006911), 0.05, 0.000257), 2, (3.85, 3.2))
    rng = np.random.default_rng(5)
    uneven = points + rng.uniform(-5e-2, 5e-2, points.shape)
    with pytest.raises(GeometryError, match=r"at \(.*\) mm|µm off") as told:
        mesh_part("bar", mesh_polyhedron(1e-3 * uneven, triangles))
    assert told.value.advice


@pytest.mark.parametrize("decimals", [3, 9])
def test_the_frame_of_a_round_hole_lies_along_the_model_whatever_its_numbers_are_rounded_to(decimals: int) -> None:
    bored = Difference(Box((0.04, 0.04, 0.009)), (Moved(Cylinder(0.00825, 0.02, 96), at(z=-0.005)),))
    points, triangles = triangles_of(bored)
    plate = mesh_polyhedron(1e-3 * np.round(points, decimals), triangles)
    np.testing.assert_array_equal(find(mesh_of(Cylinder(0.008, 0.03, 96)).body, plate.body).hollow.R, np.eye(3))
