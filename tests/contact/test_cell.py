"""Cells: around any free pose, the kept contacts alone tell collision from freedom; an independent test agrees."""

import numpy as np
import pytest

from fmopt.contact.c_surface import Surfaces
from fmopt.contact.facet_bounds import BoundingFunction, cell
from fmopt.contact.primitive import near_contacts
from fmopt.contact.state_graph import ContactCell, Scale, contact_graph, faces, local_space
from fmopt.errors import InfeasibleError
from fmopt.planning.robustness.contact_space import StateAdvice, confirm
from fmopt.spatial.se3 import Pose, exp
from fmopt.task.problem import load
from tests import PROBLEMS
from tests.shared.parts.square_poses import BLOCK, HALF, PEG, POSES, gap


@pytest.mark.parametrize("name", POSES)
def test_the_kept_contacts_decide_collision(name: str) -> None:
    pose, reach, angle, count = POSES[name]
    assert gap(pose) > 0.0
    contacts, limits = cell(near_contacts(PEG, BLOCK, pose, reach, angle), PEG, BLOCK, pose, within=1e-3)
    assert len(contacts) == count
    surfaces = Surfaces.of(contacts, PEG, BLOCK)
    bounds, signs = Surfaces.of([b.contact for b in limits], PEG, BLOCK), np.array([b.sign for b in limits])
    rng = np.random.default_rng(2)
    seen = {True: 0, False: 0}
    for _ in range(500):
        d, turn = rng.normal(size=(2, 3))
        shift, rotation = rng.uniform(size=2) * [reach, angle]
        moved = pose.moved([*(shift * d / np.linalg.norm(d)), *(rotation * turn / np.linalg.norm(turn))])
        if np.any(signs * bounds.values(moved) >= 0.0):
            continue
        free = bool(np.min(surfaces.values(moved)) > 0.0)
        assert free == (gap(moved) > 0.0)
        seen[free] += 1
    assert min(seen.values()) >= 4


def test_a_forgotten_contact_is_noticed() -> None:
    pose, reach, angle, _ = POSES["mid-depth"]
    contacts = near_contacts(PEG, BLOCK, pose, reach, angle)
    graph = contact_graph(space := local_space(contacts, PEG, BLOCK, pose, Scale(1e-4, 0.014)), faces(space))
    for forgotten in contacts:
        surfaces = Surfaces.of([c for c in contacts if c is not forgotten], PEG, BLOCK)
        moved = pose.moved(1.2 * next(state.point for state in graph.states if set(state.contacts) == {forgotten.id}))
        assert gap(moved) < 0.0 < np.min(surfaces.values(moved))


def test_the_corner_in_the_mouth_has_confirmed_states() -> None:
    pose, reach, angle, _ = POSES["corner in the mouth"]
    contacts, limits = cell(near_contacts(PEG, BLOCK, pose, reach, angle), PEG, BLOCK, pose, within=1e-3)
    space = local_space(contacts, PEG, BLOCK, pose, Scale(1e-4, 0.014), ContactCell(limits, reach, angle))
    graph = contact_graph(space, faces(space))
    assert graph.states[0].id == "free"
    verdicts = [found.verdict for found in confirm(graph, PEG, BLOCK)]
    assert verdicts.count(StateAdvice.CONFIRMED) >= 0.75 * len(verdicts)
    # The two upright-edge contacts of the low corner hold the peg in the hole's corner.
    sliding = [s for s in graph.states if len(s.contacts) == 2 and {c[:2] for c in s.contacts} == {"e6"}]
    assert [state.dimension for state in sliding] == [4]


def test_a_limit_in_a_contacts_plane_does_not_hide_it() -> None:
    pose, reach, angle, _ = POSES["just below the mouth"]
    contacts, limits = cell(near_contacts(PEG, BLOCK, pose, reach, angle), PEG, BLOCK, pose, within=1e-3)
    space = local_space(contacts, PEG, BLOCK, pose, Scale(1e-4, 0.014), ContactCell(limits))
    assert faces(space).active.any(axis=0).all()


def test_a_contact_that_a_touching_one_ends_is_not_kept_by_rounding() -> None:
    """A tip edge counts on the rim only where its corner is beyond the wall: never, while the corner touches that."""
    R = exp(np.radians([0.0, 5.0, 0.0])) @ exp(np.radians([0.0, 0.0, 1.0]))
    tip, kept = R @ PEG.vertices[2], []
    for noise in (-1e-17, 0.0, 1e-17):
        pose = Pose(np.array([-1e-3, HALF - tip[1] + noise, -5e-4 - tip[2]]), R)
        near = near_contacts(PEG, BLOCK, pose, 6e-4, 0.01)
        f = dict(zip((c.id for c in near), Surfaces.of(near, PEG, BLOCK).values(pose), strict=True))
        assert f["e3-e23"] < -4e-4
        contacts, limits = cell(near, PEG, BLOCK, pose, within=1e-3)
        assert np.min(Surfaces.of(contacts, PEG, BLOCK).values(pose)) > -1e-15
        space = local_space(contacts, PEG, BLOCK, pose, Scale(1e-4, 0.014), ContactCell(limits, 3e-4, 0.01))
        assert ("v2-f9",) in {s.contacts for s in contact_graph(space, faces(space)).states}
        kept.append([c.id for c in contacts])
    assert kept[0] == kept[1] == kept[2]


def test_a_key_in_its_keyway_is_not_on_the_top_beside_it() -> None:
    """The keyway is a notch of the hole's outline: told edge by edge, the top goes on over it."""
    problem = load(PROBLEMS / "keyed_shaft.toml")
    shaft, hub = problem.moving.polyhedron, problem.fixed.polyhedron
    pose = Pose(np.array([0.0, 0.0, -1e-3]), np.eye(3))
    kept, limits = cell(near_contacts(shaft, hub, pose, 2e-3, 0.05), shaft, hub, pose, within=2e-3)
    assert np.min(Surfaces.of(kept, shaft, hub).values(pose)) > 0.0
    faces(local_space(kept, shaft, hub, pose, Scale(1e-4, 0.014), ContactCell(limits, 1e-4, 0.002)))


def test_a_space_between_limits_without_extent_is_refused() -> None:
    pose = Pose(np.zeros(3), np.eye(3))
    near = near_contacts(PEG, BLOCK, pose, 3e-4, 0.01)
    limits = [BoundingFunction(near[0], sign) for sign in (1, -1)]
    space = local_space([], PEG, BLOCK, pose, Scale(1e-4, 0.014), ContactCell(limits, 3e-4, 0.01))
    with pytest.raises(InfeasibleError, match=r"no extent between its limits.*not on the end of a face"):
        faces(space)
