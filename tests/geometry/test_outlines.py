"""Parts over any simple outline: convex pieces, frames that are found, and the check that reads them for itself."""

import re
from collections.abc import Iterator
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from shapely import Polygon, union_all

from fmopt.certificate.assembly import Assembly
from fmopt.contact.polytope import enumerate_faces
from fmopt.errors import GeometryError
from fmopt.geometry import csg
from fmopt.geometry.convex_pieces import pieces, polyhedron, union_manifold
from fmopt.geometry.outline_solids import stack
from fmopt.geometry.plane.convex_polygons import Convex, convex_pieces
from fmopt.papers.lee_huang.nominal_trajectory import critical_poses, insertion
from fmopt.planning import pipeline
from fmopt.planning.robustness.contact_space import Scale, contact_spaces
from fmopt.report.sections import asked
from fmopt.spatial.se3 import Pose
from fmopt.task.problem import load
from fmopt.task.sizes import measured_clearance
from tests import ROOT
from tests.shared.parts import families

SEEDS = (0, 1, 2)
U = ((0.0, 0.0), (3.0, 0.0), (3.0, 3.0), (2.0, 3.0), (2.0, 1.0), (1.0, 1.0), (1.0, 3.0), (0.0, 3.0))
SPIRAL = ((0.0, 0.0), (9.0, 0.0), (9.0, 9.0), (2.0, 9.0), (2.0, 4.0), (5.0, 4.0), (5.0, 6.0), (4.0, 6.0), (4.0, 7.0),
          (7.0, 7.0), (7.0, 2.0), (0.0, 2.0))  # fmt: skip


def drawn(family: str) -> Iterator[families.Outline]:
    for seed in SEEDS:
        made = families.pair(family, seed)
        yield from (section.outline for section in (*made.peg, *made.hole))


def turned(outline: families.Outline, angle: float) -> families.Outline:
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return tuple((x, y) for x, y in (np.array(outline) @ turn).tolist())


def is_convex(piece: Convex) -> bool:
    points = piece.corners
    around = zip(points[-1:] + points[:-1], points, points[1:] + points[:1], strict=True)
    return all((b[0] - a[0]) * (c[1] - b[1]) > (b[1] - a[1]) * (c[0] - b[0]) for a, b, c in around)


@pytest.mark.parametrize("family", families.PLAIN)
def test_convex_pieces_make_up_the_outline(family: str) -> None:
    for outline in drawn(family):
        found = convex_pieces(outline)
        assert all(map(is_convex, found))
        whole = Polygon(outline)
        apart = union_all([Polygon(piece.outline) for piece in found]).symmetric_difference(whole)
        assert apart.area < 1e-12 * whole.area


@pytest.mark.parametrize(("outline", "count"), [(U, 3), (SPIRAL, 5)])
@pytest.mark.parametrize("angle", [0.0, 0.3, 1.1])
def test_pieces_are_few_and_reach_as_far_as_they_can(outline: families.Outline, count: int, angle: float) -> None:
    found = convex_pieces(turned(outline, angle))
    assert len(found) == count
    for piece in found:
        body = Polygon(piece.outline)
        others = [Polygon(other.outline) for other in found if other is not piece]
        assert any(body.intersection(other).area > 0.1 for other in others)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_heights_above_a_line_have_the_exact_sign_however_near_they_are(scale: float) -> None:
    rng = np.random.default_rng(3)
    seen = set[int]()
    for _ in range(300):
        a, b = scale * rng.uniform(-1.0, 1.0, (2, 2))
        steps = rng.integers(-40, 41, (4, 2)) * 2.0**-55 * scale
        near = [a + share * (b - a) + step for share, step in zip(rng.uniform(-1.0, 2.0, 4), steps, strict=True)]
        one, other, *corners = ((Fraction(x), Fraction(y)) for x, y in np.array([a, b, *near]).tolist())
        middle = (one[0] + (other[0] - one[0]) / 3, one[1] + (other[1] - one[1]) / 3)  # on the line, no floats
        found = Convex((*corners, middle), (None,) * 5).heights(one, other)
        exact = [(other[0] - one[0]) * (y - one[1]) - (other[1] - one[1]) * (x - one[0]) for x, y in (*corners, middle)]
        signs = [int(np.sign(float(height))) for height in found]
        assert signs == [(height > 0) - (height < 0) for height in exact]
        seen.update(signs)
    assert seen == {-1, 0, 1}


def test_sides_of_pieces_lie_in_sides_of_the_outline() -> None:
    for family in ("L", "T", "plus", "keyed"):
        for outline in drawn(family):
            points = [(Fraction(x), Fraction(y)) for x, y in outline]
            for piece in convex_pieces(outline):
                ends = zip(piece.corners, piece.corners[1:] + piece.corners[:1], piece.sides, strict=True)
                for a, b, side in ends:
                    assert side is not None
                    p, q = points[side], points[(side + 1) % len(points)]
                    for c in (a, b):
                        assert (q[0] - p[0]) * (c[1] - p[1]) == (q[1] - p[1]) * (c[0] - p[0])


