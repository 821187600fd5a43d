"""Planar problem files: what they mean, what they may not say, and plans for a share of the start errors."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fmopt.contact.c_surface import Surfaces
from fmopt.contact.primitive import Kind, vertex_face
from fmopt.errors import InputError, SearchError
from fmopt.planning import pipeline
from fmopt.planning.control.controlled_motion import _touching
from fmopt.planning.moves.moves import Move, Reached
from fmopt.planning.optimise.bisection import ATTEMPTS, largest_share
from fmopt.planning.placement.sequence_program import Placed, certified
from fmopt.planning.posed import FINE
from fmopt.planning.search.best_first import best_sequences, search
from fmopt.planning.search.entry import Entry, planar_entries
from fmopt.planning.search.entry_room import roomy_in_plane
from fmopt.planning.search.guarded_move import IN_PLANE, freedoms
from fmopt.planning.search.successors import SearchTask
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array
from fmopt.task.explain import explain, facts
from fmopt.task.problem import Problem, load
from fmopt.task.sizes import measured_clearance
from fmopt.verify.findings import NOT_PROVED, Verdict
from tests import ROOT
from tests.shared.files.shipped import copied, edit
from tests.shared.plans.report_plans import diagnostics
from tests.shared.searched import task_of

BOX = '[solids.a]\nshape = "box"\nsize = [1, 1, 1]\n'
NAMES = ("problems/mit_planar_slot.toml", "models/mit_planar_slot.toml", "models/mit_planar_peg.toml")


@pytest.fixture(scope="module")
def slot() -> Problem:
    return load(ROOT / NAMES[0])


def searched(slot: Problem, box: Array) -> tuple[SearchTask, Iterator[tuple[Entry, ...]]]:
    """The search for start errors, and the ways to begin that leave room for them, or for small ones for some more."""
    task, roomy = task_of(replace(slot, start_box=box)), roomy_in_plane(measured_clearance(slot).per_side, box)
    return task, planar_entries(slot.moving, slot.fixed, roomy, slot.approach, slot.settings.max_tilt)


def thoroughly(task: SearchTask, moves: Sequence[Move]) -> Placed:
    return certified(task.assembly, moves, Reached(task.start, (), ()), task.tolerance, FINE)


def test_the_slot_in_numbers(slot: Problem) -> None:
    np.testing.assert_allclose(slot.start_box, [0.03, 0.0, 0.0, 0.0, 0.09, 0.0], rtol=1e-15)
    np.testing.assert_allclose(np.ptp(slot.plane.moving, axis=0), [0.062, 0.2])
    corners = np.vstack(slot.plane.fixed)
    inner = np.unique(np.round(np.abs(corners[:, 0]), 9))
    assert inner == pytest.approx([0.031509, 0.055509, 0.148509])
    # A chamfer of 24 mm at 45 degrees on each side of the mouth.
    levels = {round(float(x), 6): float(z) for x, z in np.abs(corners) if z < 0.1}
    assert (levels[0.055509], levels[0.031509]) == (0.0, pytest.approx(0.024))
    clearance = measured_clearance(slot)
    assert clearance.per_side == pytest.approx(0.000509, rel=1e-9)
    assert clearance.play[0] == pytest.approx(0.001018, rel=1e-9)
    assert math.isinf(clearance.play[1])


@pytest.mark.parametrize(
    ("file", "old", "new", "code", "words"),
    [
        (NAMES[0], "z = 0\n", "z = 0\ny = 0.1\n", "out-of-plane", "'y' leaves the plane"),
        (NAMES[0], "z = 0\n", "z = 0\nrz = 0.1\n", "out-of-plane", "'rz' leaves the plane"),
        (NAMES[0], "x = 0.509", "x = 0.509\ny = 1", "out-of-plane", "'y' leaves the plane"),
        (NAMES[0], "mit_planar_peg.toml", "square_peg.toml", "conflict", "the fixed part is a profile"),
        (NAMES[1], "through = true", "through = true\nturn = [0, 5, 0]", "bad-value", "is turned, or beside the plane"),
        (NAMES[2], '[["-width/2", 0], ["width/2", 0]', '[["width/2", 0], ["-width/2", 0]', "geometry", "turn left"),
        (NAMES[2], "[[[", "[[[0, 0], [1, 0], [0, 1]], [[", "not-supported", "one convex polygon"),
        (NAMES[2], "[features.peg]", 'part = "x"\n[features.peg]', "unknown-key", "there is no such key"),
        (NAMES[2], "[profile]", '[solids.a]\nshape = "torus"\n[profile]', "unknown-choice", "no shape 'torus'"),
        (NAMES[2], "[profile]", f"{BOX}[profile]", "conflict", "both solids and a profile"),
    ],
)
def test_faults_of_planar_problems(tmp_path: Path, file: str, old: str, new: str, code: str, words: str) -> None:
    copied(tmp_path)
    edit(tmp_path / file, old, new)
    with pytest.raises(InputError) as caught:
        load(tmp_path / NAMES[0])
    found = caught.value.faults
    assert any(fault.code == code and words in str(fault) and fault.file.endswith(file) for fault in found)
    assert all(fault.line > 0 and fault.advice for fault in found)


def test_sources_stay_in_the_plane(tmp_path: Path) -> None:
    text = (ROOT / NAMES[0]).read_text(encoding="utf-8")
    start, end = text.index("[uncertainty.start]"), text.index("[uncertainty.velocity]")
    sources = "[uncertainty.sources]\nrobot = { position = 1, angle = 0.01 }\ngrasp = { height = 100 }\n\n"
    copied(tmp_path)
    (tmp_path / NAMES[0]).write_text(text[:start] + sources + text[end:], encoding="utf-8")
    problem = load(tmp_path / NAMES[0])
    assert problem.start_box[0] > 2e-3
    assert problem.start_box[4] == pytest.approx(0.02)
    assert not problem.start_box[[1, 3, 5]].any()
    assert sum(share.box for share in problem.budget) == pytest.approx(problem.start_box)


def test_the_slot_in_words(slot: Problem) -> None:
    clearance = measured_clearance(slot)
    words = explain(slot, clearance)
    assert "error as stated: +-30, 0 mm along x, z; +-5.15662 deg about y, none out of the plane" in words
    assert "declared on each side: 0.509 mm along x\n" in words
    assert facts(slot, clearance)["planar"]


def test_freedoms_in_the_plane() -> None:
    assert {f.name.lstrip("+-") for f in freedoms(1.0, 1.0, 1.0, True)} == set(IN_PLANE)
    assert len(freedoms(1.0, 1.0, 1.0)) == 12


def test_half_of_the_errors_are_taken_in_three_moves(slot: Problem) -> None:
    task, rounds = searched(slot, 0.5 * slot.start_box)
    found = search(task, next(rounds)[:1])
    assert found.names == ("approach", "-x", "+ry", "-z")
    assert found.reached.margin > 1e-4
    assert all(np.abs(move.goal.vector()[[1, 3, 5]]).max() <= 1e-12 for move in found.moves)
    # The side of the peg on the lower corner of the chamfer, then flush: no error is left across and about.
    assert [c.kind for c in found.moves[-1].held] == [Kind.EDGE_EDGE, Kind.VERTEX_FACE]
    left = found.reached.errors.support(np.eye(6))
    assert left[0] < 1e-4
    assert left[4] < 1e-3


@pytest.mark.parametrize("shares", [(0.0, 0.5), (1.0, 0.0), (0.0, 0.0), (0.1, 0.1)])
def test_errors_of_next_to_nothing_are_taken_too(slot: Problem, shares: tuple[float, float]) -> None:
    box = slot.start_box * np.array([shares[0], 0.0, 0.0, 0.0, shares[1], 0.0])
    task, rounds = searched(slot, box)
    (found,) = best_sequences(task, rounds)
    assert found.reached.margin > 2e-5
    assert thoroughly(task, found.moves).margin > 2e-5


def test_a_corner_that_slides_off_its_slope_is_not_held(slot: Problem) -> None:
    """Held on past the end of the slope, its contact kept the search's margin at 961 µm."""
    box = slot.start_box * np.array([5e-4, 0.0, 0.0, 0.0, 1.0, 0.0])
    task, _ = searched(slot, box)
    _, narrow = islice(planar_entries(slot.moving, slot.fixed, box, slot.approach, slot.settings.max_tilt), 2)
    found = search(task, narrow)
    assert found.names == ("approach", "-x", "+ry", "-z")
    assert -1e-3 < found.reached.margin < 0.0
    assert -1e-3 < thoroughly(task, found.moves).margin < 0.0


