"""Variants of the small inputs in tests/shared/parts/cases: other shapes, sizes, places and formats of each kind.

Letters are the kinds of the table of those inputs; A is varied in test_known_solids, P in tests/planning/test_deadline.
Solids are made by manifold3d and the CAD kernel, in mm; fits, volumes and messages are known by construction.
"""

import math
from pathlib import Path

import numpy as np
import pytest
import trimesh
from manifold3d import CrossSection, Manifold, OpType

import fmopt
from fmopt.cli.asked import asked_problem
from fmopt.errors import GeometryError, InputError, InterferenceError
from fmopt.geometry.fit import search
from fmopt.geometry.fit.find import find
from fmopt.geometry.mesh.mesh_import import load_mesh
from fmopt.geometry.step.step_import import load_step
from fmopt.planning.pipeline import tried
from fmopt.spatial.se3 import exp
from tests.shared.files import step_parts
from tests.shared.files.asked import keyed, rectangle, regular
from tests.shared.files.mesh_files import ply_text, polygons_obj
from tests.shared.parts.families import Outline, widened

BAR = ((-15.0, 0.0), (-9.0, -6.0), (9.0, -6.0), (15.0, 0.0), (9.0, 6.0), (-9.0, 6.0))
DOVETAIL = ((-8.0, 0.0), (8.0, 0.0), (4.0, 8.0), (-4.0, 8.0))
HEAD = ((-8.0, 0.0), (8.0, 0.0), (8.0, 5.0), (3.0, 5.0), (3.0, 12.0), (-3.0, 12.0), (-3.0, 5.0), (-8.0, 5.0))
L = ((-9.0, -9.0), (11.0, -9.0), (11.0, -2.0), (-3.0, -2.0), (-3.0, 13.0), (-9.0, 13.0))
T = ((-3.0, -8.0), (3.0, -8.0), (3.0, 2.0), (9.0, 2.0), (9.0, 7.0), (-9.0, 7.0), (-9.0, 2.0), (-3.0, 2.0))
U = ((-10.0, 0.0), (10.0, 0.0), (10.0, 15.0), (5.0, 15.0), (5.0, 5.0), (-5.0, 5.0), (-5.0, 15.0), (-10.0, 15.0))
FOUR = ((-21.0, -21.0), (21.0, -21.0), (21.0, 21.0), (-21.0, 21.0))
DOWN, UP, ERROR = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0), "0.3 mm, 0.3 deg"


def bar(outline: Outline, low: float = 0, high: float = 40, *places: tuple[float, float], top: float = 1) -> Manifold:
    """Prisms over an outline between two heights, about some places or the origin; `top` times as wide at the top."""
    one = Manifold.extrude(CrossSection([outline]), high - low, scale_top=(top, top))
    return Manifold.batch_boolean([one.translate((x, y, low)) for x, y in places or [(0.0, 0.0)]], OpType.Add)


def hole(outline: Outline, floor: float = -1.0, *places: tuple[float, float]) -> Manifold:
    return bar(outline, floor, 99.0, *places)


def plate(thick: float, *holes: Manifold) -> Manifold:
    return Manifold.batch_boolean([bar(rectangle(60, 60), 0.0, thick), *holes], OpType.Subtract)


def rail(top: float, long: float, slot: Outline) -> Manifold:
    """A bar along z with a slot, open where the bar ends in y."""
    return bar(((-20.0, -12.0), (20.0, -12.0), (20.0, top), (-20.0, top)), 0.0, long) - hole(slot)


def relieved(outline: Outline, radius: float) -> Manifold:
    """A plate with a hole whose corners are drilled out."""
    return plate(15, hole(outline), hole(regular(8, 2.0 * radius), -1.0, *outline))


