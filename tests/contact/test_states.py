"""Contact-state graphs and their confirmation on the true surfaces."""

import pickle
from collections import Counter

import numpy as np
import pytest

from fmopt.contact.c_surface import Surfaces
from fmopt.contact.facet_bounds import cell, touching
from fmopt.contact.primitive import near_contacts, vertex_face
from fmopt.contact.realisation import Neighbourhood, Poses, meet
from fmopt.contact.state_graph import ContactCell, ContactGraph, ContactState, Scale, contact_graph, faces, local_space
from fmopt.planning.robustness.contact_space import APART, RESIDUAL, Confirmation, StateAdvice, confirm
from fmopt.spatial.se3 import Pose
from tests.shared.parts.square import MID_DEPTH, block, peg
from tests.shared.parts.square_poses import gap

CLEARANCE = 1e-4
RHO = 0.5 * float(np.hypot(0.02, 0.02))
REACH = 3.0 * CLEARANCE
DEPTHS = {"mouth": -0.001, "mid-depth": -0.015, "bottom": -0.030}


def around(depth: float) -> ContactGraph:
    """The states round the centred upright pose at a depth, up to 3 mm and 0.2 rad away."""
    pose = Pose(np.array([0.0, 0.0, depth]), np.eye(3))
    near = near_contacts(peg(), block(), pose, REACH, REACH / RHO)
    kept, limits = cell(near, peg(), block(), pose, 2.0 * REACH)
    box = 10.0 * REACH, 10.0 * REACH / RHO
    space = local_space(kept, peg(), block(), pose, Scale(CLEARANCE, RHO), ContactCell(limits, *box))
    return contact_graph(space, faces(space))


@pytest.fixture(scope="module", params=DEPTHS)
def engaged(request: pytest.FixtureRequest) -> tuple[str, ContactGraph, tuple[Confirmation, ...]]:
    graph = around(DEPTHS[request.param])
    return request.param, graph, confirm(graph, peg(), block())


@pytest.fixture(scope="module")
def graph() -> ContactGraph:
    contacts = near_contacts(peg(), block(), MID_DEPTH, reach=1e-3, angle=0.02)
    space = local_space(contacts, peg(), block(), MID_DEPTH, Scale(CLEARANCE, 0.5 * np.hypot(0.02, 0.02)))
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


def test_a_graph_pickles(graph: ContactGraph) -> None:
    again = pickle.loads(pickle.dumps(graph))
    assert not again.states[5].point.flags.writeable


def test_confirmed_states_touch_where_they_say(graph: ContactGraph, confirmed: tuple[Confirmation, ...]) -> None:
    surfaces = Surfaces.of(graph.space.contacts, peg(), block())
    for state, found in zip(graph.states, confirmed, strict=True):
        if found.verdict is StateAdvice.CONFIRMED:
            f = dict(zip((c.id for c in graph.space.contacts), surfaces.values(found.pose), strict=True))
            assert all(abs(f[c]) <= RESIDUAL * CLEARANCE for c in state.contacts)
            assert all(f[c] > APART * CLEARANCE for c in f if c not in state.contacts)


def test_states_flush_at_two_walls_and_tilted_split(graph: ContactGraph, confirmed: tuple[Confirmation, ...]) -> None:
    # Two tip edges flush with two walls want (R y)_x = (R x)_y = 0; orthogonal columns then give R_zx R_zy = 0, so one
    # tilt vanishes. The same holds for two mouth edges. The linear picture has these states with both tilts at work.
    count = Counter((state.dimension, found.verdict.name) for state, found in zip(graph.states, confirmed, strict=True))
    split = {(3, "SPLIT"): 8, (2, "SPLIT"): 16, (1, "SPLIT"): 4}
    assert {key: n for key, n in count.items() if key[1] != "CONFIRMED"} == split
    for state, found in zip(graph.states, confirmed, strict=True):
        if found.verdict is StateAdvice.SPLIT:
            tilt = np.abs(state.point[3:5])
            # Least squares shares the gap θ_x θ_y / 2 × 20 mm between the contacts of an edge.
            assert 0.2 * tilt[0] * tilt[1] * 0.02 < found.residual < 0.4 * tilt[0] * tilt[1] * 0.02


def test_no_state_is_left_undecided(engaged: tuple[str, ContactGraph, tuple[Confirmation, ...]]) -> None:
    # The linear picture of the mouth is 0.2 rad off: what it calls a state there is found 2 mm deeper.
    name, _, found = engaged
    split = {"mouth": 28, "mid-depth": 28, "bottom": 128}[name]
    assert Counter(c.verdict for c in found) == {StateAdvice.CONFIRMED: len(found) - split, StateAdvice.SPLIT: split}


