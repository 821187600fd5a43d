"""Half-spaces that Qhull finds too nearly degenerate: tried again with wide facets, and else left out and said."""

from typing import Any

import numpy as np
import pytest
import scipy.spatial

from fmopt.certificate.assembly import Assembly
from fmopt.contact.polytope import enumerate_faces
from fmopt.contact.state_graph import Scale
from fmopt.errors import SolverError
from fmopt.planning.robustness.contact_space import space_at
from fmopt.spatial.se3 import Pose
from fmopt.task.problem import load
from tests import PROBLEMS

CUBE = np.vstack([np.eye(4), -np.eye(4)]), -np.ones(8)


@pytest.fixture
def failing(monkeypatch: pytest.MonkeyPatch) -> list[str | None]:
    """Makes Qhull refuse its usual options from four dimensions on, and all when the list says so; gathers them."""
    real, tried = scipy.spatial.HalfspaceIntersection, list[str | None]()

    def hull(half_spaces: Any, interior: Any, qhull_options: str | None = None) -> Any:
        if len(interior) <= 3:
            return real(half_spaces, interior)
        tried.append(qhull_options)
        if qhull_options is None or "all" in tried:
            raise scipy.spatial.QhullError("QH6271 qhull topology error (qh_check_dupridge): wide merge")
        return real(half_spaces, interior, qhull_options=qhull_options)

    monkeypatch.setattr(scipy.spatial, "HalfspaceIntersection", hull)
    return tried


def test_faces_are_the_same_with_wide_facets(failing: list[str | None]) -> None:
    found = enumerate_faces(*CUBE)
    assert len(failing) == 2
    assert sorted(np.bincount(found.dimensions)) == [1, 8, 16, 24, 32]


def test_what_cannot_be_enumerated_is_named(failing: list[str | None]) -> None:
    failing.append("all")
    with pytest.raises(SolverError, match=r"faces of 8 half-spaces could not be enumerated: QH6271"):
        enumerate_faces(*CUBE)


def test_a_space_that_cannot_be_enumerated_is_free_space_and_says_so(failing: list[str | None]) -> None:
    problem = load(PROBLEMS / "square_peg.toml")
    assembly, pose = Assembly(problem.moving, problem.fixed), Pose.from_vector([0.0, 0.0, -0.015, 0.0, 0.0, 0.0])
    scale = Scale(1e-4, 0.0245)
    known = space_at(assembly, "mid-depth", pose, [], scale)
    failing.append("all")
    space = space_at(assembly, "mid-depth", pose, [], scale)
    assert known.enumerated
    assert not space.enumerated
    assert (space.graph.count(), space.graph.space.contacts) == ({6: 1}, known.graph.space.contacts)