@pytest.mark.parametrize(("shares", "least"), [((1.0, 1.0), 2e-4), ((0.3, 0.5), 8e-4), ((0.1, 1.0), 6e-4)])
def test_motions_are_placed_in_the_plane(slot: Problem, shares: tuple[float, float], least: float) -> None:
    """As the search found them, they have 252, 143 and 1 µm: of the last two, contacts are near the rims of facets."""
    box = slot.start_box * np.array([shares[0], 0.0, 0.0, 0.0, shares[1], 0.0])
    solved = pipeline.synthesise(replace(slot, start_box=box))
    assert solved.proved
    assert solved.verdict.margin is not None
    assert solved.verdict.margin > least
    for segment in solved.document["segments"]:
        assert not np.take(segment["goal"], [1, 3, 5]).any()


def test_a_motion_that_no_contact_would_end_is_not_placed(slot: Problem) -> None:
    """The largest margin there is leads away from the contact that is to end a turn."""
    problem = replace(slot, start_box=np.array([1e-9, 0.0, 1e-9, 0.0, 1e-9, 0.0]))
    assert pipeline.synthesise(problem).proved


def test_a_contact_yet_to_be_made_is_listed_where_it_will_be(slot: Problem) -> None:
    """The end of the first piece of a move: the corner is 21 mm above the slope that it comes down to."""
    body, fixed = slot.moving.polyhedron, slot.fixed.polyhedron
    at = Pose.from_vector([0.0034919, 0.0, 0.0140875, 0.0, -0.6280714, 0.0])
    slopes = [n for n, face in enumerate(fixed.faces) if 0.1 < face.normal[2] < 0.9]
    corners = [vertex_face(fixed, 0, n) for n in slopes]
    due = [c for c in corners if 0.02 < Surfaces.of([c], body, fixed).values(at)[0] < 0.025]
    assert len(due) == 1
    assert _touching(slot, tuple(due), at) == set(due)
    high = at.moved([0.0, 0.0, 0.05, 0.0, 0.0, 0.0])
    assert not _touching(slot, tuple(due), high)
    assert body.vertices[0][2] == 0.0


