"""Operand 1 starts turned: GE over the orientations of its way, and ways on which it turns in one place."""

from dataclasses import replace

import numpy as np
import pytest

from fmopt.errors import GeometryError
from fmopt.geometry.clearance import penetration
from fmopt.geometry.convex_pieces import pieces
from fmopt.geometry.csg import Box, Solid, Union
from fmopt.geometry.plane.region import polygon_region
from fmopt.geometry.polyhedron import placed
from fmopt.papers.lee_huang.mapping import Mapping, MappingTask, diagrams, task_mapping
from fmopt.papers.lee_huang.shrink_expand import expanded, expanded_over, section_at
from fmopt.papers.lee_huang.uncertainty_zone import PLANES
from fmopt.report.views import diagram_view
from fmopt.spatial.values import Array
from tests.shared.parts.figure2 import BOX, GOAL, RHO, SPEED, at, block

FREE, ROUND = (0,) * 6, (2, 2, 0, 2, 2, 0)
LYING = np.array([0.0, np.pi / 2, 0.0])  # its length along +x
WALL = polygon_region([(0.02, -0.03), (0.05, -0.03), (0.05, 0.03), (0.02, 0.03)])
BAR = Box((0.02, 0.014, 0.05))
PEG, BORE = Box((0.02, 0.02, 0.05)), Box((0.0204, 0.0204, 0.06))


def start(x: float, z: float, turn: Array) -> Array:
    return np.array([x, 0.0, z, *turn])


def mapped(fixed: Solid, begin: Array) -> Mapping:
    return task_mapping(MappingTask(PEG, fixed, begin, GOAL, BOX, SPEED, RHO))


@pytest.mark.parametrize("plane", PLANES[:2], ids=lambda plane: plane.name)
@pytest.mark.parametrize(("first", "last"), [((0, 0.9, 0), (0, 0.1, 0)), ((0.3, -0.2, 0.4), (0, 0, 0.4))])
def test_ge_over_a_turn_holds_ge_of_every_orientation_in_it(plane, first, last) -> None:
    """Boundary points of GE at orientations between: none stands out of the whole by more than the bound."""
    begin, end = np.array(first, dtype=float), np.array(last, dtype=float)
    whole = expanded_over(WALL, BAR, plane, begin, end)
    in_plane = not np.delete(np.vstack([begin, end]), plane.turn - 3, axis=1).any()
    room = 1e-9 if in_plane else 0.01 * 0.052
    outside = []
    for share in np.linspace(0.0, 1.0, 14):
        GE = expanded(WALL, [section_at(BAR, plane, begin + share * (end - begin))])
        points = np.vstack([curve.point(np.linspace(0.0, 1.0, 9)) for curve in GE.curves])
        stands_out = points[~whole.contains(points)]
        outside += whole.boundary_distance(stands_out).tolist() if len(stands_out) else []
    assert max(outside, default=0.0) <= room
    goal_alone = expanded(WALL, [section_at(BAR, plane, end)])
    assert whole.area > 1.001 * goal_alone.area


def test_a_face_in_the_plane_counts_with_its_body() -> None:
    """A bar that lies along the plane's normal has its end face in the plane."""
    assert section_at(BAR, PLANES[1], LYING).area == pytest.approx(0.02 * 0.014, rel=1e-9)


def never_meets(made: Mapping, fixed: Solid) -> bool:
    """Whether the peg, at 80 poses, overlaps nothing."""
    (body,), still = pieces(PEG), pieces(fixed)
    times = np.linspace(0.0, made.path.duration, 80)
    return all(penetration(placed(body, made.path.pose(t)), one) < 1e-9 for t in times.tolist() for one in still)


def turned_at(made: Mapping) -> int:
    """The node from which on the part has the goal's orientation."""
    return next(k for k, node in enumerate(made.path.nodes) if not node[3:].any())


def test_a_part_that_would_strike_a_wall_while_it_moves_and_turns_turns_first() -> None:
    fixed = Union((block(BORE, 0.04), at(Box((0.0075, 0.05, 0.02)), 0.02625, 0, 0)))
    made = mapped(fixed, start(-0.03, 0.012, LYING))
    k = turned_at(made)
    np.testing.assert_array_equal(made.path.nodes[k, :3], made.path.nodes[k - 1, :3])
    assert [one.s for one in made.freedoms] == [FREE, ROUND]
    assert never_meets(made, fixed)


def test_a_part_under_a_roof_comes_out_as_it_lies_and_turns_where_there_is_room() -> None:
    fixed = Union((block(BORE, 0.04), at(Box((0.05, 0.05, 0.004)), -0.05, 0, 0.026)))
    made = mapped(fixed, start(-0.08, 0.012, LYING))
    k = turned_at(made)
    assert k >= 2
    np.testing.assert_array_equal(made.path.nodes[:k, 3:], [LYING] * k)
    np.testing.assert_array_equal(made.path.nodes[k, :3], made.path.nodes[k - 1, :3])
    assert made.path.nodes[k, 0] > -0.025 + 0.01  # its flank is out from under the roof
    assert made.path.nodes[k, 2] > 0.01  # its half width above the block
    assert [one.s for one in made.freedoms] == [FREE, ROUND]
    assert never_meets(made, fixed)
    found = diagrams(made, 0.05)
    assert [item.turning is not None for item in found] == [True, True, False]
    without = [replace(item, turning=None) for item in found]
    assert diagram_view.drawing(found).svg() != diagram_view.drawing(without).svg()


def test_a_part_with_no_place_to_turn_is_refused() -> None:
    """Lying in a tunnel that leads past the mouth, closed at both ends."""
    cover = at(Box((0.3, 0.05, 0.004)), 0, 0, 0.026)
    ends = [at(Box((0.01, 0.05, 0.026)), x, 0, 0) for x in (-0.14, 0.14)]
    fixed = Union((block(BORE, 0.04), at(Box((0.3, 0.05, 0.004)), 0, 0, -0.044), cover, *ends))
    with pytest.raises(GeometryError, match="no place on the way leaves room"):
        mapped(fixed, start(-0.08, 0.012, LYING))


def test_a_start_that_only_the_goals_orientation_would_forbid_is_allowed() -> None:
    """Under a low roof the upright peg would not fit, the lying one does."""
    fixed = Union((block(BORE, 0.04), at(Box((0.05, 0.05, 0.004)), -0.06, 0, 0.026)))
    with pytest.raises(GeometryError, match=r"N_1, the start, .* inside GE"):
        mapped(fixed, start(-0.06, 0.012, np.zeros(3)))
    made = mapped(fixed, start(-0.06, 0.012, LYING))
    assert [one.s for one in made.freedoms] == [FREE, ROUND]
