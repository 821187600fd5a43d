"""Parts: frames, sections, measured clearance, interference, and meshes from files."""

import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmopt.errors import GeometryError, InterferenceError
from fmopt.geometry.clearance import checked_clearance, interference, mating_clearance
from fmopt.geometry.convex_pieces import _chain, pieces, polyhedron
from fmopt.geometry.csg import Box, Cylinder, Difference, Moved, Prism, Solid, Union, Wedge, chamfered_box
from fmopt.geometry.inverse_csg import apart
from fmopt.geometry.mating_features import Feature
from fmopt.geometry.mesh.mesh_import import load_mesh
from fmopt.geometry.part import Part, in_order, mesh_part, part_of, rebased
from fmopt.geometry.polyhedron import Polyhedron, from_faces, triangulated
from fmopt.geometry.section import section, section_limit
from fmopt.spatial.se3 import Pose
from tests.shared.files.mesh_files import at, obj_text, stl_text
from tests.shared.solids import frustum

HOLE = Feature("hole", "hollow", at(z=0.04), 0.03)
TOOL = Moved(Box((0.0202, 0.0202, 0.03)), at(z=0.01))
BLOCK = Difference(Box((0.06, 0.06, 0.04)), (TOOL,))
CHAMFERED = Difference(BLOCK, (Moved(frustum((0.0202, 0.0202), (0.0242, 0.0242), 0.002), at(z=0.038)),))
SEATED = at(z=-0.03)


def block(solid: Solid = BLOCK) -> Part:
    return rebased(part_of("block", solid, (HOLE,)), HOLE.frame)


def peg(solid: Solid | None = None) -> Part:
    return part_of("peg", solid or Box((0.02, 0.02, 0.05)), (Feature("tip", "solid", at(), 0.05),))


def test_rebasing_makes_the_feature_the_origin() -> None:
    part = block()
    assert np.array_equal(part.feature("hole").frame.vector(), np.zeros(6))
    assert part.polyhedron.vertices[:, 2].max() == 0.0
    assert set(part.polyhedron.vertices[:, 2].tolist()) == {0.0, -0.03, -0.04}
    assert {piece.vertices[:, 2].max() for piece in part.pieces} == {0.0, -0.03}
    turned = rebased(part, Pose.from_vector([0.0, 0.0, 0.0, np.pi, 0.0, 0.0]))
    assert turned.polyhedron.vertices[:, 2].min() == 0.0
    assert turned.polyhedron.volume == pytest.approx(part.polyhedron.volume, rel=1e-12)
    assert pickle.loads(pickle.dumps(part)).feature("hole").length == 0.03
    with pytest.raises(GeometryError, match="its features: hole"):
        part.feature("slot")


def shuffled(body: Polyhedron, rng: np.random.Generator) -> Polyhedron:
    """The body with its corners and faces in another order, each loop begun elsewhere."""
    order = rng.permutation(len(body.vertices))
    number = np.argsort(order)
    faces = []
    for n in rng.permutation(len(body.faces)):
        loops = [np.roll(number[list(loop)], rng.integers(len(loop))).tolist() for loop in body.faces[n].loops]
        faces.append([loops[0], *(loops[k] for k in 1 + rng.permutation(len(loops) - 1))])
    return from_faces(body.vertices[order], faces)


@pytest.mark.parametrize("solid", [BLOCK, CHAMFERED, Difference(BLOCK, (Moved(Box((0.03, 0.003, 0.03)), at(z=0.01)),))])
def test_the_order_of_a_file_is_forgotten(solid: Solid) -> None:
    rng, part = np.random.default_rng(0), block(solid)
    own = in_order(part)
    assert {tuple(v) for v in own.polyhedron.vertices.tolist()} == {tuple(v) for v in part.polyhedron.vertices.tolist()}
    assert own.polyhedron.volume == pytest.approx(part.polyhedron.volume, rel=1e-12)
    for _ in range(5):
        body, pieces = shuffled(part.polyhedron, rng), [shuffled(piece, rng) for piece in part.pieces]
        again = in_order(replace(part, polyhedron=body, pieces=tuple(pieces[k] for k in rng.permutation(len(pieces)))))
        for one, other in zip((own.polyhedron, *own.pieces), (again.polyhedron, *again.pieces), strict=True):
            assert np.array_equal(one.vertices, other.vertices)
            assert [(f.loops, f.offset) for f in one.faces] == [(f.loops, f.offset) for f in other.faces]
            assert np.array_equal(one.normals, other.normals)
            assert one.edges == other.edges


def test_sections_have_exact_corners() -> None:
    (shape,) = section(pieces(BLOCK), at(z=0.02)).geoms
    assert shape.area == pytest.approx(0.06**2 - 0.0202**2, rel=1e-12)
    assert {abs(x) for ring in (shape.exterior, *shape.interiors) for x, _ in ring.coords} == {0.03, 0.0101}
    upright = Pose.from_vector([0.0, 0.0, 0.0, np.pi / 2, 0.0, 0.0])
    assert section(pieces(BLOCK), upright).area == pytest.approx(0.06 * 0.04 - 0.0202 * 0.03, rel=1e-12)