def test_largest_share() -> None:
    tried: list[float] = []

    def attempt(share: float) -> str | None:
        tried.append(share)
        return f"at {share}" if share <= 0.62 else None

    assert largest_share(attempt) == (0.6, "at 0.6")
    assert len(tried) <= 5
    assert largest_share(lambda _: None) is None
    assert largest_share(lambda share: share, 4) == (0.75, 0.75)


@pytest.mark.parametrize("percent", range(100))
def test_shares_below_a_step_are_told_apart_more_finely(percent: int) -> None:
    tried: list[float] = []

    def attempt(share: float) -> float | None:
        tried.append(share)
        return share if 100.0 * share <= percent + 1e-9 else None

    found = largest_share(attempt)
    assert len(tried) <= ATTEMPTS
    if found is None:
        assert percent == 0
    else:
        assert 100.0 * found[0] == pytest.approx(percent if percent < 5 else percent // 5 * 5)


def test_a_plan_for_a_share_proves_nothing_for_all(slot: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    certified = Verdict("CERTIFIED", (), None, 0, None, ())

    def searched(problem: Problem, stages: object = None) -> Any:
        share = float(problem.start_box[0] / slot.start_box[0])
        if share > 0.6 + 1e-9:
            raise SearchError(f"nothing for {share:.2f}")
        return SimpleNamespace()

    completed = []

    def complete(problem: Problem, *_: object) -> pipeline.Synthesis:
        completed.append(problem)
        document = {"verdict": "CERTIFIED", "description": {"diagnostics": diagnostics()}}
        return pipeline.Synthesis(document, certified, {})

    monkeypatch.setattr(pipeline, "certified_motion", searched)
    monkeypatch.setattr(pipeline, "proved", lambda problem, done: ({}, certified))
    monkeypatch.setattr(pipeline, "_completed", complete)
    slot = replace(slot, settings=replace(slot.settings, reduce_errors=True))
    found = pipeline.synthesise(slot)
    assert len(completed) == 1  # of the shares that were tried only the one that is given is worked out
    assert found.document["verdict"] == str(found.verdict.verdict) == str(NOT_PROVED)
    assert found.document["description"]["diagnostics"]["reduced"]["share"] == 0.6
    message = str(found.verdict.findings[-1])
    assert "60% of the start errors that the problem states; for all of them: nothing for 1.00" in message
    with pytest.raises(SearchError, match=r"nothing for 1\.00"):
        pipeline.synthesise(replace(slot, settings=replace(slot.settings, reduce_errors=False)))
    half = replace(slot, start_box=0.5 * slot.start_box)
    assert pipeline.synthesise(half).document["verdict"] == "CERTIFIED"
