"""Contacts of a plan on its own geometry."""

import numpy as np
import pytest

from fmopt.plan.contact_geometry import Contact
from fmopt.spatial.se3 import Pose


def crossing(beyond: float) -> Contact:
    """An upright edge of the part that crosses an edge of the mouth so far (m) beyond that one's end."""
    upright = np.array([[0.01 + beyond, 0.0, -0.02], [0.01 + beyond, 0.0, 0.02]])
    rim = np.array([[-0.01, 0.0, 0.0], [0.01, 0.0, 0.0]])
    return Contact("e0-e1", "edge-edge", upright, rim, np.zeros(3), np.array([0.0, 1.0, 1.0]))


@pytest.mark.parametrize(("beyond", "within"), [(-1e-3, True), (0.0, True), (1e-9, True), (1e-5, False)])
def test_edges_cross_at_a_corner_whatever_rounding_makes_of_it(beyond: float, within: bool) -> None:
    contact = crossing(beyond)
    assert contact.within(Pose(np.zeros(3), np.eye(3))) is within
    other_way = Contact("e0-e1", "edge-edge", contact.moving[::-1], contact.fixed[::-1], *(np.zeros((2, 3))))
    assert other_way.within(Pose(np.zeros(3), np.eye(3))) is within
