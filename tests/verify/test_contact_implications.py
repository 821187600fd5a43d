"""What held contacts imply: lines and faces on walls, flushes, alignment, and sides that points stay on."""

from __future__ import annotations

import pytest

from fmopt.verify.arithmetic.rational import Vector, fixed, vector
from fmopt.verify.certificate.contact_implications import Facts
from fmopt.verify.parts.assembly import Assembly, Touch
from fmopt.verify.parts.rows import pose
from fmopt.verify.parts.solids import Plane
from tests.shared.parts.solid_bodies import box, pocket, shape

MM = 1e-3
PEG = box(-10, 10, -10, 10, 0, 40)
BLOCK = shape(*pocket())
LEFT = Plane(vector((1.0, 0.0, 0.0)), fixed(-10 * MM))  # wall of the hole at x = −10 mm
FRONT = Plane(vector((0.0, 1.0, 0.0)), fixed(-10 * MM))
TOP = Plane(vector((0.0, 0.0, 1.0)), 0)
FLOOR = Plane(vector((0.0, 0.0, 1.0)), fixed(-30 * MM))


def point(x: float, y: float, z: float) -> tuple[int, int, int]:
    return vector((x * MM, y * MM, z * MM))


def same(a: Vector, b: Vector) -> bool:
    return all(abs(x - y) <= fixed(1e-30) for x, y in zip(a, b, strict=True))


def corner(x: int, y: int, z: int) -> int:
    return next(k for k, v in enumerate(PEG.vertices) if same(v, point(10 * x, 10 * y, 40 * z)))


