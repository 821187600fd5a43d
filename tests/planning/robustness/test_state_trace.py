"""The states of a motion as nodes of contact graphs: every change an edge or the passing of a rim; gaps are noticed."""

from dataclasses import replace

import numpy as np
import pytest

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.claim import Claim
from fmopt.contact.state_graph import Scale
from fmopt.geometry.csg import Box, Difference, Moved
from fmopt.geometry.part import part_of
from fmopt.papers.lee_huang.nominal_trajectory import CriticalPose
from fmopt.planning.robustness.contact_space import Space, StateAdvice, contact_spaces, space_at
from fmopt.planning.robustness.state_trace import Visited, visited
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array
from tests.shared.parts.peg_pieces import TOLERANCE, claims, peg

SCALE = Scale(1e-4, TOLERANCE.rho)


def upright(z: float) -> Pose:
    return Pose(np.array([0.0, 0.0, z]), np.eye(3))


def nominal() -> tuple[CriticalPose, ...]:
    named = {"mouth": 0.0, "mid-depth": -0.015, "bottom": -0.030}
    return tuple(CriticalPose(name, upright(z).vector(), -z) for name, z in named.items())


@pytest.fixture(scope="module")
def spaces() -> tuple[Space, ...]:
    return contact_spaces(peg().assembly, nominal(), SCALE)


@pytest.fixture(scope="module")
def found(spaces: tuple[Space, ...]) -> Visited:
    return visited(peg().assembly, claims(), spaces, SCALE)


def test_every_state_is_a_confirmed_node_and_every_change_an_edge(found: Visited) -> None:
    assert [visit.change for visit in found.visits] == ["start", *["made"] * 4, "passed", "made", "made"]
    for before, visit in zip(found.visits, found.visits[1:], strict=False):
        assert before.claim <= visit.claim
        if visit.change == "made":
            common = [at for at in visit.spaces if at in before.spaces]
            assert common
            space = found.spaces[common[0]]
            father = before.states[before.spaces.index(common[0])]
            son = visit.states[visit.spaces.index(common[0])]
            assert son in space.graph.sons[father]
    for visit in found.visits:
        for at, state in zip(visit.spaces, visit.states, strict=True):
            assert frozenset(found.spaces[at].graph.states[state].contacts) == visit.contacts
            assert found.spaces[at].found[state].verdict is StateAdvice.CONFIRMED


def test_states_are_what_the_moves_hold(found: Visited) -> None:
    """Of contacts listed because either may touch, one does; else the two ways to tell a state agree."""
    ends = {visit.claim: visit.contacts for visit in found.visits if visit.change == "made"}
    made = [(k, claim.piece) for k, claim in enumerate(claims()) if claim.piece.last and claim.piece.making]
    assert [k for k, _ in made] == sorted(ends)
    for k, piece in made:
        listed = {c.id for c in piece.goal_contacts}
        assert listed - ends[k] <= {c.id for c in piece.held}
        assert {c.id for c in piece.making} <= ends[k]


def test_a_vertex_that_passes_the_rim_hands_over_to_the_next_edge(found: Visited) -> None:
    before, after = next((a, b) for a, b in zip(found.visits, found.visits[1:], strict=False) if b.change == "passed")
    assert before.contacts - after.contacts == {"e1-e8"}
    assert after.contacts - before.contacts == {"v2-f7", "e5-e8"}
    piece = claims()[after.claim].piece
    body = peg().assembly.moving.polyhedron.vertices[2]
    assert piece.start.apply(body)[2] > 0.0 > piece.goal.apply(body)[2]


def test_spaces_near_the_nominal_path_serve_again(found: Visited, spaces: tuple[Space, ...]) -> None:
    assert found.spaces[:3] == spaces
    assert [space.name for space in found.spaces[3:]] == ["move 2", "move 3", "move 5"]
    assert (found.visits[-1].spaces, found.visits[0].spaces) == ((2,), (3,))


def test_pieces_run_in_spaces_that_hold_their_states(found: Visited) -> None:
    for k in range(len(claims())):
        begun = [visit for visit in found.visits if visit.claim < k]
        assert found.space_of(k) in begun[-1].spaces


def test_a_gap_in_the_motion_is_noticed(spaces: tuple[Space, ...]) -> None:
    jump = next(k for k, claim in enumerate(claims()) if claim.piece.last and len(claim.piece.goal_contacts) == 2)
    broken = visited(peg().assembly, claims()[: jump - 7] + claims()[jump + 1 :], spaces, SCALE)
    assert any(visit.change == "unexplained" for visit in broken.visits)


