"""One moment ends a solve in every stage, and what there is by then still counts; cost grows with what can touch."""

import math
import time
from pathlib import Path

import numpy as np
import pytest

import fmopt
from fmopt.certificate.piece_pairs import facing
from fmopt.certificate.remainder import EndsBatch
from fmopt.certificate.separating_plane import separation
from fmopt.contact.c_surface import Surfaces
from fmopt.contact.primitive import near_contacts, near_tips
from fmopt.errors import OverdueError, SearchError
from fmopt.planning.moves.separating_planes import Faces
from fmopt.planning.pipeline import planned, synthesise
from fmopt.planning.placement.sequence_program import certified
from fmopt.planning.posed import Posed, placement
from fmopt.runtime.clock import clock, deadline, heed, until
from fmopt.spatial.se3 import Pose
from fmopt.verify import verify
from tests.shared.files.prisms import prism, regular
from tests.shared.searched import shipped_motion

_SLACK = 5.0  # s beyond the limit


def test_moments_nest_and_are_heeded() -> None:
    assert deadline() == math.inf
    heed()
    with until(clock() - 1.0):
        with pytest.raises(OverdueError, match="time limit") as caught:
            heed()
        assert caught.value.exit_code == 3
        with until(math.inf):
            heed()
        assert deadline() < clock()
    heed()


def test_without_time_a_placement_keeps_what_it_has() -> None:
    problem, motion = shipped_motion("square_peg")
    posed = Posed.of(problem)
    moves = motion.placed.moves
    with until(clock() - 1.0):  # there is still time to certify the moves once
        placed = placement(posed, moves, lambda _: None)
    assert placed.moves == moves
    assert placed.margin == certified(posed.assembly, moves, posed.start, posed.tolerance, math.radians(1.0)).margin


def test_without_time_a_plan_goes_without_what_its_verdict_does_not_rest_on() -> None:
    problem, motion = shipped_motion("square_peg")
    with until(clock() - 1.0):
        document, verdict = planned(problem, motion)
    assert verdict.verdict == "CERTIFIED"
    assert set(document["description"]) == {"search"}
    assert len(document["segments"]) == len(motion.claims)


def test_a_check_that_was_cut_short_proves_nothing() -> None:
    problem, motion = shipped_motion("square_peg")
    document, verdict = planned(problem, motion)
    assert verdict.verdict == "CERTIFIED"
    for most in (0, 1, len(document["segments"]) - 1):
        left = iter(range(most))
        cut = verify(document, overdue=lambda left=left: next(left, None) is None)  # type: ignore[misc]
        assert cut.verdict == "NOT_PROVED"
        assert any("no time left" in finding.message for finding in cut.findings)


@pytest.mark.parametrize(("n", "limit"), [(24, 1.0), (60, 1.5), (120, 2.0)])
def test_the_limit_holds_however_many_sides_there_are(n: int, limit: float, tmp_path: Path) -> None:
    problem = fmopt.load(prism(tmp_path, regular(n, 10.0), regular(n, 10.1), limit=limit))
    begun = time.process_time()
    with pytest.raises(SearchError) as caught:
        synthesise(problem)
    assert time.process_time() - begun < limit + _SLACK
    assert caught.value.late


def test_the_same_problem_gives_the_same_bytes_where_time_does_not_end_it() -> None:
    problem = fmopt.load(fmopt.example("square_peg"))
    one, two = (synthesise(problem, reserved=reserved).document for reserved in (0.0, 0.25))
    assert one["sha256"] == two["sha256"]


@pytest.mark.parametrize("n", [5, 12, 40])
def test_contacts_have_the_same_numbers_one_by_one_and_all_at_once(n: int, tmp_path: Path) -> None:
    problem = fmopt.load(prism(tmp_path, regular(n, 10.0), regular(n, 10.1)))
    moving, fixed = problem.moving.polyhedron, problem.fixed.polyhedron
    rng = np.random.default_rng(n)
    for _ in range(3):
        pose = Pose.from_vector(np.append(rng.uniform(-1e-3, 1e-3, 3), rng.uniform(-0.1, 0.1, 3)))
        near = near_contacts(moving, fixed, pose, 1e-3, 0.3)
        assert near_tips(moving, fixed, pose, 1e-3, 0.3) == tuple(c for c in near if c.kind == "vertex-face")
        made = Surfaces.of(near, moving, fixed)
        stacked = [row for table in made.tables for row in table]
        for contact, place in zip(near, made.order, strict=True):
            (alone,) = (row for table in Surfaces.of([contact], moving, fixed).tables for row in table)
            assert stacked[place].tobytes() == alone.tobytes()


def test_of_the_moving_faces_the_best_is_found_without_a_table() -> None:
    _, motion = shipped_motion("square_peg")
    assembly, seen = motion.assembly, 0
    for claim in motion.claims[::3]:
        listed, course = facing(assembly, claim.piece), EndsBatch.of([claim.advance.ends])
        free = [n for n, (_, _, pair) in enumerate(listed.listed) if not pair.touched]
        if not free:
            continue
        faces = Faces.of(listed, assembly.moving.pieces[0], free)
        numbers, margins, _ = faces.best(course, np.full((1, len(free)), -np.inf), 2e-6)
        for place, number, margin in zip(free, numbers[0].tolist(), margins[0].tolist(), strict=True):
            pair = listed.listed[place][2]
            each = [separation(assembly, pair, witness, claim.advance.ends) for witness in faces.witnesses]
            holding = [found.margin for found in each if found.clearance >= -2e-6]
            assert (number >= 0) == bool(holding)
            if holding:
                assert margin == pytest.approx(max(holding), abs=1e-15)
                assert each[number].margin == pytest.approx(margin, abs=1e-15)
                seen += 1
    assert seen > 10
