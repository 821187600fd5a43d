"""Routes through convex sets: what is found lies in the sets, and what bounds it bounds every route."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import linprog

from fmopt.contact.primitive import near_contacts
from fmopt.contact.state_graph import ContactGraph, Scale, contact_graph, faces, local_space
from fmopt.errors import InfeasibleError
from fmopt.planning.optimise.convex_route import ConvexSets, Route, shortest_route
from fmopt.planning.search.state_route import state_route
from fmopt.spatial.values import Array
from tests.shared.parts.convex_sets import in_space, overlapping, relaxation, shortest_of_all
from tests.shared.parts.square import MID_DEPTH, block, peg


def inside(corners: Array, point: Array) -> float:
    """How far a point is from being a mean of corners, in the largest coordinate."""
    m, d = corners.shape
    rows = np.vstack([np.hstack([corners.T, -np.ones((d, 1))]), np.hstack([-corners.T, -np.ones((d, 1))])])
    one = np.append(np.ones(m), 0.0)[None]
    found = linprog(np.append(np.zeros(m), 1.0), rows, np.append(point, -point), one, [1.0], bounds=(0.0, None))
    return float(found.fun)


def cost(sets: ConvexSets, route: Route) -> float:
    """The cost of a route, counted again."""
    tolls = {(u, v): toll for (u, v), toll in zip(sets.arcs.tolist(), sets.tolls.tolist(), strict=True)}
    legs = pairwise(route.stops)
    return float(np.linalg.norm(np.diff(route.points, axis=0), axis=1).sum()) + sum(tolls[leg] for leg in legs)


@pytest.mark.parametrize("seed", range(12))
def test_a_route_through_few_sets_is_the_shortest_of_all(seed: int) -> None:
    sets = overlapping(seed)
    shortest = shortest_of_all(sets)
    last = len(sets.corners) - 1
    if np.isinf(shortest):
        with pytest.raises(InfeasibleError, match="no arcs lead"):
            shortest_route(sets, 0, last)
        return
    found = shortest_route(sets, 0, last, gap=0.01)
    assert found.lower_bound <= shortest * (1.0 + 1e-6) + 1e-6
    assert found.cost == pytest.approx(shortest, rel=0.01, abs=1e-5)
    assert (found.stops[0], found.stops[-1], len(set(found.stops))) == (0, last, len(found.stops))
    assert found.cost == pytest.approx(cost(sets, found), abs=1e-12)
    for at, point in zip(found.stops, found.points, strict=True):
        assert inside(sets.corners[at], point) <= 1e-9


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("steps", [1, 7, 60])
def test_the_bound_holds_whenever_one_stops(seed: int, steps: int) -> None:
    sets = overlapping(seed)
    shortest = shortest_of_all(sets)
    if np.isfinite(shortest):
        found = shortest_route(sets, 0, len(sets.corners) - 1, gap=1e-6, steps=steps)
        assert 0.0 <= found.lower_bound <= shortest * (1.0 + 1e-6) + 1e-6
        assert found.cost >= shortest - 1e-6


@pytest.mark.parametrize("seed", [1, 2])
def test_the_bound_is_near_that_of_the_relaxation(seed: int) -> None:
    sets = in_space(20, seed)
    relaxed = relaxation(sets)
    found = shortest_route(sets, 0, 19, gap=0.02)
    assert found.cost >= relaxed * (1.0 - 1e-6)
    assert 0.97 * relaxed <= found.lower_bound <= relaxed * (1.0 + 1e-6)
    assert found.gap <= 0.02 + 1e-9


def test_fifty_sets_in_six_dimensions() -> None:
    sets = in_space(50, 0)
    found, again = (shortest_route(sets, 0, 49) for _ in range(2))
    assert found.gap <= 0.03 + 1e-9
    assert (found.stops, found.lower_bound) == (again.stops, again.lower_bound)
    assert np.array_equal(found.points, again.points)


def test_points_alone_make_a_shortest_path_of_a_graph() -> None:
    square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    around, across = [(0, 1), (1, 2), (0, 3), (3, 2)], (0, 2)
    assert shortest_route(ConvexSets.of(square, [*around, across]), 0, 2).stops == (0, 2)
    dear = shortest_route(ConvexSets.of(square, [*around, across], [0.0, 0.0, 0.1, 0.0, 1.0]), 0, 2, gap=1e-4)
    assert dear.stops == (0, 1, 2)
    assert dear.cost == pytest.approx(2.0, abs=1e-9)
    assert dear.lower_bound == pytest.approx(2.0, rel=1e-4)
    assert shortest_route(ConvexSets.of(square, around), 1, 1).cost == 0.0


@pytest.mark.parametrize(
    ("corners", "arcs", "tolls", "words"),
    [
        ([[[0.0]], [[1.0, 2.0]]], [(0, 1)], 0.0, "one dimension"),
        ([[[0.0]], np.zeros((0, 1))], [(0, 1)], 0.0, "needs corners"),
        ([[[0.0]], [[1.0]]], [(0, 2)], 0.0, "between sets 0 to 1"),
        ([[[0.0]], [[1.0]]], [(0, 1)], -1.0, "not be negative"),
        ([[[0.0]], [[np.nan]]], [(0, 1)], 0.0, "not finite"),
    ],
)
def test_sets_that_are_none_are_refused(corners: list[Array], arcs: Array, tolls: float, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        ConvexSets.of(corners, arcs, tolls)


def test_a_gap_has_to_be_a_share() -> None:
    with pytest.raises(ValueError, match="between 0 and 1"):
        shortest_route(overlapping(0), 0, 1, gap=0.0)


@pytest.fixture(scope="module")
def mid_depth() -> ContactGraph:
    contacts = near_contacts(peg(), block(), MID_DEPTH, reach=1e-3, angle=0.02)
    space = local_space(contacts, peg(), block(), MID_DEPTH, Scale(1e-4, 0.014))
    return contact_graph(space, faces(space))


def test_a_route_through_contact_states_makes_contacts_freedom_by_freedom(mid_depth: ContactGraph) -> None:
    goal = max(mid_depth.states, key=lambda state: len(state.contacts))
    found = state_route(mid_depth, (), goal.contacts)
    assert [state.dimension for state in found.states] == [6, 5, 4, 3, 2, 1]
    assert found.states[0].contacts == ()
    assert found.states[-1] is goal
    assert found.lower_bound <= found.cost
    assert found.gap < 0.1
    space = mid_depth.space
    for state, point in zip(found.states, found.points / space.scale, strict=True):
        distance = space.normals @ point - space.offsets
        held = np.isin([contact.id for contact in space.contacts], state.contacts)
        assert np.abs(distance[held]).max(initial=0.0) < 1e-6
        own = space.normals @ (state.point / space.scale) - space.offsets
        assert (distance >= 0.5 * own - 1e-6).all()
    travel = np.linalg.norm(np.diff(found.points / space.scale, axis=0), axis=1).sum()
    assert found.cost == pytest.approx(5.0 + travel)


def test_the_points_of_states_alone_are_the_route_where_all_room_is_asked_for(mid_depth: ContactGraph) -> None:
    goal = mid_depth.states[-1]
    found = state_route(mid_depth, (), goal.contacts, room=1.0, gap=1e-3)
    assert found.points == pytest.approx(np.array([state.point for state in found.states]), abs=1e-12)
    assert found.lower_bound == pytest.approx(found.cost, rel=1e-3)


def test_more_room_costs_no_less(mid_depth: ContactGraph) -> None:
    goal = mid_depth.states[-1].contacts
    costs = [state_route(mid_depth, (), goal, room=room) for room in (0.0, 0.5, 1.0)]
    assert all(less.lower_bound <= more.cost for less, more in pairwise(costs))
    assert costs[0].lower_bound >= 5.0 - 1e-9  # five contacts to be made


def test_states_that_there_are_not_are_refused(mid_depth: ContactGraph) -> None:
    with pytest.raises(InfeasibleError, match="just the contacts v0"):
        state_route(mid_depth, (), ("v0",))
    with pytest.raises(ValueError, match="room"):
        state_route(mid_depth, (), (), room=2.0)
