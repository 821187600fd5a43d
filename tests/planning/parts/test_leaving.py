"""A contact that is given up: the chamfered slot at all of its errors, from the search to the check of the plan."""

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from fmopt.certificate.assembly import contact_rows
from fmopt.certificate.propagation import advance
from fmopt.certificate.segment_linearisation import Piece
from fmopt.errors import InfeasibleError
from fmopt.plan import parsed
from fmopt.planning.robustness.error_tolerance import CertifiedMotion
from fmopt.planning.search.entry import planar_entries
from fmopt.report.moves import move_words, moves
from fmopt.task.problem import Problem, load
from fmopt.verify import verify
from tests import ROOT
from tests.shared.executions.model import execute
from tests.shared.lies.mutations import changed
from tests.shared.searched import certified_plan, leaving, motion_from

TILT = 0.8  # of the greatest


@pytest.fixture(scope="module")
def slot() -> Problem:
    return load(ROOT / "problems" / "mit_planar_slot.toml")


@pytest.fixture(scope="module")
def motion(slot: Problem) -> CertifiedMotion:
    most = slot.settings.max_tilt
    rounds = planar_entries(slot.moving, slot.fixed, slot.start_box, slot.approach, most)
    shallow = (entry for entries in rounds for entry in entries if entry.shallow)
    entry = next(e for e in shallow if abs(np.arccos(e.inside.R[0, 0]) - TILT * most) < 1e-9)
    return motion_from(slot, entry)


@pytest.fixture(scope="module")
def plan(slot: Problem, motion: CertifiedMotion) -> dict[str, Any]:
    return certified_plan(slot, motion)


def test_the_corner_is_caught_on_the_chamfer_and_let_go(motion: CertifiedMotion) -> None:
    assert motion.found.names == ("approach", "-x", "leave", "-x", "+ry", "-z")
    assert motion.placed.margin > 1e-4
    caught, free = motion.placed.moves[1], motion.placed.moves[2]
    assert (free.left, free.held) == (caught.making, ())
    # The chamfer takes away what the part's place was uncertain by; what is left comes from its turn.
    before, after = (claim.advance.ends.start_set for claim in motion.placed.reached.claims[1:3])
    assert before.support(np.eye(6)[:1])[0] > 0.03
    assert after.support(np.eye(6)[:1])[0] < 0.003


def test_a_plan_that_gives_up_a_contact_keeps_its_promises(plan: dict[str, Any]) -> None:
    ledger = execute(plan, 100, seed=3)
    assert ledger.broken == {}
    name = plan["segments"][leaving(plan)]["leaving"][0]
    assert (f"{name} not touched again", leaving(plan)) in ledger.least


def test_larger_errors_are_noticed(plan: dict[str, Any]) -> None:
    wide = copy.deepcopy(plan)
    wide["uncertainty"]["start_box"] = [1.5 * x for x in wide["uncertainty"]["start_box"]]
    assert {"tube", "separation"} <= {check for check, _ in execute(wide, 20, seed=3, steps=2).broken}


def test_the_state_after_it_is_a_father_of_the_one_before(plan: dict[str, Any]) -> None:
    visits = plan["description"]["diagnostics"]["sequence"]
    assert [visit["change"] for visit in visits] == ["start", "made", "left", "made", "made"]
    before, after = visits[1:3]
    assert {at for at, _ in before["held_in"]} & {at for at, _ in after["held_in"]}
    assert after["contacts"] == []


def test_in_words(plan: dict[str, Any]) -> None:
    found = parsed(plan)
    (move,) = (m for m in moves(found) if m.left)
    assert move_words(found, move).endswith("away from sloped face f9")


Change = Callable[[dict[str, Any]], Any]


@pytest.mark.parametrize(
    ("offset", "change", "words"),
    [
        (0, lambda s: s.pop("leaving"), "loses v0-f9"),
        (0, lambda s: s.update(leaving=["e3-e18"]), "gives up e3-e18, which was not held"),
        (0, lambda s: s.update(leaving=["v0-f9", "v0-f4"]), "gives up v0-f4, which was not held"),
        (-1, lambda s: s.update(leaving=["v0-f9"]), "must have been held before"),
        (1, lambda s: s.update(leaving=["v0-f9"]), "gives up v0-f9, which was not held"),
        (0, lambda s: s.update(state=["v0-f9"]), "v0-f9"),
        (0, lambda s: s.update(goal_state=["v0-f9"]), "v0-f9"),
    ],
)
def test_what_is_given_up_must_be_said_and_held(plan: dict[str, Any], offset: int, change: Change, words: str) -> None:
    found = verify(changed(plan, lambda copied: change(copied["segments"][leaving(plan) + offset])))
    assert str(found.verdict) == "NOT_PROVED"
    assert any(words in str(finding) for finding in found.findings)


def test_a_way_along_the_chamfer_leaves_nothing(motion: CertifiedMotion) -> None:
    """The control: with the same start, but a way that some errors turn back onto the chamfer."""
    claim = motion.placed.reached.claims[2]
    (contact,) = claim.piece.left
    row = contact_rows(motion.assembly, [contact], (), claim.piece.start).N[0]
    normal, arm = row[:3], row[3:] / motion.tolerance.rho
    error = 1e-3 * (1.0 + np.linalg.norm(arm))
    along = np.array([-normal[2], 0.0, normal[0]])
    for rise, free in ((1e-2, True), (1e-3, False), (-1e-3, False)):
        goal = claim.piece.start.moved(np.append(0.01 * (along + rise * normal), np.zeros(3)))
        piece = Piece(claim.piece.start, goal, (), (), (), None, (0.0, 1.0), (contact,))
        step = advance(motion.assembly, piece, claim.advance.ends.start_set, motion.tolerance)
        assert (step.departure > 0.0) is free
        # The velocity error, a thousandth of the way in translation and in turn, decides; its turn on the vertex's arm
        # does as the errors turn that, too.
        vertex, extent = motion.assembly.moving.polyhedron.vertices[contact.moving[0]], step.ends.extent
        turned = 1e-3 / motion.tolerance.rho * float(np.linalg.norm(vertex)) * extent.theta
        least = 0.01 * (rise - (error + turned) * np.hypot(1.0, rise))
        assert step.departure == pytest.approx(least, abs=1e-12)


def test_a_contact_is_not_given_up_without_what_it_turns_about(motion: CertifiedMotion) -> None:
    last = motion.placed.reached.claims[-1]
    edge, vertex = last.piece.held
    ways = (last.piece.start, last.piece.goal, (vertex,), (vertex,), last.piece.basis[1:], None, (0.0, 1.0))
    piece = Piece(*ways, (edge,))
    with pytest.raises(InfeasibleError, match="cannot be given up without"):
        advance(motion.assembly, piece, last.advance.ends.start_set, motion.tolerance)
