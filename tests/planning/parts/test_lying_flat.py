"""A corner that touches the top before it goes in, alone or with the part laid flat: what that takes away."""

import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fmopt.certificate.contact_implications import coming_off
from fmopt.certificate.facet_margin import bounds
from fmopt.certificate.propagation import advance
from fmopt.certificate.segment_linearisation import Piece
from fmopt.contact.primitive import vertex_face
from fmopt.execution.program import planned
from fmopt.execution.rig import Rig
from fmopt.execution.robot import Robot
from fmopt.execution.rotation import from_quaternions
from fmopt.execution.trials import Trials, run
from fmopt.plan import guarded_moves, parsed
from fmopt.planning.robustness.error_tolerance import CertifiedMotion
from fmopt.planning.search.entry import Approach, tilted_entry
from fmopt.report.moves import move_words, moves
from fmopt.spatial import se3
from fmopt.spatial.se3 import Pose, length
from fmopt.task.problem import Problem, load
from fmopt.task.sizes import measured_clearance
from fmopt.verify import verify
from tests import ROOT
from tests.shared.executions.model import execute
from tests.shared.lies.mutations import changed
from tests.shared.parts.peg_pieces import peg as peg_pieces
from tests.shared.searched import certified_plan, drawn_shapes, leaving, steadier, tilted_motion

SHAPE = Approach(0.352, 0.524, 0.088, 0.00103, (0.00376, 0.00413), flat=(0.00371, 0.00057, 0.151))
TOUCHING = Approach(0.37, 0.52, 0.12, 0.00109, (0.0037, 0.0109), (0.0029, 0.00045))
FLAT = ["v3-f10", "v1-f10", "v2-f10"]


@pytest.fixture(scope="module")
def peg() -> Problem:
    return steadier(load(ROOT / "problems" / "square_peg_100um_2mm.toml"))


@pytest.fixture(scope="module")
def motion(peg: Problem) -> CertifiedMotion:
    return tilted_motion(peg, SHAPE)


@pytest.fixture(scope="module")
def plan(peg: Problem, motion: CertifiedMotion) -> dict[str, Any]:
    return certified_plan(peg, motion)


@pytest.mark.parametrize("name", ["square_peg_100um_2mm", "hexagon_prism", "factory_rect_8mm_tight", "octagon_prism"])
def test_it_leans_on_one_corner_and_lies_on_others_beside_the_mouth(name: str) -> None:
    problem = load(ROOT / "problems" / f"{name}.toml")
    play = measured_clearance(problem).play
    for shape in drawn_shapes(problem, 2, 12):
        entry = tilted_entry(problem.moving, play, problem.approach, shape)
        vertices = problem.moving.polyhedron.vertices
        heights = entry.start.apply(vertices)[:, 2]
        assert heights.min() == pytest.approx(problem.approach)
        assert entry.start.apply(entry.leant.edge[0])[2] == pytest.approx(problem.approach)
        # No error of rotation makes another corner the lowest.
        swing = np.linalg.norm(problem.start_box[3:])
        others = vertices[(vertices[:, 2] == 0.0) & (np.linalg.norm(vertices - entry.leant.edge[0], axis=1) > 1e-9)]
        arms = np.linalg.norm(others - entry.leant.edge[0], axis=1)
        assert (entry.start.apply(others)[:, 2] - problem.approach > swing * arms).all()
        assert entry.over.apply(entry.corner)[2] > 0.0


def test_lying_flat_takes_height_and_tilt_away(peg: Problem, motion: CertifiedMotion) -> None:
    assert motion.found.names[:6] == ("approach", "edge", "face", "leave", "tilt", "enter")
    assert motion.placed.margin > 8e-5
    stages = {move.making[0].id: n for n, move in enumerate(motion.placed.moves[:3])}
    assert list(stages) == FLAT
    claims = motion.placed.reached.claims
    number, off = next((n, claim) for n, claim in enumerate(claims) if claim.piece.left)
    assert [contact.id for contact in off.piece.left] == FLAT
    spread = off.advance.ends.start_set.support(np.eye(6))
    # What is left comes from the yaw error alone, of second order in it and the lean.
    assert (spread[2:5] < [1e-5, 1e-3, 1e-3]).all()
    assert (spread[[0, 1, 5]] > peg.start_box[[0, 1, 5]]).all()
    inside = next(claim for claim in claims[number:] if claim.piece.held).advance.ends.start_set.support(np.eye(6))
    assert (inside[3:5] < 0.6 * peg.start_box[3:5]).all()


