"""A corner that touches the top beside the mouth first: errors many times the clearance, from search to check."""

from typing import Any

import numpy as np
import pytest

from fmopt.certificate.facet_margin import bounds
from fmopt.contact.primitive import vertex_face
from fmopt.planning.robustness.error_tolerance import CertifiedMotion
from fmopt.planning.search.entry import Shape, tilted_entry
from fmopt.spatial.se3 import Pose
from fmopt.task.problem import Problem, load
from fmopt.task.sizes import measured_clearance
from tests import ROOT
from tests.shared.executions.model import execute
from tests.shared.parts.peg_pieces import peg
from tests.shared.searched import certified_plan, drawn_shapes, steadier, tilted_motion

SHAPE = Shape(0.37, 0.52, 0.12, 0.00109, (0.0037, 0.0109), (0.0029, 0.00045))


@pytest.fixture(scope="module")
def problem() -> Problem:
    return steadier(load(ROOT / "problems" / "square_peg_100um_2mm.toml"))


@pytest.fixture(scope="module")
def motion(problem: Problem) -> CertifiedMotion:
    return tilted_motion(problem, SHAPE)


@pytest.fixture(scope="module")
def plan(problem: Problem, motion: CertifiedMotion) -> dict[str, Any]:
    return certified_plan(problem, motion)


def test_the_touch_takes_the_height_away(motion: CertifiedMotion) -> None:
    assert motion.found.names[:3] == ("approach", "leave", "enter")
    assert motion.placed.margin > 2e-5
    touched, lifted, _ = motion.placed.moves[:3]
    assert lifted.left == touched.making
    (contact,) = touched.making
    corner = motion.assembly.moving.polyhedron.vertices[contact.moving[0]]
    before, after = (claim.advance.ends for claim in (motion.placed.reached.claims[0], motion.placed.reached.claims[2]))
    row = np.array([0.0, 0.0, 1.0, *np.cross(before.start.R @ corner, [0.0, 0.0, 1.0])])
    assert before.start_set.support(row) > 5e-4
    assert after.goal_set.support(row) < 3e-4


def test_all_executions_keep_the_plan_s_promises(plan: dict[str, Any]) -> None:
    assert execute(plan, 40, seed=5).broken == {}


def test_the_sequence_of_states_is_explained(plan: dict[str, Any]) -> None:
    changes = [visit["change"] for visit in plan["description"]["diagnostics"]["sequence"]]
    assert changes[:3] == ["start", "made", "left"]
    assert "unexplained" not in changes


def test_what_touches_first_touches_outside_the_mouth(problem: Problem) -> None:
    play = measured_clearance(problem).play
    mouth = 0.5 * (0.02 + play[0])
    for shape in drawn_shapes(problem, 1, 24):
        entry = tilted_entry(problem.moving, play, problem.approach, shape)
        at, over = entry.start.apply(entry.corner), entry.over.apply(entry.corner)
        assert np.abs(at[:2]).max() == pytest.approx(mouth + shape.touch[0], abs=1e-9)
        assert shape.touch[0] > problem.start_box[0]
        assert over[2] == pytest.approx(shape.touch[1])


def test_a_vertex_on_a_face_with_a_hole_keeps_beyond_one_edge_of_it() -> None:
    assembly = peg().assembly
    top = next(n for n, face in enumerate(assembly.fixed.polyhedron.faces) if len(face.loops) > 1)
    contact = vertex_face(assembly.fixed.polyhedron, 0, top)
    face = assembly.fixed.polyhedron.faces[top]
    hole = assembly.fixed.polyhedron.vertices[list(face.loops[1])]
    right = float(hole[:, 0].max())
    table = bounds(assembly, (contact,), (contact,))
    v = assembly.moving.polyhedron.vertices[0]
    for beyond in (2e-3, 0.0, -1e-3):
        pose = Pose(np.array([right + beyond, 0.0, 0.0]) - v, np.eye(3))
        (margin,) = table.margins(table.forms.at(pose).f)
        assert margin == pytest.approx(beyond, abs=1e-12)