def test_sections_in_the_plane_of_a_face_are_regularised() -> None:
    made = pieces(BLOCK)
    assert section(made, at(z=0.04)).is_empty
    assert section(made, at(z=0.01)).area == pytest.approx(0.06**2 - 0.0202**2, rel=1e-12)
    assert section_limit(made, at(z=0.01), -1).area == pytest.approx(0.06**2, rel=1e-12)
    stacked = pieces(Union((Box((0.1, 0.1, 0.1)), Moved(Box((0.1, 0.1, 0.1)), at(z=0.1)))))
    assert section(stacked, at(z=0.1)).area == pytest.approx(0.01, rel=1e-12)


def test_section_area_integrates_to_the_volume() -> None:
    made = pieces(CHAMFERED)
    heights = (np.arange(400) + 0.5) * 0.04 / 400
    areas = [section(made, at(z=float(z))).area for z in heights]
    assert np.mean(areas) * 0.04 == pytest.approx(polyhedron(CHAMFERED).volume, rel=1e-6)


@pytest.mark.parametrize("solid", [BLOCK, CHAMFERED])
@pytest.mark.parametrize("dx", [0.0, 0.00004])
def test_measured_clearance_of_a_square_peg(solid: Solid, dx: float) -> None:
    tip = frustum((0.018, 0.018), (0.02, 0.02), 0.005)
    moved = Moved(Union((Moved(Box((0.02, 0.02, 0.045)), at(z=0.005)), tip)), at(x=dx))
    moving, fixed = peg(moved), block(solid)
    measured = checked_clearance(moving, fixed, SEATED, 0.03)
    assert measured.per_side == pytest.approx(0.0001 - dx, abs=1e-12)
    assert measured.play == pytest.approx((0.0002, 0.0002), abs=1e-12)
    assert measured.half_diagonal == pytest.approx(0.01 * np.sqrt(2.0), abs=1e-12)
    outward = moving.polyhedron.normals[measured.moving_face]
    assert np.array_equal(outward, -fixed.polyhedron.normals[measured.fixed_face])
    assert np.max(np.abs(measured.where[:2])) == pytest.approx(0.01005 + 0.5 * dx, abs=1e-9)
    assert interference(moving, fixed, SEATED).depth == 0.0


def test_clearance_differs_by_direction_and_can_be_open() -> None:
    slot = Difference(Box((0.06, 0.06, 0.04)), (Moved(Box((0.021, 0.08, 0.03)), at(z=0.01)),))
    measured = mating_clearance(peg(), block(slot), 0.03)
    assert measured.per_side == pytest.approx(0.0005, abs=1e-12)
    assert measured.play == pytest.approx((0.001, np.inf))
    oblong = mating_clearance(peg(chamfered_box((0.02, 0.0196, 0.05), 0.001)), block(), 0.03)
    assert oblong.play == pytest.approx((0.0002, 0.0006), abs=1e-12)


def test_clearance_looks_at_the_whole_way_in() -> None:
    neck = Difference(
        Box((0.06, 0.06, 0.04)),
        (Moved(Box((0.022, 0.022, 0.02)), at(z=0.01)), Moved(Box((0.0202, 0.0202, 0.01)), at(z=0.03))),
    )
    bulb = Union((Box((0.0201, 0.0201, 0.005)), Box((0.018, 0.018, 0.05))))
    measured = mating_clearance(peg(bulb), block(neck), 0.03)
    assert measured.per_side == pytest.approx(0.00005, abs=1e-12)
    assert interference(peg(bulb), block(neck), SEATED).depth == 0.0


def test_round_clearance_is_that_of_the_radii_but_for_the_flats() -> None:
    bore = Difference(Box((0.06, 0.06, 0.04)), (Moved(Cylinder(0.0101, 0.03, 32), at(z=0.01)),))
    measured = mating_clearance(peg(Cylinder(0.01, 0.05, 32)), block(bore), 0.03)
    assert measured.per_side == pytest.approx(0.0001 * np.cos(np.pi / 32), abs=1e-12)


@pytest.mark.parametrize(("size", "depth"), [((0.0204, 0.02), 1e-4), ((0.0204, 0.0204), 1e-4), ((0.03, 0.01), 4.9e-3)])
def test_interference_fits_are_negative_and_refused(size: tuple[float, float], depth: float) -> None:
    moving, fixed = peg(Box((*size, 0.05))), block()
    measured = mating_clearance(moving, fixed, 0.03)
    assert (measured.per_side, measured.play) == (pytest.approx(-depth, abs=1e-9), (0.0, 0.0))
    overlap = interference(moving, fixed, SEATED)
    assert overlap.depth == pytest.approx(depth, abs=1e-9)
    excess = np.prod(size) - np.prod(np.minimum(size, 0.0202))
    assert overlap.volume == pytest.approx(0.03 * excess, rel=1e-6)
    with pytest.raises(InterferenceError, match="'peg' does not go into 'block'") as caught:
        checked_clearance(moving, fixed, SEATED, 0.03)
    assert caught.value.interference == pytest.approx(depth, abs=1e-9)
    assert "B-frame" in caught.value.place


