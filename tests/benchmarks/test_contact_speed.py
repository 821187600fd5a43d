"""C-surfaces and contact states of the square peg: built, evaluated, enumerated."""

from __future__ import annotations

from inspect import unwrap

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture
from scipy.spatial import ConvexHull

from fmopt.contact import c_surface as surface
from fmopt.contact.definitions import CONTACTS as KINDS
from fmopt.contact.derive import derived
from fmopt.contact.facet_bounds import cell
from fmopt.contact.polytope import enumerate_faces
from fmopt.contact.primitive import near_contacts
from fmopt.contact.state_graph import Cell, LocalSpace, Scale, contact_graph, faces, local_space
from fmopt.planning.robustness.contact_space import confirm
from fmopt.spatial.values import Array
from tests.shared.parts.square import MID_DEPTH, block, peg
from tests.shared.parts.square_poses import POSES

PEG, BLOCK = peg(), block()
CLEARANCE, RHO = 1e-4, 0.5 * np.hypot(0.02, 0.02)
SPACES = (20, 40, 80)
CONTACTS = near_contacts(PEG, BLOCK, MID_DEPTH, reach=1e-3, angle=0.02)


def mid_depth() -> LocalSpace:
    return local_space(CONTACTS, PEG, BLOCK, MID_DEPTH, Scale(CLEARANCE, RHO))


def mouth() -> LocalSpace:
    """A tilted corner of the tip in a corner of the mouth, with the bounds of its contacts."""
    pose, reach, angle, _ = POSES["corner in the mouth"]
    kept, limits = cell(near_contacts(PEG, BLOCK, pose, reach, angle), PEG, BLOCK, pose, within=1e-3)
    return local_space(kept, PEG, BLOCK, pose, Scale(CLEARANCE, RHO), Cell(limits, reach, angle))


@pytest.mark.benchmark(group="16 C-surfaces")
def test_symbolic_from_nothing(benchmark: BenchmarkFixture) -> None:
    def build() -> object:
        derived.cache_clear()
        return [derived(name) for name in KINDS]

    assert benchmark.pedantic(build, rounds=5) is not None


@pytest.mark.benchmark(group="16 C-surfaces")
def test_numeric_table(benchmark: BenchmarkFixture) -> None:
    assert benchmark(unwrap(surface._surfaces), PEG, BLOCK, CONTACTS) is not None


@pytest.mark.benchmark(group="16 C-surfaces")
def test_values_and_gradients(benchmark: BenchmarkFixture) -> None:
    f, N = benchmark(surface.Surfaces.of(CONTACTS, PEG, BLOCK).values_and_rows, MID_DEPTH)
    assert f.shape == (16,)
    assert N.shape == (16, 6)


def dual_points(normals: Array, offsets: Array) -> Array:
    """What Qhull is given for half-spaces around the origin, the origin among the points."""
    points = np.vstack([normals / -offsets[:, None], np.zeros(normals.shape[1])])
    assert (offsets < 0.0).all()
    return np.asarray(points)


@pytest.mark.benchmark(group="contact states of the square peg at mid-depth")
def test_mid_depth_hull_alone(benchmark: BenchmarkFixture) -> None:
    space = mid_depth()
    axes = np.linalg.svd(space.normals)[2][:5].T  # free to slide, so that five dimensions count
    points = dual_points(space.normals @ axes, space.offsets)
    assert len(benchmark(ConvexHull, points).equations)


@pytest.mark.benchmark(group="contact states of the square peg at mid-depth")
def test_mid_depth_faces(benchmark: BenchmarkFixture) -> None:
    assert len(benchmark(faces, mid_depth()).points) == 243


@pytest.mark.benchmark(group="contact states of the square peg at mid-depth")
def test_mid_depth_faces_and_graph(benchmark: BenchmarkFixture) -> None:
    space = mid_depth()
    assert len(benchmark(lambda: contact_graph(space, faces(space))).states) == 243


def half_spaces(count: int) -> Array:
    """Unit normals (count, 6) of half-spaces that touch the unit ball, in general position."""
    normals = np.random.default_rng(1).normal(size=(count, 6))
    return np.asarray(normals / np.linalg.norm(normals, axis=1)[:, None])


@pytest.mark.parametrize("count", SPACES)
def test_hull_alone(benchmark: BenchmarkFixture, count: int) -> None:
    benchmark.group = f"{count} half-spaces in six dimensions"
    assert len(benchmark(ConvexHull, half_spaces(count)).equations) > count


@pytest.mark.parametrize("count", SPACES)
def test_all_faces(benchmark: BenchmarkFixture, count: int) -> None:
    benchmark.group = f"{count} half-spaces in six dimensions"
    found = benchmark(enumerate_faces, half_spaces(count), -np.ones(count))
    assert found.count()[5] == count
    assert sum((-1) ** dimension * number for dimension, number in found.count().items()) == 1  # Euler


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
