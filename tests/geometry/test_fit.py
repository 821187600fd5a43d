"""What goes where, found from two solids: small inputs with their right answers, families, and another optimiser."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
from scipy.optimize import minimize

import fmopt
from fmopt.errors import GeometryError, InterferenceError
from fmopt.geometry import csg
from fmopt.geometry.clearance import deepest
from fmopt.geometry.convex_pieces import polyhedron
from fmopt.geometry.fit.find import Stated, find
from fmopt.geometry.mesh.mesh_import import load_mesh
from fmopt.geometry.outline_solids import stack
from fmopt.geometry.polyhedron import Polyhedron, placed
from fmopt.spatial.se3 import Pose, exp
from tests.shared.files.mesh_files import at
from tests.shared.parts import families
from tests.shared.parts.forms import read

CASES = Path(__file__).parents[1] / "shared" / "parts" / "cases"
DOWN = (0.0, 0.0, -1.0)


def box(*size: float, **where: float) -> csg.Solid:
    return csg.Moved(csg.Box((size[0] * 1e-3, size[1] * 1e-3, size[2] * 1e-3)), at(**where))


def less(solid: csg.Solid, *tools: csg.Solid) -> Polyhedron:
    return polyhedron(csg.Difference(solid, tools))


def rigid(rng: np.random.Generator) -> Pose:
    return Pose(rng.uniform(-0.05, 0.05, 3), exp(rng.normal(size=3)))


@pytest.mark.parametrize(
    ("moving", "fixed", "clearance", "depth", "lead"),
    [
        ("touching_plate_and_boss.obj", "touching_hole.stl", 0.2, 20.0, DOWN),
        ("touching_four_boxes_peg.stl", "touching_four_boxes.obj", 0.2, 20.0, None),
        ("spike_peg.stl", "spike_cage.stl", 0.125, 48.35, None),
        ("key_lying.stl", "key_pocket.stl", 0.1, 5.0, None),
        ("k_arrow.stl", "k_arrow_hole.stl", 0.26715, 20.0, None),
        ("pointed_pin.stl", "pointed_hole.stl", 0.2, 15.0, DOWN),
        ("two_prong_plug.stl", "two_prong_socket.stl", 0.5, 16.0, (1.0, 0.0, 0.0)),
        ("open_slot_tongue.stl", "open_slot.stl", 0.2, 15.0, None),
        ("collar.stl", "collar_recess.stl", 0.2, 7.0, None),
        ("lid_with_rim.stl", "lid_box.stl", 0.15, 5.0, DOWN),
        ("pin_13.00_48gon.stl", "bore_13.01_64gon.stl", -0.00196, 15.0, None),
        ("u_peg.stl", "u_hole.stl", -0.4, 20.0, None),
        ("relief_key.stl", "relief_none.stl", 0.1, 12.0, None),
        ("relief_key.stl", "relief_0.2mm.stl", 0.1, 12.0, None),
        ("plate_peg.stl", "plate_with_screw_holes.stl", 0.1, 12.0, None),
        ("limit_cell.stl", "limit_tube.stl", 0.29891, 52.0, None),
    ],
)
def test_small_inputs_have_their_right_answers(
    moving: str, fixed: str, clearance: float, depth: float, lead: tuple[float, float, float] | None
) -> None:
    found = find(*(load_mesh(CASES / name, "mm").body for name in (moving, fixed)))
    assert 1e3 * found.clearance == pytest.approx(clearance, abs=1e-4)
    assert 1e3 * found.depth == pytest.approx(depth, abs=1e-3)
    assert lead is None or -found.solid.R[:, 2] == pytest.approx(lead, abs=1e-6)
    assert not found.exchanged


def test_what_cannot_be_told_at_facets_says_how_many_would_tell() -> None:
    pair = [CASES / name for name in ("pin_13.00_48gon.stl", "bore_13.01_64gon.stl")]
    with pytest.raises(GeometryError, match=r"cannot be told at these facets: they overlap by 0\.00196 mm") as told:
        _ = fmopt.problem(*pair, "0.3 mm, 0.3 deg", unit="mm").measured
    assert told.value.exit_code == 2
    assert told.value.advice == "give about 197 facets around, or a STEP file"
    with pytest.raises(InterferenceError, match=r"too thick by 0\.400000 mm a side"):
        _ = fmopt.problem(CASES / "u_peg.stl", CASES / "u_hole.stl", "0.3 mm, 0.3 deg", unit="mm").measured


def test_bodies_of_one_file_stand_as_the_goal_has_them(tmp_path: Path) -> None:
    for name, moving, fixed, clearance in (
        ("two_objects_in_one.obj", "peg", "hole", 0.15),
        ("assembly_five_bodies.step", "dowel_1", "plate", 0.0999),
    ):
        both = f'moving = {{ model = "{name}", body = "{moving}" }}\nfixed = {{ model = "{name}", body = "{fixed}" }}\n'
        (tmp_path / name).write_bytes((CASES / name).read_bytes())
        (tmp_path / "problem.toml").write_text(f'{both}[uncertainty]\nstart = "0.3 mm, 0.3 deg"\n')
        problem = fmopt.load(tmp_path / "problem.toml")
        assert 1e3 * problem.measured.per_side == pytest.approx(clearance, abs=2e-3)


def test_screw_holes_that_nothing_reaches_add_nothing_to_the_errors() -> None:
    problem = fmopt.problem(CASES / "plate_peg.stl", CASES / "plate_with_screw_holes.stl", "0.3 mm, 0.3 deg", unit="mm")
    assert problem.start_box[:3] == pytest.approx([3e-4] * 3, abs=1e-12)


def test_a_seat_that_no_straight_way_leads_to_is_an_undercut() -> None:
    """A head behind a narrower neck; without the neck's walls it is drawn out."""
    head = polyhedron(csg.Union((box(10, 10, 4, z=0.004), box(6, 6, 12, z=0.008))))
    snap = less(box(30, 30, 14), box(10.4, 10.4, 4.4, z=0.0038), box(6.4, 6.4, 20, z=0.007))
    with pytest.raises(GeometryError, match=r"an undercut \(thread, snap or bayonet\)"):
        find(head, snap, seated=Pose.identity())
    free = less(box(30, 30, 14), box(10.4, 10.4, 20, z=0.0038))
    assert find(head, free, seated=Pose.identity()).clearance == pytest.approx(2e-4, abs=1e-9)


