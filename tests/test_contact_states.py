"""Contact-state graphs and their confirmation on the true surfaces."""

import pickle
from collections import Counter

import numpy as np
import pytest
from test_contact_parts import MID_DEPTH, block, peg

from fmopt.contact.confirm import Confirmation, Verdict, confirm
from fmopt.contact.graph import ContactGraph, contact_graph
from fmopt.contact.primitive import near_contacts
from fmopt.contact.space import faces, local_space
from fmopt.contact.surface import Surfaces

CLEARANCE = 1e-4


@pytest.fixture(scope="module")
def graph() -> ContactGraph:
    contacts = near_contacts(peg(), block(), MID_DEPTH, reach=1e-3, angle=0.02)
    space = local_space(contacts, peg(), block(), MID_DEPTH, CLEARANCE, 0.5 * np.hypot(0.02, 0.02))
    return contact_graph(space, faces(space))


@pytest.fixture(scope="module")
def confirmed(graph: ContactGraph) -> tuple[Confirmation, ...]:
    return confirm(graph, peg(), block())


def test_free_space_is_the_only_state_without_a_father(graph: ContactGraph) -> None:
    assert graph.states[0].id == "free"
    assert [i for i, fathers in enumerate(graph.fathers) if not fathers] == [0]
    assert all(graph.sons[i] for i, state in enumerate(graph.states) if state.dimension > 1)


def test_the_graph_is_graded(graph: ContactGraph) -> None:
    for i, sons in enumerate(graph.sons):
        for j in sons:
            assert set(graph.states[i].contacts) < set(graph.states[j].contacts)
            assert graph.states[j].dimension == graph.states[i].dimension - 1
            assert i in graph.fathers[j]
    # A face of a polytope lies in at least as many facets as its codimension; ridges lie in exactly two.
    assert all(len(graph.fathers[i]) == 2 for i, state in enumerate(graph.states) if state.dimension == 4)


def test_obstacles_are_the_sons_contacts_without_the_segments_own(graph: ContactGraph) -> None:
    one = graph.sons[0][0]
    goal = graph.sons[one][0]
    obstacles = graph.obstacles(0, one)
    assert set(obstacles) == {c.id for c in graph.space.contacts} - set(graph.states[one].contacts)
    assert not set(graph.obstacles(one, goal, start=0)) & set(graph.states[goal].contacts)


def test_network_and_pickle(graph: ContactGraph) -> None:
    network = graph.network()
    assert network.number_of_nodes() == 243
    assert network.number_of_edges() == sum(map(len, graph.sons))
    again = pickle.loads(pickle.dumps(graph))
    assert not again.states[5].point.flags.writeable
    assert again.index(frozenset(graph.states[7].contacts)) == 7
    assert graph.index(frozenset({"no such contact"})) is None


def test_confirmed_states_touch_where_they_say(graph: ContactGraph, confirmed: tuple[Confirmation, ...]) -> None:
    surfaces = Surfaces.of(graph.space.contacts, peg(), block())
    for state, found in zip(graph.states, confirmed, strict=True):
        if found.verdict is Verdict.CONFIRMED:
            f = dict(zip((c.id for c in graph.space.contacts), surfaces.values(found.pose), strict=True))
            assert all(abs(f[c]) <= 1e-9 * CLEARANCE for c in state.contacts)
            assert all(f[c] > 1e-6 * CLEARANCE for c in f if c not in state.contacts)


def test_states_flush_at_two_walls_while_tilted_about_both_split(
    graph: ContactGraph, confirmed: tuple[Confirmation, ...]
) -> None:
    # Two tip edges flush with two walls want (R y)_x = (R x)_y = 0; orthogonal columns then give R_zx R_zy = 0, so one
    # tilt vanishes. The same holds for two mouth edges. The linear picture has these states with both tilts at work.
    count = Counter((state.dimension, found.verdict.name) for state, found in zip(graph.states, confirmed, strict=True))
    split = {(3, "SPLIT"): 8, (2, "SPLIT"): 16, (1, "SPLIT"): 4}
    assert {key: n for key, n in count.items() if key[1] != "CONFIRMED"} == split
    for state, found in zip(graph.states, confirmed, strict=True):
        if found.verdict is Verdict.SPLIT:
            tilt = np.abs(state.point[3:5])
            # Least squares shares the gap θ_x θ_y / 2 × 20 mm between the contacts of an edge.
            assert 0.2 * tilt[0] * tilt[1] * 0.02 < found.residual < 0.4 * tilt[0] * tilt[1] * 0.02
