"""A hole under a funnel: the throat's edges end where the block goes on, so that no contact slips off their ends."""

import numpy as np
import pytest

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.facet_margin import _blocked
from fmopt.planning.pipeline import synthesise
from fmopt.task.problem import load
from tests import ROOT
from tests.shared.executions.model import execute

PROBLEM = load(ROOT / "problems" / "bilba_chamfered_60.toml")
LARGE = 10e-3  # m


def test_a_funnel_is_entered_at_errors_of_millimetres() -> None:
    solved = synthesise(PROBLEM)
    assert solved.document["verdict"] == "CERTIFIED"
    assert solved.verdict.margin is not None
    assert solved.verdict.margin > 2e-4
    assert execute(solved.document, 20, seed=4).broken == {}


def test_beyond_the_ends_of_the_throat_is_the_block() -> None:
    """Told by the part's own vertices: the throat's edges are those at the foot of the funnel, 14 mm down."""
    assembly = Assembly(PROBLEM.moving, PROBLEM.fixed)
    fixed = assembly.fixed.polyhedron
    throat = [i for i, e in enumerate(fixed.edges) if np.abs(fixed.vertices[list(e.vertices), 2] + 14e-3).max() < 1e-9]
    assert len(throat) == 4
    for edge in throat:
        for wall in fixed.edges[edge].faces:
            for _, _, spans in _blocked(assembly, edge, wall):
                assert max(high - low for low, high in spans) > LARGE
                assert min(low for low, _ in spans) < 1e-6


@pytest.mark.parametrize("wall", [0, 1])
def test_beyond_the_ends_of_an_edge_in_the_open_is_nothing(wall: int) -> None:
    assembly = Assembly(PROBLEM.fixed, PROBLEM.moving)  # the peg stands, and the block is put over it
    edges = assembly.fixed.polyhedron.edges
    assert all(not spans for i, e in enumerate(edges) for _, _, spans in _blocked(assembly, i, e.faces[wall]))