def seventeen() -> tuple[Polyhedron, Polyhedron]:
    return polyhedron(box(17, 30, 20)), less(box(60, 60, 20), box(16.98, 50, 30, z=0.008))


def beside() -> tuple[Polyhedron, Polyhedron]:
    tools = box(9.98, 7.98, 30, x=-0.02, z=-0.005), box(10.2, 8.2, 30, x=0.02, z=-0.005)
    return polyhedron(box(10, 8, 40)), less(box(80, 40, 12), *tools)


def cap() -> tuple[Polyhedron, Polyhedron]:
    post = csg.Union((box(60, 60, 10), box(12, 10, 25, z=0.01)))
    return less(box(20, 20, 18), box(12.3, 10.3, 15, z=-0.003)), polyhedron(post)


def headed() -> tuple[Polyhedron, Polyhedron]:
    pin = csg.Union((box(8, 8, 30), box(14, 14, 5, z=0.03)))
    return polyhedron(pin), less(box(40, 40, 12), box(8.1, 8.1, 40, z=-0.01))


@pytest.mark.parametrize(
    ("pair", "clearance", "depth", "exchanged"),
    [(seventeen, -0.01, 12.0, False), (beside, 0.1, 12.0, False), (cap, 0.15, 12.0, True), (headed, 0.05, 30.0, False)],
)
@pytest.mark.parametrize("seed", [None, 0, 1])
def test_interference_loose_holes_caps_and_heads(
    pair: Callable[[], tuple[Polyhedron, Polyhedron]], clearance: float, depth: float, exchanged: bool, seed: int | None
) -> None:
    moving, fixed = pair()
    if seed is not None:
        rng = np.random.default_rng(seed)
        moving, fixed = placed(moving, rigid(rng)), placed(fixed, rigid(rng))
    found = find(moving, fixed)
    assert 1e3 * found.clearance == pytest.approx(clearance, abs=1e-4)
    assert 1e3 * found.depth == pytest.approx(depth, abs=1e-4)
    assert found.exchanged is exchanged


