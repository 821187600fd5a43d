"""What held contacts imply: lines and faces on walls, flushes, alignment, and sides that points stay on."""

from dataclasses import replace

import pytest

from fmopt.verify.arithmetic.rational import fixed, vector
from fmopt.verify.parts.assembly import PartPair, Touch
from fmopt.verify.parts.solids import Plane
from tests.shared.parts.held import (
    LEFT,
    MM,
    PEG,
    RIM_LEFT,
    T0,
    T1,
    T3,
    T3_LEFT,
    TOP,
    V0,
    V0_LEFT,
    V1,
    V2,
    V3,
    V3_LEFT,
    A,
    corner,
    edge_on,
    facts,
    point,
    same,
    vertex_on,
)

FRONT = Plane(vector((0.0, 1.0, 0.0)), fixed(-10 * MM))
FLOOR = Plane(vector((0.0, 0.0, 1.0)), fixed(-30 * MM))


RIM_FRONT = (point(-10, -10, 0), point(10, -10, 0))


def test_one_point_says_nothing_more(assembly: PartPair) -> None:
    known = facts(assembly, V0_LEFT)
    assert known.on(LEFT).lines(assembly) == ()
    assert not known.implies(V3_LEFT)
    assert known.not_below(LEFT, PEG.vertices, []) == {V0}
    assert known.not_below(FRONT, PEG.vertices, []) == set()


def test_an_end_and_a_crossing_put_the_edge_on_the_wall(assembly: PartPair) -> None:
    known = facts(assembly, V0_LEFT, A)
    assert known.not_below(LEFT, PEG.vertices, []) == {V0, T0}
    assert known.implies(vertex_on(T0, LEFT))
    assert not known.implies(V3_LEFT)
    # The crossing is also somewhere on the top plane, which says nothing of the edge's ends.
    assert (known.not_below(TOP, PEG.vertices, []), known.turns) == (set(), [])


def test_an_edge_across_the_rim_beside_a_line_makes_a_face_flush(assembly: PartPair) -> None:
    """Where on its length it touches is open; all of it is on one side of the line, in one plane with that."""
    known = facts(assembly, V0_LEFT, A, edge_on(V3, T3, RIM_LEFT, LEFT))
    assert known.implies(V3_LEFT)
    assert known.implies(T3_LEFT)
    assert len(known.turns) == 1


def test_an_edge_through_a_line_says_nothing_more(assembly: PartPair) -> None:
    """It may touch where it crosses the line, about which the part still turns."""
    ends = point(-10, 10, 30), point(-10, -30, 0)
    through = replace(edge_on(V3, T3, RIM_LEFT, LEFT), moving=ends)
    known = facts(assembly, V0_LEFT, A, through)
    assert not known.implies(V3_LEFT)
    assert known.turns == []
    short = replace(through, moving=(ends[0], point(-10, -9, 0)))  # it ends before the line
    assert facts(assembly, V0_LEFT, A, short).implies(V3_LEFT)


def test_a_point_above_raises_its_side_of_a_hinged_face(assembly: PartPair) -> None:
    known = facts(assembly, V0_LEFT, A)
    assert known.not_below(LEFT, PEG.vertices, [PEG.vertices[V3]]) == {V0, T0, V3, T3}
    assert known.not_below(LEFT, PEG.vertices, [PEG.vertices[V2]]) == {V0, T0, V2, corner(1, 1, 1)}


def test_a_point_above_raises_the_ray_from_a_point_on_the_wall(assembly: PartPair) -> None:
    known = facts(assembly, V0_LEFT)
    assert known.not_below(LEFT, PEG.vertices, [point(-10, -10, 20)]) == {V0, T0}
    assert known.not_below(LEFT, PEG.vertices, [point(-10, -10, -20)]) == {V0}


@pytest.mark.parametrize("third", [V3_LEFT, T3_LEFT, edge_on(V0, V3, RIM_LEFT, LEFT)])
def test_three_points_make_a_flush(assembly: PartPair, third: Touch) -> None:
    known = facts(assembly, V0_LEFT, A, third)
    assert (known.not_below(LEFT, PEG.vertices, []), len(known.turns)) == ({V0, T0, V3, T3}, 1)
    turn = known.turns[0]
    assert turn.body == turn.world == vector((-1.0, 0.0, 0.0))
    assert turn.onto is not None
    assert all(exact[0] < 0 and exact[1:] == (0, 0) for exact in (turn.exact, turn.onto))
    assert known.implies(T3_LEFT)
    assert not known.implies(vertex_on(V1, FRONT))


def test_an_edge_that_slips_over_the_rim_gives_no_crossing(assembly: PartPair) -> None:
    known = facts(assembly, V0_LEFT, A, V3_LEFT, edge_on(V0, V3, RIM_LEFT, LEFT))
    assert known.on(TOP).between == [A.moving]


def test_an_end_that_slips_out_below_leaves_its_edge_on_the_wall(assembly: PartPair) -> None:
    below = edge_on(V0, T0, (point(-10, -10, -30), point(-10, 10, -30)), LEFT)
    known = facts(assembly, V0_LEFT, A, below)
    assert known.not_below(LEFT, PEG.vertices, []) == {V0, T0}
    assert known.on(TOP).between == []  # either crossing may be the one that is left
    assert facts(assembly, A, below).on(LEFT).points == []


def test_a_flush_carries_heights_along_its_normal(assembly: PartPair) -> None:
    flush = (V0_LEFT, A, V3_LEFT)
    known = facts(assembly, *flush, vertex_on(V0, FRONT))
    assert known.implies(vertex_on(V1, FRONT))  # v1 − v0 runs along the aligned normal
    assert not known.implies(vertex_on(T0, FRONT))
    both = facts(assembly, *flush, vertex_on(V0, FRONT), edge_on(V0, T0, RIM_FRONT, FRONT))
    assert (both.not_below(FRONT, PEG.vertices, []), len(both.turns)) == ({V0, T0, V1, T1}, 2)
    assert all(not both.implies(vertex_on(k, FLOOR)) for k in (V0, V1, V2, V3))


def test_two_flushes_fix_the_rotation(assembly: PartPair) -> None:
    held = (V0_LEFT, A, V3_LEFT, vertex_on(V0, FRONT), edge_on(V0, T0, RIM_FRONT, FRONT), vertex_on(V0, FLOOR))
    known = facts(assembly, *held)
    assert all(known.implies(vertex_on(k, FLOOR)) for k in (V0, V1, V2, V3))
    assert not known.implies(vertex_on(T0, FLOOR))
    image = known.image(vector((0.3, -0.2, 0.7)))
    assert image is not None
    assert same(image, vector((0.3, -0.2, 0.7)))


def test_parallel_edges_against_one_rim_come_together(assembly: PartPair) -> None:
    first, second = edge_on(V0, T0, RIM_FRONT, FRONT), edge_on(V1, T1, RIM_FRONT, FRONT)
    assert not facts(assembly, first).implies(second)
    assert facts(assembly, V0_LEFT, A, V3_LEFT, first).implies(second)


@pytest.mark.parametrize("off", [2e-9, 5e-10, 1e-10, 1e-13])
def test_planes_that_differ_at_all_are_two(assembly: PartPair, off: float) -> None:
    beside = Plane(LEFT.normal, LEFT.offset + fixed(off))
    assert facts(assembly, V0_LEFT).not_below(beside, PEG.vertices, []) == set()
    assert not assembly.agree(LEFT, beside)
    assert assembly.agree(LEFT, LEFT)