SLEEVE = bar(regular(8, 12), 0, 14) + bar(regular(6, 18), 14, 18) - hole(rectangle(6, 6))
# What goes in, as one body or several, into what, with what clearance a side, how deep, and with which end first.
FITS: dict[str, tuple[Manifold | list[Manifold], Manifold, float, float, tuple[float, float, float] | None]] = {
    "B sunk boss": ([bar(rectangle(40, 40), 25, 30), bar(regular(6, 12), 0, 27)],
                    plate(30, hole(regular(6, 12.4))), 0.2, 25, DOWN),
    "B stacked blocks": ([bar(rectangle(9, 10), z, z + 10) for z in (0, 10, 20)],
                         plate(15, hole(rectangle(9.3, 10.3))), 0.15, 15, None),
    "B U of three": ([bar(rectangle(5, 15), 0, 30, (x, 7.5)) for x in (-7.5, 7.5)]
                     + [bar(rectangle(20, 5), 0, 30, (0, 2.5))], plate(12, hole(widened(U, 0.25))), 0.25, 12, None),
    "C blind bores": (bar(regular(8, 6)), plate(20, hole(regular(8, 6.4), 8, (-20, 3), (0, 3), (9, 9))), 0.2, 12, None),
    "C two sides": (bar(rectangle(11.8, 11.8)), plate(30, hole(rectangle(10.2, 10.2), 16, (-15, 0)))
                    - hole(rectangle(12, 12), 10).rotate((0, 90, 0)).translate((0, 0, 15)), 0.1, 20, None),
    "C bosses": (bar(BAR, 12, 18) + bar(regular(6, 5), 0, 13, (-9, 0)) + bar(regular(8, 6), 8, 13, (9, 0)),
                 bar(rectangle(16, 14), 0, 20) - hole(regular(6, 5.3)), 0.15, 12, DOWN),
    "C boss beside": (bar(rectangle(70, 30), 12, 18) + bar(regular(6, 8), 0, 13, (-24, 0)),
                      bar(rectangle(20, 24), 0, 20) - hole(regular(6, 8.3)), 0.15, 12, DOWN),
    "C boss and holes": (bar(rectangle(30, 18), 10, 16) + bar(rectangle(8, 7), 0, 11, (5, -2)),
                         plate(14, hole(rectangle(8.4, 7.4), -1, (-16, 0), (0, 9), (14, -9))), 0.2, 10, DOWN),
    "F lying": (bar(BAR, 0, 8), plate(12, hole(widened(BAR, 0.1), 7)), 0.1, 5, None),
    "F pointed": (bar(regular(6, 10), 0, 33) + bar(regular(6, 10), 32, 40, top=0.1),
                  plate(20, hole(regular(6, 10.4))), 0.2, 20, UP),
    "F too thick": (bar(rectangle(25, 40), 0, 30), plate(20, hole(rectangle(24.96, 50), 5)), -0.02, 15, None),
    "F press fit beside": (bar(regular(6, 9)), plate(12, hole(regular(6, 8.98), -1, (-15, 0)),
                           hole(regular(6, 9.24), -1, (15, 0))), 0.12, 12, None),
    "G three": (bar(rectangle(50, 20), 16, 24) + bar(regular(6, 8), 0, 17, (-18, 0), (0, 3), (18, 0)),
                plate(20, hole(regular(6, 8.3), -1, (-18, 0), (0, 3), (18, 0))), 0.15, 16, DOWN),
    "G four": (bar(rectangle(50, 50), 12, 18) + bar(regular(12, 5), 0, 13, *FOUR),
               plate(20, hole(regular(12, 5.2), 6, *FOUR)), 0.1, 12, DOWN),
    "G uneven": (bar(BAR, 20, 26) + bar(rectangle(8, 8), 0, 21, (-8, 0)) + bar(rectangle(6, 6), 8, 21, (8, 0)),
                 plate(25, hole(rectangle(9, 9), -1, (-8, 0)), hole(rectangle(7, 7), -1, (8, 0))), 0.5, 20, DOWN),
    "H dovetail": (bar(DOVETAIL, 0, 50), rail(6, 40, widened(DOVETAIL, 0.2)), 0.2, 40, None),
    "H T-slot": (bar(HEAD, 0, 50), rail(9, 40, widened(HEAD, 0.15)), 0.15, 40, None),
    "H hexagon": (bar(regular(6, 12), 0, 50), rail(4, 20, regular(6, 12.3)), 0.15, 20, None),
    "I collar": (bar(regular(8, 20), 0, 6) - hole(regular(8, 10)), plate(12, hole(regular(8, 20.4), 6)), 0.2, 6, None),
    "I lid": (bar(regular(6, 40), 5, 8) + bar(regular(6, 30), 0, 6) - bar(regular(6, 26), -1, 5),
              bar(regular(6, 40), 0, 25) - hole(regular(6, 30.3), 3), 0.15, 5, DOWN),
    "I bush": (SLEEVE, plate(10, hole(regular(8, 12.2))), 0.1, 14, DOWN),
    "I one bore": (bar(rectangle(5.8, 5.8)), SLEEVE, 0.1, 18, None),
    "K L": (bar(widened(L, 0.3)), plate(15, hole(L)), -0.3, 15, None),
    "K T": (bar(widened(T, 0.2)), plate(15, hole(T)), -0.2, 15, None),
    "K key": (bar(keyed(14, 0.1)), plate(15, hole(keyed(14, 0))), -0.1, 15, None),
    "K U": (bar(widened(U, 0.4)), plate(15, hole(U)), -0.4, 15, None),
    "K thin U": (bar(widened(U, 0.75)), plate(15, hole(U, 3)), -0.75, 12, None),
    "K short block": (bar(rectangle(20.8, 8.8), 0, 12), plate(15, hole(rectangle(20, 8), 9)), -0.4, 6, DOWN),
    "L square": (bar(rectangle(10, 10)), relieved(rectangle(10.2, 10.2), 0.3), 0.1, 15, None),
    "L triangle": (bar(regular(3, 12)), relieved(regular(3, 12.3), 0.5), 0.15, 15, None),
    "L hexagon": (bar(regular(6, 12)), relieved(regular(6, 12.4), 0.4), 0.2, 15, None),
    "M through": (bar(T), plate(12, hole(widened(T, 0.1)), hole(regular(24, 5.5), -1, *FOUR)), 0.1, 12, None),
    "M of the peg": (bar(rectangle(12, 8), 0, 21) + (bar(rectangle(50, 50), 20, 26) - hole(regular(24, 4), 19, *FOUR)),
                     plate(20, hole(rectangle(12.3, 8.3), 6)), 0.15, 14, DOWN),
    "M conical": (bar(L), plate(12, hole(widened(L, 0.2)), bar(regular(24, 4), 3, 13, *FOUR, top=2)), 0.2, 12, None),
}  # fmt: skip
ALIKE = {"C blind bores": 3, "C boss and holes": 3}
ALIKE |= dict.fromkeys(("C two sides", "C boss beside", "G three", "G four", "G uneven"), 1)


