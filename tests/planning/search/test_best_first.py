"""The search on pegs that nothing was tuned for: straight where errors fit, contacts where not, at any scale."""

import math
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.error_set import ErrorSet
from fmopt.certificate.segment_linearisation import Tolerance
from fmopt.contact.c_surface import Surfaces
from fmopt.contact.primitive import Kind, near_contacts
from fmopt.errors import SearchError
from fmopt.geometry.clearance import mating_clearance
from fmopt.geometry.csg import Box, Difference, Moved
from fmopt.geometry.part import part_of
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.planning.moves.moves import Move, Tried, fresh
from fmopt.planning.search.best_first import MoveSequence, _Frontier, begin, best_sequences, search, shortfall
from fmopt.planning.search.entry import Entry, start_spread, straight_entry, tilted_entry
from fmopt.planning.search.entry_sampling import EntryDraws, beginnings
from fmopt.planning.search.guarded_move import ContactPose, Freedom, guarded, neighbourhood
from fmopt.planning.search.successors import Costs, SearchTask
from fmopt.spatial.se3 import Pose, exp

DEGREE = math.pi / 180.0


def rectangular(clearance: tuple[float, float], scale: float = 1.0) -> Assembly:
    """A peg of 30 × 24 × 40 mm over a pocket 30 mm deep, clearances a side in mm, all times a scale."""
    mm = 1e-3 * scale
    cx, cy = clearance
    pocket = Moved(Box(((30 + 2 * cx) * mm, (24 + 2 * cy) * mm, 31 * mm)), Pose(np.array([0, 0, 10 * mm]), np.eye(3)))
    block = Difference(Box((60 * mm, 60 * mm, 40 * mm)), (pocket,))
    down = Pose(np.array([0.0, 0.0, -40 * mm]), np.eye(3))
    return Assembly(part_of("peg", Box((30 * mm, 24 * mm, 40 * mm))), part_of("block", Moved(block, down)))


def polyhedra(assembly: Assembly) -> tuple[Polyhedron, Polyhedron]:
    return assembly.moving.polyhedron, assembly.fixed.polyhedron


def asked(
    assembly: Assembly, box: list[float], velocity: float, depth: float, states: int, scale: float = 1.0
) -> tuple[SearchTask, Iterator[tuple[Entry, ...]]]:
    """What to search for, and the ways to begin, for a start box in mm and degrees."""
    half = np.array([*(1e-3 * scale * x for x in box[:3]), *(DEGREE * x for x in box[3:])])
    clearance = mating_clearance(assembly.moving, assembly.fixed, depth)
    play, moving, height = clearance.play, assembly.moving, 1e-3 * scale
    costs = replace(Costs.of(start_spread(moving, half), clearance.per_side), states=states)
    goal = Pose(np.array([0.0, 0.0, -depth]), np.eye(3))
    tolerance = Tolerance((velocity, velocity), clearance.half_diagonal)
    task = SearchTask(assembly, goal, ErrorSet.from_box(half), tolerance, costs, 15.6 * DEGREE)
    if straight := straight_entry(moving, play, half, height):
        return task, iter([straight])
    shapes = EntryDraws(moving, assembly.fixed, play, half, 2.0 * velocity, 12 * DEGREE).shapes(0)
    return task, ((entry,) for entry in beginnings(task, shapes, partial(tilted_entry, moving, play, height), 100))


def test_errors_that_fit_into_the_clearance_need_no_contact() -> None:
    (sequence,) = best_sequences(*asked(rectangular((0.3, 0.3)), [0.02, 0.02, 0, 0.02, 0.02, 0.02], 5e-4, 0.029, 20))
    assert sequence.names == ("approach", "-z")
    assert sequence.reached.margin > 0.0
    assert all(not claim.piece.held and not claim.piece.making for claim in sequence.reached.claims)
    assert sequence.lower_bound <= sequence.cost


def test_a_floor_exactly_at_the_end_of_the_way_down_is_met() -> None:
    rng = np.random.default_rng(17)
    short = 0
    for depth in (7.3e-3, 11.1e-3, 15.7e-3, 23.9e-3):
        pocket = Moved(Box((0.0202, 0.0202, depth + 1e-3)), Pose(np.array([0.0, 0.0, -depth]), np.eye(3)))
        down = Pose(np.array([0.0, 0.0, -0.04]), np.eye(3))
        block = Difference(Moved(Box((0.06, 0.06, 0.04)), down), (pocket,))
        assembly = Assembly(part_of("peg", Box((0.02, 0.02, 0.04))), part_of("block", block))
        corners = assembly.moving.polyhedron.vertices
        corner = int(np.flatnonzero(corners[:, 2] == 0.0)[0])
        for _ in range(25):
            turn = rng.uniform(-0.3, 0.3, 3)
            pose = Pose(np.array([0.0, 0.0, rng.uniform(-depth + 1e-3, 0.06)]), exp(turn) @ exp(-turn))
            place = ContactPose(pose, (), (), corners[corner])
            straight = Freedom("-z", np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0]), float(pose.p[2]) + depth)
            near = neighbourhood(assembly, place, straight, 1e-3).contacts
            near = [one for one in near if one.kind is Kind.VERTEX_FACE and one.moving == (corner,)]
            seated = pose.moved(straight.limit * straight.twist)
            above = [c for c in near if 0.0 < Surfaces.of([c], *polyhedra(assembly)).values(seated)[0] < 1e-15]
            short += len(above)
            move = guarded(assembly, place, straight, Surfaces.of(near, *polyhedra(assembly)))
            assert move.goal.p[2] == pytest.approx(-depth, abs=1e-15)
    assert short > 0  # rounding leaves some of these a little above the floor


