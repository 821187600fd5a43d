"""C-surfaces and contact states of the square peg: built, evaluated, enumerated."""

from __future__ import annotations

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture
from test_contact_cell import POSES
from test_contact_parts import MID_DEPTH, block, peg

from fmopt.contact import surface
from fmopt.contact.bounds import cell
from fmopt.contact.confirm import confirm
from fmopt.contact.graph import contact_graph
from fmopt.contact.primitive import near_contacts
from fmopt.contact.space import LocalSpace, faces, local_space

PEG, BLOCK = peg(), block()
CLEARANCE, RHO = 1e-4, 0.5 * np.hypot(0.02, 0.02)
CONTACTS = near_contacts(PEG, BLOCK, MID_DEPTH, reach=1e-3, angle=0.02)


def mid_depth() -> LocalSpace:
    return local_space(CONTACTS, PEG, BLOCK, MID_DEPTH, CLEARANCE, RHO)


def mouth() -> LocalSpace:
    """A tilted corner of the tip in a corner of the mouth, with the bounds of its contacts."""
    pose, reach, angle, _ = POSES["corner in the mouth"]
    kept, limits = cell(near_contacts(PEG, BLOCK, pose, reach, angle), PEG, BLOCK, pose, within=1e-3)
    return local_space(kept, PEG, BLOCK, pose, CLEARANCE, RHO, limits, reach, angle)


@pytest.mark.benchmark(group="16 C-surfaces")
def test_symbolic_from_nothing(benchmark: BenchmarkFixture) -> None:
    def build() -> object:
        for kept in (surface.symbolic_surface, surface.pose_function, surface.kind_function):
            kept.cache_clear()
        return surface.surfaces_function([contact.kind for contact in CONTACTS])

    assert benchmark.pedantic(build, rounds=5) is not None


@pytest.mark.benchmark(group="16 C-surfaces")
def test_symbolic_of_known_kinds(benchmark: BenchmarkFixture) -> None:
    kinds = [contact.kind for contact in CONTACTS]
    surface.surfaces_function(kinds)
    assert benchmark(surface.surfaces_function, kinds) is not None


@pytest.mark.benchmark(group="16 C-surfaces")
def test_numeric_table(benchmark: BenchmarkFixture) -> None:
    assert benchmark(surface.Surfaces.of, CONTACTS, PEG, BLOCK) is not None


@pytest.mark.benchmark(group="16 C-surfaces")
def test_values_and_gradients(benchmark: BenchmarkFixture) -> None:
    f, N = benchmark(surface.Surfaces.of(CONTACTS, PEG, BLOCK).values_and_rows, MID_DEPTH)
    assert f.shape == (16,)
    assert N.shape == (16, 6)


@pytest.mark.benchmark(group="contact states")
def test_mid_depth_states(benchmark: BenchmarkFixture) -> None:
    space = mid_depth()
    assert len(benchmark(lambda: contact_graph(space, faces(space))).states) == 243


@pytest.mark.benchmark(group="contact states")
def test_mouth_states(benchmark: BenchmarkFixture) -> None:
    space = mouth()
    assert len(benchmark(lambda: contact_graph(space, faces(space))).states) > 1


@pytest.mark.benchmark(group="contact states")
def test_mid_depth_states_confirmed(benchmark: BenchmarkFixture) -> None:
    space = mid_depth()
    graph = contact_graph(space, faces(space))
    assert len(benchmark.pedantic(confirm, (graph, PEG, BLOCK), rounds=3)) == 243