@pytest.mark.parametrize("family", ["L", "stepped", "counterbored", "tapered", "chamfered", "star"])
def test_stacks_are_the_union_of_their_pieces(family: str) -> None:
    for seed in SEEDS:
        pair = families.pair(family, seed)
        for one in (pair.peg, pair.hole):
            solid = csg.Moved(stack([(part.at, part.outline) for part in one]), Pose.from_vector([1, 2, 3, 0, 0, 0.7]))
            wanted = sum(volume(low, high) for low, high in pairwise(one))
            assert polyhedron(solid).volume == pytest.approx(wanted, rel=1e-9)
            assert union_manifold(pieces(solid)).volume() == pytest.approx(wanted, rel=1e-9)


def volume(low: families.Section, high: families.Section) -> float:
    if low.at == high.at:
        return 0.0
    middle = 0.5 * (np.array(low.outline) + np.array(high.outline))
    areas = [Polygon(outline).area for outline in (low.outline, middle, high.outline)]
    return float((high.at - low.at) * (areas[0] + 4.0 * areas[1] + areas[2]) / 6.0)


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ([(0.0, U[::-1]), (1.0, U[::-1])], "clockwise"),
        ([(0.0, U[:2]), (1.0, U[:2])], "2 usable corners"),
        ([(0.0, (*U[:3], (-1.0, 1.0), *U[4:])), (1.0, U)], "crosses or touches itself at"),
        ([(1.0, U), (0.0, U)], "follows one at"),
        ([(0.0, U), (1.0, SPIRAL)], "8 and 12 corners"),
        ([(0.0, U), (1.0, (*U[:2], (3.1, 3.2), *U[3:]))], "not parallel from corner"),
        ([(0.0, U), (0.0, U)], "no height"),
    ],
)
def test_outlines_that_bound_no_solid_are_refused(sections: list[tuple[float, families.Outline]], words: str) -> None:
    with pytest.raises(GeometryError, match=re.escape(words)):
        stack(sections)


@pytest.mark.parametrize("n", range(3, 14))
def test_contact_states_of_regular_polygons_have_six_dimensions_at_most(n: int, tmp_path: Path) -> None:
    """Corners that only rounding tells apart, of which a heptagon on its floor has many, are one."""
    problem = load(families.write_toml(families.pair(f"{n}-gon", 0), tmp_path))
    clearance = measured_clearance(problem)
    scale = Scale(clearance.per_side, clearance.half_diagonal)
    path = insertion([0.0, 0.0, 1e-3, 0.0, 0.0, 0.0], problem.goal, 0.02, scale.rho)
    critical = critical_poses(problem.moving, problem.fixed, path, 1e-3)
    spaces = contact_spaces(Assembly(problem.moving, problem.fixed), critical, scale)
    assert [space.name for space in spaces] == ["mouth", "mid-depth", "bottom"]
    for space in spaces:
        found = enumerate_faces(*space.graph.space.half_spaces).count()
        assert set(found) <= set(range(7))
        assert found[6] == 1


def test_what_only_describes_a_motion_costs_no_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = load(ROOT / "problems" / "square_peg.toml")

    def lost(*_: object) -> None:
        raise GeometryError("no way is seen")

    for name in ("nominal_motion", "_contact_states", "_error_tolerance"):
        monkeypatch.setattr(pipeline, name, lost)
    made = pipeline.synthesise(problem)
    assert made.proved
    assert made.plan.description.nominal is None
    assert made.plan.description.position_force == made.plan.description.critical_points == ()
    assert made.plan.description.diagnostics.notes == (
        "how much error it tolerates is left out: no way is seen",
        "the nominal trajectory is left out: no way is seen",
        "its way through contact states is left out: no way is seen",
    )
    assert "no way is seen" in asked(made.plan)


@pytest.mark.parametrize("family", ["L", "T", "U", "plus", "rectangle"])
def test_faces_across_an_axis_are_exactly_so_however_a_model_is_turned(family: str, tmp_path: Path) -> None:
    """A part lies flat in two walls at once only where they are as exactly square as its faces are."""
    for seed in SEEDS:
        problem = load(families.write_toml(families.pair(family, seed), tmp_path))
        for body in (problem.moving.polyhedron, *problem.moving.pieces, *problem.fixed.pieces[:2]):
            square = np.abs(body.normals).max(axis=1) > 1.0 - 1e-9
            assert np.all(np.abs(body.normals[square]).max(axis=1) == 1.0)