def meshed(shape: Manifold) -> trimesh.Trimesh:
    mesh = shape.to_mesh64()
    return trimesh.Trimesh(mesh.vert_properties[:, :3], mesh.tri_verts)


def written(path: Path, shape: Manifold | list[Manifold], R: np.ndarray | None = None) -> Path:
    """A file of a solid, or of shells one after the other, turned."""
    whole = trimesh.util.concatenate([*map(meshed, shape if isinstance(shape, list) else [shape])])
    whole.vertices = whole.vertices @ (np.eye(3) if R is None else R).T
    whole.export(path)
    return path


@pytest.mark.parametrize("case", FITS)
def test_fits_are_those_that_were_built(case: str, tmp_path: Path) -> None:
    moving, fixed, clearance, depth, lead = FITS[case]
    number = [*FITS].index(case)
    R = exp(np.random.default_rng(number).normal(size=3))
    one, other = (("stl", "obj"), ("obj", "ply"), ("ply", "stl"))[number % 3]
    peg = load_mesh(written(tmp_path / f"moving.{one}", moving, R / 25.4), "in").body
    found = find(peg, load_mesh(written(tmp_path / f"fixed.{other}", fixed, R @ R), "mm").body)
    assert 1e3 * found.clearance == pytest.approx(clearance, abs=2e-4)
    assert 1e3 * found.depth == pytest.approx(depth, abs=1e-3)
    assert lead is None or -found.solid.R[:, 2] == pytest.approx(R @ lead, abs=1e-5)
    assert case not in ALIKE or found.alike == ALIKE[case]
    assert not found.exchanged


def asked(folder: Path, moving: Manifold | list[Manifold], fixed: Manifold) -> fmopt.Problem:
    return fmopt.problem(written(folder / "peg.stl", moving), written(folder / "hole.stl", fixed), ERROR, unit="mm")