def test_touching_with_one_corner_leaves_the_tilt(peg: Problem, motion: CertifiedMotion) -> None:
    """The control: the same way in, with the leading corner touching the top by itself."""
    other = tilted_motion(peg, replace(SHAPE, flat=None, touch=(0.0026, 0.0005)))
    spread = next(claim for claim in other.placed.reached.claims if claim.piece.held).advance.ends.start_set
    assert (spread.support(np.eye(6))[3:5] > peg.start_box[3:5]).all()
    assert other.placed.margin < motion.placed.margin


def test_touching_with_one_corner_takes_the_height_away(peg: Problem) -> None:
    touching = tilted_motion(peg, TOUCHING)
    assert touching.found.names[:3] == ("approach", "leave", "enter")
    assert touching.placed.margin > 2e-5
    touched, lifted, _ = touching.placed.moves[:3]
    assert lifted.left == touched.making
    corner = touching.assembly.moving.polyhedron.vertices[touched.making[0].moving[0]]
    before, after = (touching.placed.reached.claims[k].advance.ends for k in (0, 2))
    row = np.array([0.0, 0.0, 1.0, *np.cross(before.start.R @ corner, [0.0, 0.0, 1.0])])
    assert before.start_set.support(row) > 5e-4
    assert after.goal_set.support(row) < 3e-4
    found = certified_plan(peg, touching)
    assert execute(found, 40, seed=5).broken == {}
    changes = [visit["change"] for visit in found["description"]["diagnostics"]["sequence"]]
    assert changes[:3] == ["start", "made", "left"]
    assert "unexplained" not in changes


def test_its_plan_keeps_its_promises(plan: dict[str, Any]) -> None:
    ledger = execute(plan, 100, seed=3)
    assert ledger.broken == {}
    for name in FLAT:
        assert (f"{name} not touched again", leaving(plan)) in ledger.least


@pytest.mark.wide
def test_the_engine_carries_it_out_with_the_contacts_of_the_plan(plan: dict[str, Any]) -> None:
    """Flat on the top, the part presses on it anywhere between its corners."""
    found = run(parsed(plan), Trials(6, seed=11), range(6))
    assert [trial["reasons"] for trial in found] == [[]] * 6
    assert [trial["departures"] for trial in found] == [[]] * 6


def test_a_turn_in_many_pieces_goes_as_far_as_it_is_to(plan: dict[str, Any], motion: CertifiedMotion) -> None:
    """What a piece goes too far by, the next one does less."""
    number = motion.found.names.index("tilt")
    rows = [row for row in plan["segments"] if row["move"] == number]
    assert len(rows) > 5
    begun, ended = Pose.from_vector(rows[0]["start"]), Pose.from_vector(rows[-1]["goal"])
    seen: list[Pose] = []

    def look(rig: Rig) -> None:
        step = int(rig.state.step[0])
        if step >= 0 and rig.program.steps[step].move in (number, number + 1):
            seen.append(Pose(rig.qpos[0, :3], from_quaternions(rig.qpos[0, 3:])))

    run(parsed(plan), Trials(1, seed=1), [0], look=look)
    turned = length(se3.log(seen[-1].R @ seen[0].R.T))
    assert turned == pytest.approx(length(se3.log(ended.R @ begun.R.T)), abs=1e-3)


def test_a_touch_has_way_enough_to_be_felt(plan: dict[str, Any]) -> None:
    """Where errors use all of a move's travel up, the servo's spring still has to give way until the force is there."""
    robot = Robot()
    for step, move in zip(planned(parsed(plan), robot).steps, guarded_moves.moves(parsed(plan)), strict=True):
        if move.stop is not None and move.last:
            assert step.travel == pytest.approx(move.stop.max_travel + 2.0 * move.stop.force / robot.stiffness)
        elif move.stop is None:
            assert step.travel == move.length


def test_in_words(plan: dict[str, Any]) -> None:
    found = parsed(plan)
    words = [move_words(found, move) for move in moves(found)[:5]]
    assert words[0].endswith("until leading corner v3 touches top face f10 (z = 0 mm)")
    assert words[1].startswith("turn ")
    assert words[3].endswith("in +z away from top face f10")
    assert words[4].startswith("turn ")


