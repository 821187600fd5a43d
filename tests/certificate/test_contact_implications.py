"""What contacts say exactly: examples worked out by hand, and poses that satisfy the contacts."""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.optimize import least_squares

from fmopt.certificate.assembly import contact_rows, hinge
from fmopt.certificate.contact_implications import aligned, facts, flushes, taken_turns
from fmopt.certificate.piece_pairs import Pair, PlaneWitness, facing
from fmopt.certificate.separating_plane import counted_rows
from fmopt.contact.primitive import PrimitiveContact
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array
from tests.shared.parts.peg_pieces import CLEAR, DEPTH, HALF, Peg, Way, moves, peg

TOLERANCE = 1e-9
LEFT = np.array([1.0, 0.0, 0.0])


def contacts(*names: str) -> tuple[PrimitiveContact, ...]:
    return tuple(peg().contacts[name] for name in names)


def settled_vertices(held: Sequence[PrimitiveContact], above: Sequence[Array] = ()) -> set[tuple[float, ...]]:
    """The corners (x, y, z) of the peg, in half-widths, that are settled against the left wall."""
    body = peg().assembly.moving.polyhedron.vertices
    points = np.array(above).reshape(-1, 3)
    done = facts(peg().assembly, tuple(held)).not_below(LEFT, -CLEAR, body, points)
    return {tuple(np.round(v / HALF, 6)) for v in body[done]}


LEADING = (-1.0, -1.0, 0.0)
UP = (-1.0, -1.0, 4.0)
OTHER = (-1.0, 1.0, 0.0)
OTHER_UP = (-1.0, 1.0, 4.0)


def test_a_vertex_on_the_wall_settles_itself() -> None:
    assert settled_vertices(contacts("left corner")) == {LEADING}


def test_an_edge_across_the_rim_settles_no_vertex() -> None:
    assert settled_vertices(contacts("left edge")) == set()


def test_a_hinged_edge_lies_in_the_wall() -> None:
    assert settled_vertices(contacts("left edge", "left corner")) == {LEADING, UP}


def test_a_point_above_a_hinge_settles_its_half_plane() -> None:
    other = np.array(OTHER) * HALF
    found = settled_vertices(contacts("left edge", "left corner"), [other])
    assert found == {LEADING, UP, OTHER, OTHER_UP}
    beyond = settled_vertices(contacts("left edge", "left corner"), [-other])
    assert (1.0, -1.0, 0.0) in beyond
    assert OTHER not in beyond