V0, V1, V2, V3 = (corner(*xy, 0) for xy in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
T0, T1, T3 = corner(-1, -1, 1), corner(1, -1, 1), corner(-1, 1, 1)
RIM_LEFT = (point(-10, -10, 0), point(-10, 10, 0))
RIM_FRONT = (point(-10, -10, 0), point(10, -10, 0))


@pytest.fixture
def assembly() -> Assembly:
    made = Assembly.__new__(Assembly)
    made.moving, made.fixed = PEG, BLOCK
    made.moving_pieces, made.fixed_pieces = (PEG,), ()
    made.body_points = PEG.vertices
    made.touches = {}
    made.flaws = []
    return made


def vertex_on(k: int, wall: Plane) -> Touch:
    return Touch(f"v{k} on {wall}", "vertex-face", (PEG.vertices[k],), (), wall, (wall,), 0, ((k,), ()))


def edge_on(i: int, j: int, rim: tuple[tuple[int, int, int], ...], wall: Plane) -> Touch:
    moving = (PEG.vertices[i], PEG.vertices[j])
    return Touch(f"e{i}-{j} on {rim}", "edge-edge", moving, rim, None, (wall, TOP), -1, ((i, j), (sum(map(sum, rim)),)))


def facts(assembly: Assembly, *held: Touch) -> Facts:
    return Facts(assembly, held, pose((0.0,) * 6).R)


A = edge_on(V0, T0, RIM_LEFT, LEFT)
V0_LEFT, V3_LEFT, T3_LEFT = vertex_on(V0, LEFT), vertex_on(V3, LEFT), vertex_on(T3, LEFT)


def test_one_point_says_nothing_more(assembly: Assembly) -> None:
    known = facts(assembly, V0_LEFT)
    assert known.on(LEFT).lines(assembly) == ()
    assert not known.implies(V3_LEFT)
    assert known.not_below(LEFT, PEG.vertices, []) == {V0}
    assert known.not_below(FRONT, PEG.vertices, []) == set()


def test_an_end_and_a_crossing_put_the_edge_on_the_wall(assembly: Assembly) -> None:
    known = facts(assembly, V0_LEFT, A)
    assert known.not_below(LEFT, PEG.vertices, []) == {V0, T0}
    assert known.implies(vertex_on(T0, LEFT))
    assert not known.implies(V3_LEFT)
    # The crossing is also somewhere on the top plane, which says nothing of the edge's ends.
    assert known.not_below(TOP, PEG.vertices, []) == set()
    assert known.turns == []


def test_a_point_above_raises_its_side_of_a_hinged_face(assembly: Assembly) -> None:
    known = facts(assembly, V0_LEFT, A)
    assert known.not_below(LEFT, PEG.vertices, [PEG.vertices[V3]]) == {V0, T0, V3, T3}
    assert known.not_below(LEFT, PEG.vertices, [PEG.vertices[V2]]) == {V0, T0, V2, corner(1, 1, 1)}


def test_a_point_above_raises_the_ray_from_a_point_on_the_wall(assembly: Assembly) -> None:
    known = facts(assembly, V0_LEFT)
    assert known.not_below(LEFT, PEG.vertices, [point(-10, -10, 20)]) == {V0, T0}
    assert known.not_below(LEFT, PEG.vertices, [point(-10, -10, -20)]) == {V0}


@pytest.mark.parametrize("third", [V3_LEFT, T3_LEFT, edge_on(V0, V3, RIM_LEFT, LEFT)])
def test_three_points_make_a_flush(assembly: Assembly, third: Touch) -> None:
    known = facts(assembly, V0_LEFT, A, third)
    assert known.not_below(LEFT, PEG.vertices, []) == {V0, T0, V3, T3}
    assert len(known.turns) == 1
    turn = known.turns[0]
    assert turn.body == turn.world == vector((-1.0, 0.0, 0.0))
    assert turn.onto is not None
    assert all(exact[0] < 0 and exact[1:] == (0, 0) for exact in (turn.exact, turn.onto))
    assert known.implies(T3_LEFT)
    assert not known.implies(vertex_on(V1, FRONT))


def test_an_edge_that_slips_over_the_rim_gives_no_crossing(assembly: Assembly) -> None:
    bottom = edge_on(V0, V3, RIM_LEFT, LEFT)
    known = facts(assembly, V0_LEFT, A, V3_LEFT, bottom)
    assert known.on(TOP).between == [A.moving]


def test_an_end_that_slips_out_below_leaves_its_edge_on_the_wall(assembly: Assembly) -> None:
    below = edge_on(V0, T0, (point(-10, -10, -30), point(-10, 10, -30)), LEFT)
    known = facts(assembly, V0_LEFT, A, below)
    assert known.not_below(LEFT, PEG.vertices, []) == {V0, T0}
    assert known.on(TOP).between == []  # either crossing may be the one that is left
    assert facts(assembly, A, below).on(LEFT).points == []


def test_a_flush_carries_heights_along_its_normal(assembly: Assembly) -> None:
    flush = (V0_LEFT, A, V3_LEFT)
    known = facts(assembly, *flush, vertex_on(V0, FRONT))
    assert known.implies(vertex_on(V1, FRONT))  # v1 − v0 runs along the aligned normal
    assert not known.implies(vertex_on(T0, FRONT))
    both = facts(assembly, *flush, vertex_on(V0, FRONT), edge_on(V0, T0, RIM_FRONT, FRONT))
    assert both.not_below(FRONT, PEG.vertices, []) == {V0, T0, V1, T1}
    assert len(both.turns) == 2
    assert all(not both.implies(vertex_on(k, FLOOR)) for k in (V0, V1, V2, V3))


def test_two_flushes_fix_the_rotation(assembly: Assembly) -> None:
    held = (V0_LEFT, A, V3_LEFT, vertex_on(V0, FRONT), edge_on(V0, T0, RIM_FRONT, FRONT), vertex_on(V0, FLOOR))
    known = facts(assembly, *held)
    assert all(known.implies(vertex_on(k, FLOOR)) for k in (V0, V1, V2, V3))
    assert not known.implies(vertex_on(T0, FLOOR))
    image = known.image(vector((0.3, -0.2, 0.7)))
    assert image is not None
    assert same(image, vector((0.3, -0.2, 0.7)))


def test_parallel_edges_against_one_rim_come_together(assembly: Assembly) -> None:
    first, second = edge_on(V0, T0, RIM_FRONT, FRONT), edge_on(V1, T1, RIM_FRONT, FRONT)
    assert not facts(assembly, first).implies(second)
    assert facts(assembly, V0_LEFT, A, V3_LEFT, first).implies(second)


@pytest.mark.parametrize("off", [2e-9, 5e-10, 1e-10, 1e-13])
def test_planes_that_differ_at_all_are_two(assembly: Assembly, off: float) -> None:
    beside = Plane(LEFT.normal, LEFT.offset + fixed(off))
    assert facts(assembly, V0_LEFT).not_below(beside, PEG.vertices, []) == set()
    assert not assembly.agree(LEFT, beside)
    assert assembly.agree(LEFT, LEFT)