def test_no_clearance_and_hitting_the_floor_are_refused() -> None:
    with pytest.raises(InterferenceError, match=r"no clearance, which is 0\.000000 mm"):
        checked_clearance(peg(Box((0.0202, 0.0202, 0.05))), block(), SEATED, 0.03)
    with pytest.raises(InterferenceError, match="when seated") as caught:
        checked_clearance(peg(), block(), at(z=-0.0301), 0.03)
    assert caught.value.interference == pytest.approx(1e-4, abs=1e-9)
    with pytest.raises(GeometryError, match="no material between"):
        mating_clearance(rebased(peg(), at(z=0.06)), block(), 0.01)


def test_interference_of_tilted_bodies_needs_edge_directions() -> None:
    tilt = Pose.from_vector([0.0, 0.0, 0.0, 0.0, np.pi / 4, 0.0])
    one = part_of("one", Moved(Box((1.0, 1.0, 1.0)), tilt))
    two = rebased(one, Pose.from_vector([0.0, 0.0, 0.0, 0.0, 0.0, np.pi / 2]))
    top = one.polyhedron.vertices[:, 2].max() - two.polyhedron.vertices[:, 2].min()
    assert interference(one, two, at(z=-top + 0.001)).depth == pytest.approx(0.001, abs=1e-9)
    assert interference(one, two, at(z=-top - 0.001)).depth == 0.0


HEXAGON = tuple((0.02 * np.cos(a), 0.02 * np.sin(a)) for a in np.arange(6) * np.pi / 3 + np.pi / 6)
HEX_BOX = Difference(Box((0.06, 0.06, 0.05)), (Moved(Prism(HEXAGON, 0.04), at(z=0.01)),))


@pytest.mark.parametrize(("suffix", "write"), [("stl", stl_text), ("obj", obj_text)])
def test_mesh_comes_back_as_the_solid_it_was(tmp_path: Path, suffix: str, write: Callable[..., str]) -> None:
    body = polyhedron(HEX_BOX)
    path = tmp_path / f"box.{suffix}"
    path.write_text(write(np.round(1e3 * body.vertices, 4), triangulated(body)))
    mesh = load_mesh(path, "mm")
    loaded = mesh.body
    assert (mesh.mended, mesh.notes, mesh.chord_error) == ((), (), 0.0)
    assert (len(loaded.vertices), len(loaded.faces), len(loaded.edges)) == (20, 13, 30)
    assert set(loaded.vertices[:, 2].tolist()) == {0.0, 0.01, 0.05}
    assert loaded.volume == pytest.approx(body.volume, rel=1e-5)
    assert [edge.convex for edge in loaded.edges].count(False) == 12
    part = mesh_part("box", mesh, chord_error=1e-6)
    assert (len(part.pieces), part.chord_error) == (7, 1e-6)
    assert part.polyhedron.volume == pytest.approx(loaded.volume, rel=1e-6)
    assert len(part.polyhedron.faces) == 13


ISLAND = Union((HEX_BOX, Moved(Wedge((0.01, 0.01, 0.01), 0.004), at(z=0.005))))
FLANGED = Union((Box((0.02, 0.02, 0.05)), Moved(Box((0.04, 0.03, 0.01)), at(z=0.03))))
CROSSED = Difference(ISLAND, (Moved(Box((0.02, 0.08, 0.02)), at(z=0.04)),))


@pytest.mark.parametrize(("solid", "tools"), [(CHAMFERED, 2), (ISLAND, None), (FLANGED, None), (CROSSED, None)])
def test_hull_minus_cut_excess_is_the_solid(solid: Solid, tools: int | None) -> None:
    body = polyhedron(solid)
    made = apart(body, 1e-7)[0]
    again = polyhedron(made)
    assert again.volume == pytest.approx(body.volume, rel=1e-9)
    assert (len(again.vertices), len(again.faces)) == (len(body.vertices), len(body.faces))
    assert isinstance(made, Difference)
    assert tools in (None, len(made.tools))


def test_a_mesh_that_faces_inward_is_turned(tmp_path: Path) -> None:
    body, path = polyhedron(HEX_BOX), tmp_path / "part.stl"
    path.write_text(stl_text(1e3 * body.vertices, triangulated(body)[:, ::-1]))
    assert load_mesh(path, "mm").notes == ("all triangles faced inward and were turned",)


def test_a_cut_that_rounding_leaves_no_loop_for_ends() -> None:
    assert _chain({4: 5, 5: 6, 6: 4}) == [4, 5, 6]
    assert _chain({4: 5, 5: 6, 6: 5}) is None
    assert _chain({4: 5, 5: 6}) is None
    assert _chain({}) is None