def test_larger_errors_are_noticed(plan: dict[str, Any]) -> None:
    wide = copy.deepcopy(plan)
    wide["uncertainty"]["start_box"] = [2.0 * x for x in wide["uncertainty"]["start_box"]]
    assert {"tube", "separation"} <= {check for check, _ in execute(wide, 20, seed=3, steps=2).broken}


def test_a_corner_over_the_mouth_comes_off_with_the_others(motion: CertifiedMotion) -> None:
    claim = next(claim for claim in motion.placed.reached.claims if claim.piece.left)
    (wall,) = coming_off(motion.assembly, claim.piece.held, claim.piece.left)
    assert (wall.normal.tolist(), sorted(wall.points)) == ([0.0, 0.0, 1.0], [0, 1, 2, 3])
    assert claim.advance.departure > 0.0


def test_a_corner_over_the_mouth_must_not_fall_while_the_others_rise(motion: CertifiedMotion) -> None:
    """The control: all three contacts open, and the fourth corner of the face goes down into the mouth."""
    claim = next(claim for claim in motion.placed.reached.claims if claim.piece.left)
    start, left = claim.piece.start, claim.piece.left
    body = motion.assembly.moving.polyhedron.vertices
    over, opposite = body[0], body[3]
    diagonal = start.R @ np.cross([0.0, 0.0, 1.0], opposite - over)
    for turn, free in ((0.0, True), (-1e-2, False), (1e-2, False)):
        rise, axis = 1e-4, turn * diagonal / np.linalg.norm(diagonal)
        goal = start.moved(np.concatenate([[0.0, 0.0, rise], axis]))
        heights = [float(goal.apply(body[i])[2]) for i in (1, 2)]
        assert min(heights) > 0.9 * rise
        piece = Piece(start, goal, (), (), (), None, (0.0, 1.0), left)
        step = advance(motion.assembly, piece, claim.advance.ends.start_set, motion.tolerance)
        assert (step.departure > 0.0) is free
        assert turn == 0.0 or (goal.apply(over if turn < 0.0 else opposite)[2] < 0.0)


@pytest.mark.parametrize(
    ("leaves", "words"), [(FLAT[:2], "loses v2-f10"), (["v0-f2", *FLAT], "gives up v0-f2, which was not held")]
)
def test_all_that_it_lies_on_has_to_be_given_up(plan: dict[str, Any], leaves: list[str], words: str) -> None:
    found = verify(changed(plan, lambda copied: copied["segments"][leaving(plan)].update(leaving=leaves)))
    assert str(found.verdict) == "NOT_PROVED"
    assert any(words in str(finding) for finding in found.findings)


def test_what_touches_first_touches_outside_the_mouth(peg: Problem) -> None:
    play = measured_clearance(peg).play
    mouth = 0.5 * (0.02 + play[0])
    for shape in drawn_shapes(peg, 1, 24):
        entry = tilted_entry(peg.moving, play, peg.approach, shape)
        at, over = entry.start.apply(entry.corner), entry.over.apply(entry.corner)
        assert np.abs(at[:2]).max() == pytest.approx(mouth + shape.touch[0], abs=1e-9)
        assert shape.touch[0] > peg.start_box[0]
        assert over[2] == pytest.approx(shape.touch[1])


def test_a_vertex_on_a_face_with_a_hole_keeps_beyond_one_edge_of_it() -> None:
    assembly = peg_pieces().assembly
    fixed, v = assembly.fixed.polyhedron, assembly.moving.polyhedron.vertices[0]
    top = next(n for n, face in enumerate(fixed.faces) if len(face.loops) > 1)
    contact = vertex_face(fixed, 0, top)
    right = float(fixed.vertices[list(fixed.faces[top].loops[1])][:, 0].max())
    table = bounds(assembly, (contact,), (contact,))
    for beyond in (2e-3, 0.0, -1e-3):
        pose = Pose(np.array([right + beyond, 0.0, 0.0]) - v, np.eye(3))
        (margin,) = table.margins(table.forms.at(pose).f)
        assert margin == pytest.approx(beyond, abs=1e-12)
