"""Parts with several features: walls, rims and floors in one plane, or as far apart as the pegs, each for its own."""

import math

import numpy as np
import pytest

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.error_set import ErrorSet
from fmopt.contact.facet_bounds import touching
from fmopt.contact.primitive import Kind, PrimitiveContact, feature_distances, near_contacts, vertex_face
from fmopt.planning.moves.contact_transition import described
from fmopt.planning.pipeline import synthesise
from fmopt.planning.search.entry import Approach
from fmopt.planning.search.guarded_move import implied
from fmopt.spatial.se3 import Pose
from fmopt.task.problem import load
from tests import PROBLEMS
from tests.shared.executions.model import execute
from tests.shared.searched import certified_plan, steadier, tilted_motion

SLOT, KEY = load(PROBLEMS / "two_pegs_slot.toml"), load(PROBLEMS / "bilba_puzzle.toml")
ASSEMBLY = Assembly(SLOT.moving, SLOT.fixed)
WAY = Approach(0.349066, 0.194265, 0.014105, 0.000507, (0.003328, 0.004428), (0.001335, 0.00028), heading=-math.pi / 2)
FLUSH = np.array([-1e-4, 1e-4, 0.0])  # against two walls of the hole


def pressed(depth: float) -> tuple[Pose, tuple[PrimitiveContact, ...]]:
    """The parts upright at a depth, against two walls, and all that touches there."""
    body, fixed = ASSEMBLY.moving.polyhedron, ASSEMBLY.fixed.polyhedron
    pose = Pose(FLUSH - np.array([0.0, 0.0, depth]), np.eye(3))
    return pose, touching(near_contacts(body, fixed, pose, 2e-4, 1e-3), body, fixed, pose)


def test_a_plan_for_both_pegs_is_certified_at_errors_of_millimetres() -> None:
    slot = steadier(SLOT)
    motion = tilted_motion(slot, WAY)
    assert motion.placed.margin > 2e-5
    document = certified_plan(slot, motion)
    *_, last = document["segments"]
    made = [contact["id"] for contact in last["contacts"] if contact["role"] == "made"]
    assert len(made) == 8  # all corners of both pegs, on the floors of both holes
    assert len({name.split("-")[1] for name in made}) == 2
    assert execute(document, 20, seed=5).broken == {}


@pytest.mark.wide
def test_pegs_as_far_apart_as_their_holes_are_certified() -> None:
    """Both meet walls along x at once, and errors decide which of them is first."""
    made = synthesise(load(PROBLEMS / "two_pegs.toml"))
    assert made.proved
    assert min(segment["margin"] for segment in made.document["segments"]) > 5e-5
    assert execute(made.document, 20, seed=5).broken == {}


def test_only_walls_that_a_peg_is_before_hold_it() -> None:
    """The walls of both holes in y lie in one plane; a corner 30 mm beside one of them is not on it."""
    body, fixed = ASSEMBLY.moving.polyhedron, ASSEMBLY.fixed.polyhedron
    pose, held = pressed(10e-3)
    assert len({contact.fixed for contact in held if contact.kind is Kind.VERTEX_FACE}) == 3
    found = described(ASSEMBLY, held, pose, pose.moved([0, 0, -1e-3, 0, 0, 0]), ErrorSet.from_box(np.zeros(6)))
    on_walls = [contact for contact in found if contact.kind is Kind.VERTEX_FACE]
    assert len(on_walls) == 6  # two corners of either peg in y, two of the first in x
    assert (feature_distances(found, body, fixed, pose) < 1e-9).all()


def test_edges_on_the_rim_of_one_wall_are_not_lost_to_another_in_its_plane() -> None:
    """One peg leans into its hole along the wall at +y, in whose plane the other hole has one, where nothing is."""
    body, fixed = ASSEMBLY.moving.polyhedron, ASSEMBLY.fixed.polyhedron
    lean = Pose.from_vector([0.0, 0.0, 0.0, 0.0, -0.2, 0.0])
    pose = Pose(np.array([0.0, 5.1e-3, -5e-4]) - lean.apply(np.array([-5e-3, 5e-3, 0.0])), lean.R)
    held = touching(near_contacts(body, fixed, pose, 2e-4, 1e-3), body, fixed, pose)
    assert sorted(contact.kind for contact in held) == [Kind.EDGE_EDGE, Kind.EDGE_EDGE, Kind.VERTEX_FACE]
    for order in (held, held[::-1]):
        assert set(described(ASSEMBLY, order, pose, pose, ErrorSet.from_box(np.zeros(6)))) == set(held)


@pytest.mark.parametrize(("height", "met"), [(-15e-3, True), (0.0, False)])
def test_floors_are_met_at_once_where_they_are_equally_deep(height: float, met: bool) -> None:
    """The floor of one hole, and for the other its floor, or the top as if that were one."""
    fixed, vertices = ASSEMBLY.fixed.polyhedron, ASSEMBLY.moving.polyhedron.vertices
    up = [i for i, face in enumerate(fixed.faces) if face.normal[2] > 0.999]
    floor = next(i for i in up if abs(fixed.faces[i].offset + 15e-3) < 1e-9)
    other = next(i for i in up if abs(fixed.faces[i].offset - height) < 1e-9 and i != floor)
    corners = [int(np.argmin(vertices @ [side, 1.0, 1e3])) for side in (1.0, -1.0)]
    first, second = vertex_face(fixed, corners[0], floor), vertex_face(fixed, corners[1], other)
    assert implied(ASSEMBLY, pressed(10e-3)[1], first, second) == met
    assert not implied(ASSEMBLY, (), first, second)


def test_edges_that_pass_a_rim_on_the_way_do_not_hold_the_part_there() -> None:
    """The inner edges of the key's legs end 20 mm up: on its way down through a frame of 18 mm they leave the rim."""
    assembly, body, fixed = Assembly(KEY.moving, KEY.fixed), KEY.moving.polyhedron, KEY.fixed.polyhedron
    begin, end = (Pose(np.array([-2.5e-4, -5e-4, z]), np.eye(3)) for z in (17e-3, -30e-3))
    held = touching(near_contacts(body, fixed, begin, 2e-4, 1e-3), body, fixed, begin)
    crossing = [contact for contact in held if contact.kind is Kind.EDGE_EDGE]
    assert len(crossing) >= 6
    found = described(assembly, held, begin, end, ErrorSet.from_box(np.zeros(6)))
    for contact in found:
        if contact.kind is Kind.EDGE_EDGE and contact in crossing:
            top = max(body.vertices[i, 2] for i in contact.moving)
            assert top + end.p[2] > 0.0
    assert len([contact for contact in found if contact in crossing]) < len(crossing)