def test_a_line_and_an_edge_from_it_make_a_flush_face() -> None:
    held = contacts("left edge", "left corner", "leading edge")
    assert settled_vertices(held) == {LEADING, UP, OTHER, OTHER_UP}
    ((body, world),) = flushes(peg().assembly, held)
    np.testing.assert_allclose(body, [-1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(world, [-1.0, 0.0, 0.0], atol=1e-12)


def test_one_flush_face_fixes_its_normal_two_fix_everything() -> None:
    one = flushes(peg().assembly, contacts("left edge", "left corner", "leading edge"))
    np.testing.assert_allclose(aligned(one, np.array([2.0, 0.0, 0.0])), [2.0, 0.0, 0.0], atol=1e-12)
    assert aligned(one, np.array([0.0, 1.0, 0.0])) is None
    both = flushes(peg().assembly, moves()[-1].held)
    np.testing.assert_allclose(aligned(both, np.array([0.3, -0.2, 0.7])), [0.3, -0.2, 0.7], atol=1e-12)


def test_a_flush_face_levels_heights_over_other_walls() -> None:
    """Held flush to the left wall, a peg that makes the front rim with one edge has the parallel edge there, too."""
    way = moves()[4]
    pair = next(p for _, _, p in facing(peg().assembly, way.whole).listed if p.opening)
    assert pair.beside == (way.made,)
    front = np.array([0.0, 1.0, 0.0])
    known = facts(peg().assembly, way.held)
    edge = peg().assembly.moving.polyhedron.vertices
    corner = peg().corner
    along = known.beside(edge - corner, np.array([1.0, 0.0, 0.0]))
    assert {tuple(np.round(v / HALF, 6)) for v in edge[along]} == {LEADING, (1.0, -1.0, 0.0)}
    done = known.not_below(front, -CLEAR, edge, corner[None])
    assert {tuple(np.round(v / HALF, 6)) for v in edge[done]} == {LEADING, (1.0, -1.0, 0.0)}


def test_a_hinge_needs_the_end_on_a_wall_of_the_fixed_edge() -> None:
    (edge,) = contacts("left edge")
    assert hinge(peg().assembly, edge, contacts("left corner")) is not None
    assert hinge(peg().assembly, edge, contacts("front corner")) is None
    assert hinge(peg().assembly, edge, contacts("other left corner")) is None


def test_an_edge_whose_ends_are_held_lies_in_the_wall() -> None:
    (edge,) = contacts("leading edge")
    assert taken_turns(peg().assembly, edge, contacts("left corner")) is None
    wall = taken_turns(peg().assembly, edge, contacts("left corner", "other left corner"))
    assert wall == peg().contacts["left corner"].fixed_feature


def samples(way: Way, count: int, rng: np.random.Generator) -> list[Pose]:
    """Poses near the move that satisfy its held contacts exactly, and have not crossed the one being made."""
    assembly, found = peg().assembly, []
    while len(found) < count:
        share = rng.uniform()
        nominal = way.start.moved(share * way.start.local(way.goal))
        begin = nominal.moved(rng.normal(size=6) * np.array([3e-4] * 3 + [5e-3] * 3))
        scale = np.array([1.0] * 3 + [1.0 / HALF] * 3)

        def rows(x: Array, begin: Pose = begin, scale: Array = scale) -> Array:
            return contact_rows(assembly, way.held, way.held, begin.moved(x * scale)).f

        def slopes(x: Array, begin: Pose = begin, scale: Array = scale) -> Array:
            return contact_rows(assembly, way.held, way.held, begin.moved(x * scale)).N * scale

        X = begin
        if way.held:
            for _ in range(4):
                solution = least_squares(rows, np.zeros(6), jac=slopes, xtol=1e-15, ftol=1e-15, gtol=1e-15)
                X = begin.moved(solution.x * scale)
                begin = X
                if np.abs(rows(np.zeros(6), begin)).max() < 1e-13:
                    break
            else:
                continue
        if way.made is None or contact_rows(assembly, [way.made], way.held, X).f[0] >= 0.0:
            found.append(X)
    return found


def excused(pair: Pair) -> list[tuple[Array, float, Array]]:
    """For each fixed face of a pair: its plane, and the moving vertices that need no row of their own."""
    found = []
    for face in pair.fixed.faces:
        rows = counted_rows(peg().assembly, pair, PlaneWitness("fixed-face", (), face.loops[0])).forms
        kept = {tuple(lever) for lever in rows.table["k"]}
        left = [v for v in pair.moving.vertices if tuple(v) not in kept]
        offset = float((pair.fixed.vertices @ face.normal).max())
        found.append((face.normal, offset, np.array(left).reshape(-1, 3)))
    return found


@pytest.mark.parametrize("number", [2, 3, 4, 5, 6])
def test_no_excused_vertex_is_behind_its_plane(number: int) -> None:
    way = moves()[number]
    touched = [p for _, _, p in facing(peg().assembly, way.whole).listed if p.touched]
    assert touched
    planes = [plane for pair in touched for plane in excused(pair)]
    if number > 2:
        assert sum(len(points) for *_, points in planes) > 0
    for X in samples(way, 8, np.random.default_rng(number)):
        for normal, offset, points in planes:
            assert (X.apply(points) @ normal - offset >= -TOLERANCE).all()


def test_vertices_left_to_rows_can_be_behind_the_plane() -> None:
    """The control: without the contact that is made, the vertices that it holds up do cross."""
    way, rng = moves()[3], np.random.default_rng(0)
    free = Way(way.start, way.goal, way.held, way.after, None, 1)
    other = np.array(OTHER) * HALF
    heights = [float(X.apply(other) @ LEFT) + CLEAR for X in samples(free, 12, rng)]
    assert min(heights) < -1e-6


def along_rim(pair: Pair, rim: Array) -> tuple[int, int]:
    """The fixed piece's edge along a rim (2, 3) of the part, run the same way."""
    u = (rim[1] - rim[0]) / np.linalg.norm(rim[1] - rim[0])
    off = np.linalg.norm(np.cross(pair.fixed.vertices - rim[0], u), axis=1)
    i, j = np.flatnonzero(off < 1e-9)
    forward = (pair.fixed.vertices[j] - pair.fixed.vertices[i]) @ u > 0.0
    return (int(i), int(j)) if forward else (int(j), int(i))


def test_edges_turned_onto_a_wall_excuse_it_only_from_inside() -> None:
    way, assembly = moves()[2], peg().assembly
    pair = next(p for _, _, p in facing(assembly, way.whole).listed if p.held)
    edge = peg().contacts["left edge"]
    own, world = assembly.moving.polyhedron.vertices, assembly.fixed.polyhedron.vertices
    a, b = (int(np.argmin(np.linalg.norm(pair.moving.vertices - own[i], axis=1))) for i in edge.moving)
    c, d = along_rim(pair, world[list(edge.fixed)])
    counted = counted_rows(assembly, pair, PlaneWitness("edges", (a, b), (c, d)))
    (onto,) = counted.onto
    inside = np.ones(len(counted.forms))
    outside = inside.copy()
    outside[onto.outside] = -1.0
    assert counted.counts(inside)[onto.inside]
    assert not counted.counts(inside)[onto.behind].any()
    assert not counted.counts(outside)[onto.inside]
    assert counted.counts(outside)[onto.behind].all()


def test_the_floor_is_reached_by_all_corners_at_once() -> None:
    known = facts(peg().assembly, moves()[-1].held)
    body = peg().assembly.moving.polyhedron.vertices
    done = known.not_below(np.array([0.0, 0.0, 1.0]), -DEPTH, body, peg().corner[None])
    assert {tuple(np.round(v / HALF, 6)) for v in body[done]} == {(x, y, 0.0) for x in (-1.0, 1.0) for y in (-1.0, 1.0)}


def test_facts_are_worked_out_once_for_each_state() -> None:
    fresh: Peg = peg()
    held = moves()[5].held
    assert facts(fresh.assembly, held) is facts(fresh.assembly, tuple(held))