def test_a_contact_that_is_not_listed_is_noticed(spaces: tuple[Space, ...]) -> None:
    """What touches at the end of a move and is none of the contacts made was not foreseen."""
    k = next(k for k, claim in enumerate(claims()) if claim.piece.last and len(claim.piece.making) == 2)
    claim = claims()[k]
    piece = replace(claim.piece, goal_contacts=(*claim.piece.held, claim.piece.making[0]))
    forged: tuple[Claim, ...] = (*claims()[:k], replace(claim, piece=piece), *claims()[k + 1 :])
    assert any(visit.change == "unexplained" for visit in visited(peg().assembly, forged, spaces, SCALE).visits)


def test_descriptions_count_every_state_and_mark_the_way(found: Visited) -> None:
    points, graphs = found.critical_points(), {graph.critical_point: graph for graph in found.graphs()}
    assert list(graphs) == ["move 2", "move 3", "move 5", "mouth", "bottom", "mid-depth"]
    for point, space in zip(points, found.spaces, strict=True):
        graph = graphs[point.name]
        counted = point.states_by_verdict
        assert set(counted) == {"confirmed", "split", "blocked", "out_of_bounds", "undecided"}
        assert sum(counted.values()) == sum(point.states_by_dimension.values()) == len(space.graph.states)
        for father, sons in enumerate(graph.sons):
            for son in sons:
                assert graph.states[son].dimension == graph.states[father].dimension - 1
                assert set(graph.states[father].contacts) < set(graph.states[son].contacts)
        assert all(graph.verdicts[i] == "confirmed" for i in graph.chosen)
    assert sum(len(graph.chosen) for graph in graphs.values()) == sum(len(visit.spaces) for visit in found.visits)
    for described, visit in zip(found.sequence(), found.visits, strict=True):
        for at, name in described.held_in:
            state = next(s for s in graphs[points[at].name].states if s.id == name)
            assert state.contacts == described.contacts == tuple(sorted(visit.contacts))


def test_large_graphs_are_written_only_near_the_way(found: Visited) -> None:
    bottom, graph = found.spaces[2], next(g for g in found.graphs() if g.critical_point == "bottom")
    assert len(bottom.graph.states) == 590
    assert len(graph.states) <= 300
    chosen = [frozenset(graph.states[i].contacts) for i in graph.chosen]
    assert chosen == [visit.contacts for visit in found.visits[-2:]]
    assert bottom.graph_near(()).states == ()


def test_a_pose_on_the_end_of_faces_is_left_aside() -> None:
    """A through hole as deep as the goal: there every wall contact ends at the lower rim."""
    plate = Difference(Box((0.06, 0.06, 0.02)), (Moved(Box((0.0202, 0.0202, 0.03)), upright(-0.005)),))
    assembly = Assembly(part_of("peg", Box((0.02, 0.02, 0.04))), part_of("plate", Moved(plate, upright(-0.02))))
    mouth = contact_spaces(assembly, nominal()[:2], SCALE)[0]
    assert mouth.graph.count() == space_at(assembly, "in", upright(-0.001), (), SCALE, 10.0).graph.count()
    at_goal = contact_spaces(assembly, (CriticalPose("bottom", upright(-0.02).vector(), 1.0),), SCALE)[0]
    np.testing.assert_allclose(at_goal.graph.space.pose.p, [0.0, 0.0, -0.019])
    np.testing.assert_allclose(at_goal.pose[:3], [0.0, 0.0, -0.02])
    assert len(at_goal.graph.states) == 243


def test_nearness_counts_shifts_and_turns(spaces: tuple[Space, ...]) -> None:
    mouth = spaces[0]

    def near(X: Array) -> bool:
        return mouth.near(upright(0.0).moved(X), SCALE)

    assert near(np.array([2.9e-4, 0.0, 0.0, 0.0, 0.0, 0.0]))
    assert near(np.array([0.0, 0.0, -1.2e-3, 0.0, 0.0, 0.0]))
    assert not near(np.array([0.0, 0.0, -6e-4, 0.0, 0.0, 0.0]))
    assert not near(np.array([0.0, 0.0, 0.0, 0.03, 0.0, 0.0]))