def check_graph(found: MoveSequence) -> None:
    """The states that the search came to are a tree, in which the way to the last one is the sequence."""
    states, way = found.searched.states, found.searched.way
    assert sum(state.expanded for state in states) == found.expanded
    for number, state in enumerate(states):
        assert state.origin is None or (state.origin < number and states[state.origin].expanded)
    assert [states[at].origin for at in way] == [None, *way[:-1]]
    assert tuple(name for at in way for name in states[at].names) == found.searched.names
    last = states[way[-1]]
    assert (last.cost, last.margin) == (found.cost, found.reached.margin)
    assert {contact.id for contact in last.held} == {c.id for c in (*found.moves[-1].held, *found.moves[-1].making)}
    assert any(at not in way for at in range(len(states)))


def test_a_peg_of_other_proportions_is_found_at_any_scale() -> None:
    """Lengths are measured in the errors and the clearance, so that metres do as well as millimetres."""
    box = [0.3, 0.3, 0.0, 0.3, 0.3, 0.3]
    one, ten = (
        best_sequences(*asked(rectangular((0.4, 0.35), k), box, 0.01, 0.030 * k, 60, k))[0] for k in (1.0, 10.0)
    )
    assert (one.names, one.names[0], len(one.names)) == (ten.names, "approach", 7)
    check_graph(one)
    margins = [[claim.margin for claim in sequence.reached.claims] for sequence in (one, ten)]
    np.testing.assert_allclose(10.0 * np.array(margins[0]), margins[1], rtol=1e-6, atol=1e-9)
    assert one.cost == pytest.approx(ten.cost, rel=1e-6)


def test_a_search_out_of_time_gives_what_it_has() -> None:
    task, rounds = asked(rectangular((0.3, 0.3)), [0.02, 0.02, 0, 0.02, 0.02, 0.02], 5e-4, 0.029, 20)
    begun: list[float] = []

    def told(names: str) -> None:
        """The clock runs out while the sons of the first state are made."""
        begun.append(time.monotonic())
        time.sleep(0.4)

    entries = next(rounds)
    found = search(task, entries, time.monotonic() + 0.3, told)
    assert len(begun) == 1
    assert found.names == ("approach", "-z")
    assert found.reached.margin > 0.0
    assert found.lower_bound <= found.cost


def test_moves_to_the_same_place_are_tried_once() -> None:
    start, there = Pose(np.zeros(3), np.eye(3)), Pose(np.array([1e-3, 0.0, 0.0]), exp(np.array([0.0, 0.1, 0.0])))
    one, other, *_ = near_contacts(*polyhedra(rectangular((0.3, 0.3))), start, 1e-2, 0.1)
    first, second = Move(start, there, (), (one,)), Move(start, there, (), (other,))
    rounded = Move(start, there.moved([1e-13, -1e-13, 0.0, 0.0, 0.0, 1e-13]), (), (one,))
    elsewhere = Move(start, there.moved([1e-8, 0.0, 0.0, 0.0, 0.0, 0.0]), (), (one,))
    tried: Tried = set()
    assert list(fresh([first, rounded, second], tried)) == [first, second]
    assert list(fresh([rounded, elsewhere], tried)) == [elsewhere]


def test_the_order_of_moves_not_rounding_tells_states_of_equal_cost_apart() -> None:
    task, rounds = asked(rectangular((0.3, 0.3)), [0.02, 0.02, 0, 0.02, 0.02, 0.02], 5e-4, 0.029, 20)
    node = begin(task, next(rounds)[0])
    images = [replace(node, cost=node.cost * (1.0 + off), names=(name,)) for name, off in (("-x", 4e-16), ("-y", 0.0))]
    assert images[0].cost > images[1].cost
    for order in (images, images[::-1]):
        front = _Frontier(task.final_rank, task.costs, order)
        assert [front.pop(), front.pop()] == order


def test_a_search_cut_short_says_how_far_it_came() -> None:
    task, rounds = asked(rectangular((0.15, 0.12)), [0.3, 0.3, 0.0, 0.3, 0.3, 0.3], 0.01, 0.030, 2)
    with pytest.raises(SearchError, match=r"among 2 states, the closest came after approach [^,]+; allow a"):
        search(task, next(rounds))


@pytest.mark.parametrize(
    ("binding", "words"),
    [("pieces 0/3", "the distance of piece 0 of the moving part from piece 3 of the fixed one"), ("e1-e10", "e1-e10")],
)
def test_what_is_short_on_the_way_is_said(binding: str, words: str) -> None:
    task, rounds = asked(rectangular((0.3, 0.3)), [0.02, 0.02, 0, 0.02, 0.02, 0.02], 5e-4, 0.029, 20)
    node = begin(task, next(rounds)[0])
    assert shortfall(node) == ""
    (claim,) = node.reached.claims
    worse = (claim, replace(claim, margin=-1.25e-5, binding=binding), replace(claim, margin=-1e-6))
    short = replace(node, reached=replace(node.reached, claims=worse))
    assert shortfall(short) == f", where {words} is short by 12.5 um for the stated errors"