@pytest.mark.parametrize("case", [case for case in FITS if case[0] == "M"])
def test_screw_holes_add_nothing_to_the_errors(case: str, tmp_path: Path) -> None:
    assert asked(tmp_path, *FITS[case][:2]).start_box[:3] == pytest.approx([3e-4] * 3, abs=1e-12)


def test_coarse_screw_holes_beside_a_fine_bore_add_nothing_to_the_errors(tmp_path: Path) -> None:
    def turned(sides: int, radius: float, low: float, high: float) -> Manifold:
        return Manifold.cylinder(high - low, radius, radius, sides).translate((0, 0, low))

    plate = Manifold.cube((60, 60, 12)).translate((-30, -30, 0)) - turned(96, 8.2, -1, 13)
    screwed = plate - turned(12, 2.5, -1, 13).translate((22, 22, 0))
    flanged = turned(96, 8, 0, 30) + Manifold.cube((60, 60, 5)).translate((-30, -30, 11))
    bored = flanged - turned(12, 2.5, 10, 17).translate((22, 22, 0))
    pairs = ((turned(96, 8, 0, 30), plate), (turned(96, 8, 0, 30), screwed), (flanged, plate), (bored, screwed))
    found = [asked(tmp_path, *one).start_box[0] for one in pairs]
    assert found[0] == pytest.approx(3e-4 + 16.2e-3 * (1 - math.cos(math.pi / 96)), rel=1e-3)
    assert found[1:] == pytest.approx([found[0]] * 3, abs=1e-9)


PEG, BORE = bar(rectangle(20, 20), 0, 30), hole(rectangle(20.1, 20.1))


def bores(width: float, *places: tuple[float, float]) -> Manifold:
    return hole(regular(24, width), -1.0, *places)