def test_confirmed_poses_touch_without_overlap(engaged: tuple[str, ContactGraph, tuple[Confirmation, ...]]) -> None:
    """The gap by separating axes knows nothing of contacts."""
    _, graph, found = engaged
    for state, confirmation in zip(graph.states, found, strict=True):
        if confirmation.verdict is StateAdvice.CONFIRMED:
            apart = gap(confirmation.pose)
            assert abs(apart) <= 1e-12 if state.contacts else apart > 0.0


def test_refuted_states_are_found_from_nowhere(engaged: tuple[str, ContactGraph, tuple[Confirmation, ...]]) -> None:
    _, graph, found = engaged
    rng = np.random.default_rng(9)
    near = Neighbourhood.of(graph.space, peg(), block())
    names = [c.id for c in graph.space.contacts]
    refuted = [s for s, c in zip(graph.states, found, strict=True) if c.verdict is not StateAdvice.CONFIRMED][::4]
    starts = rng.uniform(-1.0, 1.0, (8 * len(refuted), 6)) * np.repeat([CLEARANCE, 0.05], 3)
    on = np.repeat([np.isin(names, s.contacts) for s in refuted], 8, axis=0)
    at = near.measured(on, meet(near, on, Poses.around(graph.space.pose, starts), 0.01).poses)
    assert not ((at.residual <= RESIDUAL) & (at.slack > APART) & (at.limits.min(axis=1) > 0.0)).any()


def handmade(graph: ContactGraph, contacts: tuple[str, ...], dimension: int, point: np.ndarray) -> Confirmation:
    """What is said of a state that somebody made up."""
    state = ContactState("made up", contacts, dimension, point)
    return confirm(ContactGraph(graph.space, (state,), ((),), ((),)), peg(), block())[0]


def test_a_state_that_brings_another_contact_along_is_blocked_by_it() -> None:
    floor = tuple(c.id for c in around(-0.030).space.contacts if c.fixed_feature == 2)
    assert len(floor) == 4
    found = handmade(around(-0.030), floor[:3], 3, np.zeros(6))
    assert (found.verdict, found.against) == (StateAdvice.BLOCKED, floor[3])


def test_a_corner_on_the_rim_is_at_the_end_of_both_faces() -> None:
    """On the wall's plane and on the top's at once, it is inside neither; the linear picture calls it a state."""
    pose = Pose(np.array([0.0, 0.0, 2e-4]), np.eye(3))
    wall = next(f for f, face in enumerate(block().faces) if face.normal[0] == 1.0 and f > 6)
    contacts = [vertex_face(block(), 0, wall), vertex_face(block(), 0, 1)]
    space = local_space(contacts, peg(), block(), pose, Scale(CLEARANCE, RHO), ContactCell((), 1e-3, 1e-2))
    graph = contact_graph(space, faces(space))
    found = dict(zip((s.contacts for s in graph.states), confirm(graph, peg(), block()), strict=True))
    both = found[tuple(c.id for c in contacts)]
    assert both.verdict is StateAdvice.OUT_OF_BOUNDS
    assert both.against in {f"v0-f{wall}", "v0-f1"}
    assert found[contacts[0].id,].verdict is StateAdvice.CONFIRMED


def test_what_lies_beyond_the_limits_is_left_open() -> None:
    pose = Pose(np.array([0.0, 0.0, 2e-4]), np.eye(3))
    touch = vertex_face(block(), 0, next(f for f, face in enumerate(block().faces) if face.normal[0] == 1.0 and f > 6))
    space = local_space([touch], peg(), block(), pose, Scale(CLEARANCE, RHO), ContactCell((), 1.5e-4, 1e-4))
    found = confirm(contact_graph(space, faces(space)), peg(), block())
    assert [c.verdict for c in found] == [StateAdvice.CONFIRMED, StateAdvice.UNDECIDED]


def test_contacts_that_meet_nowhere_are_split() -> None:
    graph = around(-0.015)
    opposite = [c.id for c in graph.space.contacts if c.moving == (0,)]
    assert len(opposite) == 2
    found = handmade(graph, (*opposite, *(c.id for c in graph.space.contacts if c.moving == (2,))), 2, np.zeros(6))
    assert found.verdict is StateAdvice.SPLIT
    assert found.residual > 1e-5


def test_touching_contacts_are_zero_in_their_bounds(graph: ContactGraph, confirmed: tuple[Confirmation, ...]) -> None:
    for state, found in zip(graph.states[::7], confirmed[::7], strict=True):
        if found.verdict is StateAdvice.CONFIRMED:
            names = {c.id for c in touching(graph.space.contacts, peg(), block(), found.pose)}
            assert names == set(state.contacts)
