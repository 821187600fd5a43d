"""Contacts between a square peg and a block, found by hand and counted."""

import numpy as np
import pytest

from fmopt.contact.primitive import Kind, convex_vertices, near_contacts
from fmopt.geometry.polyhedron import from_faces
from fmopt.spatial.se3 import Pose
from tests.shared.parts.square import MID_DEPTH, block, peg, spike, tilted


def test_parts() -> None:
    assert peg().volume == pytest.approx(0.02**2 * 0.04)
    assert block().volume == pytest.approx(0.06**2 * 0.04 - 0.0202**2 * 0.03)


def test_only_vertices_of_the_block_outside_the_hole_are_convex() -> None:
    assert convex_vertices(block()) == set(range(8))


def test_mid_depth_square_peg_has_sixteen_contacts() -> None:
    contacts = near_contacts(peg(), block(), MID_DEPTH, reach=1e-3, angle=0.02)
    kinds = [contact.kind for contact in contacts]
    assert len(contacts) == 16
    assert (kinds.count(Kind.VERTEX_FACE), kinds.count(Kind.EDGE_EDGE)) == (8, 8)
    assert len({contact.id for contact in contacts}) == 16


def test_tilted_peg_meets_each_mouth_edge_on_one_side_only() -> None:
    # Turned about y by 3°, the upper side leans to +x: no tip vertex can touch that wall, the upright edges can.
    contacts = near_contacts(peg(), block(), tilted((0.0, np.radians(3.0), 0.0)), reach=2e-4, angle=0.0)
    mouth = {e: block().edges[e] for e in range(len(block().edges))}
    right = [c for c in contacts if c.kind is Kind.EDGE_EDGE and set(mouth[c.fixed_feature].vertices) == {13, 14}]
    wall = [c for c in contacts if c.kind is Kind.VERTEX_FACE and block().faces[c.fixed_feature].normal[0] == -1.0]
    assert wall == []
    assert {c.moving for c in right} <= {(1, 5), (5, 1), (2, 6), (6, 2)}


def test_parallel_edges_are_no_contact() -> None:
    # Resting on the mouth at no tilt, tip edges and the mouth edges below them are parallel.
    contacts = near_contacts(peg(), block(), Pose(np.zeros(3), np.eye(3)), reach=1e-3, angle=0.01)
    for contact in contacts:
        if contact.kind is Kind.EDGE_EDGE:
            a, b = peg().vertices[list(contact.moving)]
            q, r = block().vertices[list(contact.fixed)]
            assert abs((b - a) @ (r - q)) < 1e-12


def test_a_fixed_spike_meets_a_moving_face() -> None:
    floor = from_faces(*spike())
    contacts = near_contacts(peg(), floor, Pose(np.array([0.0, 0.0, 1e-4]), np.eye(3)), reach=5e-4, angle=0.01)
    assert [(c.kind, c.moving_feature) for c in contacts] == [(Kind.FACE_VERTEX, 0)]