def test_a_pair_with_a_part_that_is_enclosed_is_tried(tmp_path: Path) -> None:
    rim = [(x, y) for t in range(-8, 9, 2) for s in (-10.05, 10.05) for x, y in ((t, s), (s, t))]
    problem = asked(tmp_path, PEG, plate(8, BORE, bores(1.0, *rim)))
    assert problem.fixed.enclosed
    assert tried(problem).per_side == pytest.approx(5e-5, abs=1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_holes_into_which_nothing_comes_are_filled(seed: int, tmp_path: Path) -> None:
    grid = [(8.0 * x, 8.0 * y) for x in range(-3, 4) for y in range(-3, 3) if max(abs(x), abs(y)) > 2]
    others = bores(3.0, *(grid[k] for k in np.random.default_rng(seed).permutation(len(grid))[:12]))
    # A rim above the top, so that the hull holds all mouths.
    plain = plate(8, BORE) + bar(rectangle(60, 3), 0, 12).translate((0, 28.5, 0))
    problem, bare = asked(tmp_path, PEG, plain - others), asked(tmp_path, PEG, plain).fixed
    assert problem.fixed.polyhedron.volume == pytest.approx(bare.polyhedron.volume, rel=1e-6)
    assert len(problem.fixed.pieces) == len(bare.pieces)
    left = len(bare.polyhedron.faces)
    assert f"{left} of {left + 288} faces are left" in problem.fixed.notes[-1]
    assert tried(problem).per_side == pytest.approx(5e-5, abs=1e-8)
    beside = bores(2.0, (12.0, 0.0))  # where the peg may come: it stays
    near = asked(tmp_path, PEG, plain - others - beside).fixed.polyhedron.volume
    assert bare.polyhedron.volume - near == pytest.approx(1e-9 * (beside ^ plain).volume(), rel=1e-4)


@pytest.mark.parametrize("seed", range(4))
def test_equal_openings_are_found_from_one_of_them(seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    r = np.random.default_rng(seed)
    outline = regular(int(r.integers(3, 9)), float(r.uniform(4.0, 6.0)))
    places = [(11.0 * x, 11.0 * y) for x in range(-2, 2) for y in range(-1, 2)]
    shapes = bar(outline), plate(9, hole(widened(outline, 0.1), -1.0, *places[1:]), hole(widened(outline, 0.5)))
    bodies = [load_mesh(written(tmp_path / f"{k}.stl", shape), "mm").body for k, shape in enumerate(shapes)]
    found = find(*bodies)
    monkeypatch.setattr(search, "_equal", lambda one, other: False)
    each = find(*bodies)
    assert (found.alike, found.clearance) == (each.alike, pytest.approx(each.clearance, abs=1e-8))
    assert found.alike == 10
    np.testing.assert_allclose(found.pose.vector()[2:], each.pose.vector()[2:], atol=1e-6)  # which of them is open
    assert min(math.dist(1e3 * found.pose.p[:2], place) for place in places[1:]) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("case", [case for case in FITS if case[0] == "K"])
def test_interference_is_refused_with_the_least_there_is(case: str, tmp_path: Path) -> None:
    with pytest.raises(InterferenceError, match="it is too thick by") as told:
        _ = asked(tmp_path, *FITS[case][:2]).measured
    assert (told.value.exit_code, 1e3 * told.value.interference) == (1, pytest.approx(-FITS[case][2], abs=1e-5))


@pytest.mark.parametrize("outline", [T, HEAD, DOVETAIL])
def test_where_nothing_goes_in_the_nearest_is_too_thick_by_a_length(outline: Outline, tmp_path: Path) -> None:
    shapes = bar(widened(outline, 2.4)), plate(15, hole(outline, 3))
    bodies = [load_mesh(written(tmp_path / f"{k}.stl", shape), "mm").body for k, shape in enumerate(shapes)]
    with pytest.raises(GeometryError, match=r"the nearest is too thick by 0\.\d+ mm a side"):
        find(*bodies)


@pytest.mark.parametrize(("n", "r", "m", "R"), [(24, 8.0, 36, 8.02), (40, 5.0, 32, 5.01), (30, 10.0, 20, 10.1)])
def test_facets_that_overlap_where_parts_fit_cannot_tell(n: int, r: float, m: int, R: float, tmp_path: Path) -> None:
    """J: at the best turn a corner of the peg is π / lcm(n, m) off the middle of a side of the hole."""
    peg, opening = (regular(k, 2.0 * radius * math.cos(math.pi / k)) for k, radius in ((n, r), (m, R)))
    with pytest.raises(GeometryError, match="cannot be told at these facets: they overlap by") as told:
        _ = asked(tmp_path, bar(peg), plate(15, hole(opening))).measured
    overlap = (r - R * math.cos(math.pi / m) / math.cos(math.pi / math.lcm(n, m))) * math.cos(math.pi / n)
    assert float(told.value.message.split("overlap by ")[1].split()[0]) == pytest.approx(overlap, rel=1e-3)
    assert told.value.exit_code == 2
    enough = int(told.value.advice.split()[2])  # so many tell at any turn, and a quarter of them does not
    assert R * math.cos(math.pi / enough) > r > R * math.cos(4.0 * math.pi / enough)


@pytest.mark.parametrize(("share", "across"), [(0.3, False), (0.5, True), (1.0, False)])
def test_needle_triangles_change_nothing(share: float, across: bool, tmp_path: Path) -> None:
    """D: triangles are cut at points 1e-8 mm off an edge or a corner, on one side or on both."""
    rng, bodies = np.random.default_rng(1), []
    peg, seat = bar(regular(6, 12)), plate(12, hole(regular(6, 12.4)))
    for kind, write, shape in (("ply", ply_text, peg), ("obj", polygons_obj, seat)):
        mesh = meshed(shape)
        points, triangles = [*(mesh.vertices @ exp(rng.normal(size=3)).T)], mesh.faces.tolist()
        for _ in range(8):
            a, b, c = triangles.pop(int(rng.integers(len(triangles))))
            m, n = len(points), len(points) + 1
            points += [share * points[a] + (1 - share) * points[b] + rng.uniform(-1e-8, 1e-8, 3) for _ in range(2)]
            triangles += [[b, c, m], [c, a, m]] if across else [[b, c, m], [c, a, m], [a, b, m]]
            if across:
                number = next(k for k, t in enumerate(triangles) if (b, a) in zip(t, [*t[1:], t[0]], strict=True))
                (d,) = {*triangles.pop(number)} - {a, b}
                triangles += [[b, n, d], [n, a, d], [a, n, m], [n, b, m]]
        path = tmp_path / f"part.{kind}"
        path.write_text(write(np.array(points), triangles))
        bodies.append(load_mesh(path, "mm").body)
    assert [len(body.faces) for body in bodies] == [8, 12]
    found = find(*bodies)
    assert (1e3 * found.clearance, 1e3 * found.depth) == (pytest.approx(0.2, abs=1e-4), pytest.approx(12.0, abs=1e-3))


BODIES = {  # a pin 6 mm deep in a plate, or on the floor of a seat, and two bodies that lie beside
    "nut": bar(regular(6, 14), 0, 6, (50, 0)) - hole(regular(8, 8), -1, (50, 0)),
    "plate": plate(10, hole(regular(6, 8))),
    "seat": plate(10, hole(regular(6, 8), 4)),
    "pin": bar(regular(6, 7.8), 4, 34),
    "ring": bar(regular(8, 16), 0, 2, (0, 50)) - hole(regular(8, 9), -1, (0, 50)),
}


@pytest.mark.parametrize(
    ("form", "names", "moving", "fixed"),
    [
        ("obj", "nut plate pin ring", "pin", "plate"),
        ("glb", "nut pin plate", "pin", "plate"),
        ("stl", "nut plate pin ring", "3", "2"),
        ("obj", "seat pin", None, None),
        ("obj", "seat pin", "pin", None),
        ("glb", "pin seat", None, None),
    ],
)
def test_bodies_of_one_file_are_named_or_the_two_that_there_are(
    form: str, names: str, moving: str | None, fixed: str | None, tmp_path: Path
) -> None:
    """B, E: in other formats and orders, by name and by number."""
    meshes = {name: meshed(BODIES[name]).apply_scale(1e-3 if form == "glb" else 1.0) for name in names.split()}
    scene = trimesh.util.concatenate([*meshes.values()]) if form == "stl" else trimesh.Scene(meshes)
    scene.export(tmp_path / f"all.{form}")
    question = asked_problem([tmp_path / f"all.{form}"], (ERROR, None if form == "glb" else "mm", moving, fixed))
    (tmp_path / "problem.toml").write_text(question.text(tmp_path))
    problem = fmopt.load(tmp_path / "problem.toml")
    assert 1e3 * problem.measured.per_side == pytest.approx(0.1, abs=1e-5)
    assert 1e3 * problem.goal[2] == pytest.approx(-6.0, abs=1e-5)


@pytest.mark.parametrize(("r", "c", "floor", "rims"), [(6, 1.0, -5, {20}), (4, 0.5, 8, {20}), (7, 1.5, -5, {0, 20})])
def test_a_chamfered_bore_is_one_solid(r: float, c: float, floor: float, rims: set[float], tmp_path: Path) -> None:
    """N: through, blind, and with a chamfer at both ends of the bore."""
    bored = step_parts.cut(step_parts.box(40.0, 40.0, 20.0), step_parts.cylinder(r, 40.0, (0.0, 0.0, floor)))
    shape = step_parts.eased(bored, c, lambda a, b: math.hypot(*a[:2]) < r + 1e-6 and round(a[2], 6) in rims)
    read = []
    for unit in ("mm", "inch"):
        step_parts.write(tmp_path / f"{unit}.step", shape, unit)
        read.append(load_step(tmp_path / f"{unit}.step"))
    cut = r * r * (20.0 - max(floor, 0.0)) + len(rims) * c * c * (r + c / 3.0)  # of bore and chamfers, mm³ / π
    facets = 1e9 * read[0].body.volume - (32000.0 - math.pi * cut)
    assert 0.0 < facets < math.tau * (r + c) * 20.0 * 1e3 * read[0].chord_error
    assert read[1].body.volume == pytest.approx(read[0].body.volume, rel=1e-9)
    assert len(read[1].body.faces) == len(read[0].body.faces)


@pytest.mark.parametrize("name", ["part.scad", "part.xml", "PART.DXF", "part.unknown"])
def test_a_format_that_is_not_read_is_named_as_such(name: str, tmp_path: Path) -> None:
    """O: on the command line, beside another part and alone, and from Python."""
    other = written(tmp_path / "other.stl", plate(10))
    (tmp_path / name).write_text("cube(1);\n")
    options = ERROR, "mm", None, None
    for ask in (
        lambda *two: asked_problem(two, options),
        lambda one, _: asked_problem([one], options),
        lambda *two: fmopt.problem(*two, ERROR),
    ):
        with pytest.raises(InputError, match=rf"{name} is of a kind that is not read; export the part as STEP or STL"):
            ask(tmp_path / name, other)