def test_what_is_stated_is_kept() -> None:
    moving, fixed = beside()
    tight = Stated("hollow", (at(-0.02, 0.0, 0.012),))
    assert find(moving, fixed, (Stated(), tight)).clearance == pytest.approx(-1e-5, abs=1e-8)
    assert find(moving, fixed, depth=0.005).depth == pytest.approx(0.005)
    with pytest.raises(GeometryError, match="nothing of the one goes into an opening of the other"):
        find(polyhedron(box(30, 30, 30)), polyhedron(box(20, 20, 20)))


@pytest.mark.parametrize("family", ["7-gon", "rectangle", "L", "U", "stepped", "tapered", "counterbored", "capped"])
def test_files_that_lie_anyhow_have_the_same_fit(family: str, tmp_path: Path) -> None:
    pair = families.pair(family, 5)
    problem = read(pair, "stl", tmp_path)
    poses = [rigid(np.random.default_rng(seed)) for seed in (5, 6)]
    found = find(placed(problem.moving.polyhedron, poses[0]), placed(problem.fixed.polyhedron, poses[1]))
    assert 1e3 * found.clearance == pytest.approx(pair.clearance, abs=1e-3)
    assert 1e3 * found.depth == pytest.approx(pair.depth, abs=1e-3)
    seated = poses[1].inverse().compose(found.pose).compose(poses[0])
    assert abs(seated.R[2, 2]) == pytest.approx(1.0)
    assert deepest([placed(piece, seated) for piece in problem.moving.pieces], problem.fixed.pieces) < 1e-7


def outline(rng: np.random.Generator, corners: int) -> np.ndarray:
    angles = (np.arange(corners) + rng.uniform(-0.25, 0.25, corners)) * math.tau / corners
    return 0.012 * rng.uniform(0.6, 1.0, corners)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])


def roomiest(peg: shapely.Polygon, material: shapely.Geometry, starts: int, rng: np.random.Generator) -> float:
    """The greatest distance of a placed outline from material, by descents without derivatives from many starts, m."""

    def shortfall(x: np.ndarray) -> float:
        put = shapely.affinity.translate(shapely.affinity.rotate(peg, 50.0 * x[2], (0, 0)), x[0] / 1e3, x[1] / 1e3)
        return 1e3 * (shapely.intersection(put, material).length - shapely.distance(put, material))

    tried = sorted((rng.normal(size=3) * (0.3, 0.3, 0.1) for _ in range(starts)), key=shortfall)[:6]
    best = min((minimize(shortfall, x, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-9}) for x in tried),
               key=lambda one: one.fun)  # fmt: skip
    for _ in range(4):
        best = minimize(shortfall, best.x, method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-10})
    return -1e-3 * float(best.fun)


@pytest.mark.parametrize("seed", range(4))
def test_the_clearance_is_that_of_an_optimiser_that_shares_no_code(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ring = outline(rng, 5 + seed)
    peg = shapely.Polygon(ring)
    hole = shapely.Polygon(np.array(peg.buffer(4e-4, join_style="mitre").exterior.coords)[:-1])
    mouth = tuple(map(tuple, np.array(hole.exterior.coords)[:-1][::-1].tolist()))
    bar = polyhedron(stack([(0.0, tuple(map(tuple, ring.tolist()))), (0.04, tuple(map(tuple, ring.tolist())))]))
    block = less(box(60, 60, 20), stack([(-0.01, mouth), (0.03, mouth)]))
    found = find(placed(bar, rigid(rng)), placed(block, rigid(rng)))
    wanted = roomiest(peg, shapely.box(-0.03, -0.03, 0.03, 0.03).difference(hole), 200, rng)
    assert found.clearance == pytest.approx(wanted, abs=1e-6)
