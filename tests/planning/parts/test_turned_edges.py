"""An edge in one wall beside a face flush to another: what it says of the rotation, and a plan that needs it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.contact_implications import aligned, facts, rising
from fmopt.contact.primitive import PrimitiveContact, near_contacts
from fmopt.planning.pipeline import proved
from fmopt.planning.search.entry import Approach
from fmopt.spatial import se3
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array
from fmopt.task.problem import Problem, load
from fmopt.task.sizes import measured_clearance
from fmopt.verify.arithmetic.rational import ONE, vector
from fmopt.verify.certificate.contact_implications import CheckedFacts
from fmopt.verify.parts.incidence import Turn
from tests import ROOT
from tests.shared.executions.model import execute
from tests.shared.searched import steadier, tilted_motion

SHAPE = Approach(0.4363, 0.2094, 0.0463, 0.000867, (0.00454, 0.00562), (0.0019, 0.000387))


@pytest.fixture(scope="module")
def hexagon() -> Problem:
    return load(ROOT / "problems" / "hexagon_prism.toml")


@pytest.fixture(scope="module")
def assembly(hexagon: Problem) -> Assembly:
    return Assembly(hexagon.moving, hexagon.fixed)


@pytest.fixture(scope="module")
def touching(hexagon: Problem, assembly: Assembly) -> dict[str, PrimitiveContact]:
    """The contacts of the prism, upright, 10 mm deep in a corner of the hole between the walls at −x and −y."""
    play = np.array(measured_clearance(hexagon).play)
    wall = next(f for f in assembly.fixed.polyhedron.faces if f.normal[0] > 0.4 and f.normal[1] > 0.8)
    x = -0.5 * play[0]
    face = next(f for f in assembly.moving.polyhedron.faces if np.allclose(f.normal, -wall.normal, atol=1e-9))
    y = (wall.offset + face.offset - wall.normal[0] * x) / wall.normal[1]
    pose = Pose(np.array([x, y, -0.01]), np.eye(3))
    near = near_contacts(assembly.moving.polyhedron, assembly.fixed.polyhedron, pose, 1e-6, 1e-3)
    return {c.id: c for c in near}


def test_an_edge_beside_a_flush_face_fixes_rotation(assembly: Assembly, touching: dict[str, PrimitiveContact]) -> None:
    flush = [touching[name] for name in ("v0-f3", "v2-f3", "e2-e23")]
    line = [touching[name] for name in ("e4-e22", "v1-f2")]
    assert aligned(facts(assembly, tuple(flush)).turns, np.array([0.0, 0.3, 0.7])) is None
    known = facts(assembly, (*flush, *line))
    np.testing.assert_allclose(aligned(known.turns, np.array([0.1, 0.3, 0.7])), [0.1, 0.3, 0.7], atol=1e-12)
    wall = assembly.fixed.polyhedron.faces[touching["v1-f2"].fixed_feature]
    assert len(known.on(wall.normal, wall.offset).points) == 4


def directions() -> st.SearchStrategy[Array]:
    entry = st.floats(-1.0, 1.0)
    vectors = st.tuples(entry, entry, entry).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.1)
    return vectors.map(lambda v: v / np.linalg.norm(v))


def turn_between(a: Array, b: Array) -> Array:
    axis = np.cross(a, b)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-9:
        return np.eye(3)
    return se3.exp(np.arctan2(sine, float(a @ b)) * axis / sine)


@settings(deadline=None, max_examples=60)
@given(directions(), directions(), directions(), st.integers(0, 10**6))
def test_what_rises_does_so_however_the_part_is_turned(n: Array, w: Array, normal: Array, seed: int) -> None:
    rng = np.random.default_rng(seed)
    if n @ w < -0.99:
        w = n
    vectors = rng.normal(size=(40, 3))
    found = rising([(n, w)], normal, vectors)
    first = turn_between(n, w)
    heights = np.array([(vectors @ first.T @ se3.exp(turn * w).T) @ normal for turn in np.linspace(0, 2 * np.pi, 400)])
    assert (heights[:, found] >= -1e-9).all()
    # The others fall somewhere on the way round.
    assert (heights[:, ~found].min(axis=0) < 1e-3).all()


@settings(deadline=None, max_examples=60)
@given(directions(), directions(), directions(), st.integers(0, 10**6))
def test_the_check_knows_the_same(n: Array, w: Array, normal: Array, seed: int) -> None:
    known = CheckedFacts.__new__(CheckedFacts)
    known.turns, known._wholes = [Turn(vector(n), vector(w), vector(n), vector(w), None)], (1, None)
    vectors = np.random.default_rng(seed).normal(size=(40, 3))
    found = rising([(n, w)], normal, vectors)
    assert [known.rises(vector(normal), vector(v)) for v in vectors] == found.tolist()
    assert known.rises(vector(w), vector(n))
    assert not known.rises(vector(-w), (ONE, 0, 0)) or abs(float(n[0])) < 1e-9 or n[0] < 0.0


def test_a_hexagonal_prism_is_certified_at_errors_of_millimetres(hexagon: Problem) -> None:
    hexagon = steadier(hexagon)
    motion = tilted_motion(hexagon, SHAPE)
    assert motion.placed.margin > 5e-5
    document, verdict = proved(hexagon, motion)
    assert str(verdict.verdict) == "CERTIFIED"
    assert execute(document, 20, seed=3).broken == {}
