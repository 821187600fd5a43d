"""Sequences placed from poses at which their errors cannot be followed: the errors are grown as the poses bear them."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fmopt
from fmopt.errors import InfeasibleError
from fmopt.planning.motion import _SHARE, _Stood
from fmopt.planning.moves import moves as moving
from fmopt.planning.moves.moves import Care, Move, in_a_row, onto_surfaces
from fmopt.planning.optimise.solvers import ClarabelSolver
from fmopt.planning.placement import error_growth as growth
from fmopt.planning.placement.sequence_program import COARSE, certified, displaced
from fmopt.planning.posed import FINE, Posed, Stages, placement, under_errors
from fmopt.planning.robustness.error_tolerance import CertifiedMotion
from fmopt.planning.search.symmetry import images
from fmopt.spatial.se3 import length, log
from tests import PROBLEMS
from tests.shared.parts.families import pair as family_pair
from tests.shared.parts.families import widened, write_toml

OFF, TURNED = 3e-4, math.radians(1.0)  # m and rad: by how much poses are disturbed


@pytest.fixture(scope="module", params=["square_peg", "hexagon_prism"])
def solved(request: pytest.FixtureRequest) -> tuple[fmopt.Problem, CertifiedMotion]:
    problem = fmopt.load(PROBLEMS / f"{request.param}.toml")
    return problem, fmopt.stages.motion(problem)


def disturbed(motion: CertifiedMotion, seed: int) -> tuple[Move, ...]:
    """Its moves with all goal poses but the last displaced at random, inside their contact states."""
    rng, moves, parts = np.random.default_rng(seed), motion.placed.moves, motion.assembly
    shifts = rng.uniform(-1.0, 1.0, (len(moves) - 1, 6)) * [*[OFF] * 3, *[TURNED] * 3] * parts.freedoms
    goals = [onto_surfaces(parts, move.goal.moved(s), move) for move, s in zip(moves[:-1], shifts, strict=True)]
    return in_a_row(moves, moves[0].start, (*goals, moves[-1].goal))


@pytest.mark.wide
def test_a_motion_comes_back_from_poses_that_are_disturbed(solved: tuple[fmopt.Problem, CertifiedMotion]) -> None:
    problem, motion = solved
    posed, moves = Posed.of(problem), disturbed(motion, 1)
    with pytest.raises(InfeasibleError):
        certified(motion.assembly, moves, posed.start, posed.tolerance, FINE)
    found = fmopt.stages.placed(problem, replace(motion, placed=replace(motion.placed, moves=moves)))
    assert found.placed.margin >= 0.95 * motion.placed.margin
    plan = fmopt.stages.plan(problem, found)
    assert plan.verify(problem).verdict == "CERTIFIED"
    assert [move.making for move in found.placed.moves] == [move.making for move in motion.placed.moves]


def test_what_is_placed_in_finer_pieces_is_certified_in_them(solved: tuple[fmopt.Problem, CertifiedMotion]) -> None:
    problem, motion = solved
    placed = placement(Posed.of(problem), motion.placed.moves, lambda _: None, 0.5 * FINE)
    assert motion.placed.step == FINE
    assert placed.step == 0.5 * FINE
    assert max(length(log(c.piece.start.R.T @ c.piece.goal.R)) for c in placed.reached.claims) <= 0.5 * FINE + 1e-9
    found = replace(motion, placed=placed)
    assert under_errors(found, problem).turn == placed.step
    assert fmopt.stages.plan(problem, found).verify(problem).verdict == "CERTIFIED"


def test_rows_for_a_share_of_the_errors_foresee_those_for_all(solved: tuple[fmopt.Problem, CertifiedMotion]) -> None:
    problem, motion = solved
    posed = Posed.of(problem)
    less, near, whole = (growth._under(posed.under, share, motion.placed.moves, 1e-3) for share in (0.85, 0.98, 0.995))
    assert whole.bears > 1.0
    # What is not foreseen, how arcs and bent surfaces add up, goes as the errors come near to being there.
    assert near.bears == pytest.approx(whole.bears, abs=0.02)
    assert abs(near.bears - whole.bears) <= abs(less.bears - whole.bears)


def test_what_no_share_of_the_errors_lets_through_says_why(solved: tuple[fmopt.Problem, CertifiedMotion]) -> None:
    problem, motion = solved
    first, *rest = motion.placed.moves
    away = replace(first, goal=first.goal.moved([0.0, 0.0, 0.05, 0.0, 0.0, 0.0]))
    moves = in_a_row((away, *rest), first.start, [away.goal, *(move.goal for move in rest)])
    with pytest.raises(InfeasibleError) as caught:
        fmopt.stages.placed(problem, replace(motion, placed=replace(motion.placed, moves=moves)))
    assert len(str(caught.value)) > 10


def test_moves_that_fail_are_divided_in_two_ways_while_searching_and_in_more_afterwards(
    solved: tuple[fmopt.Problem, CertifiedMotion], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, motion = solved
    posed, tried = Posed.of(problem), list[int]()

    def fail(*arguments: object) -> None:
        tried.append(arguments[4])  # type: ignore[arg-type]
        raise InfeasibleError("it fails")

    monkeypatch.setattr(moving, "_unroll", fail)
    upright = next(move for move in motion.placed.moves if not np.allclose(move.start.R, move.goal.R))
    step = length(log(upright.goal.R @ upright.start.R.T)) / 12
    for care, ways in ((Care.NONE, 2), (Care.FACETS, 2), (Care.ALL, 7)):
        tried.clear()
        with pytest.raises(InfeasibleError, match="it fails"):
            moving.unroll(posed.assembly, upright, posed.start, posed.tolerance, step, care)
        assert len(tried) == len(set(tried)) == ways


def test_a_motion_is_placed_for_other_errors_without_a_search() -> None:
    problem = fmopt.load(PROBLEMS / "square_peg.toml")
    motion = fmopt.stages.motion(problem)
    wider = problem.with_(uncertainty_start_x="0.4 mm", uncertainty_start_y="0.4 mm")
    plan = fmopt.stages.plan(wider, fmopt.stages.placed(wider, motion))
    assert plan.verify(wider).verdict == "CERTIFIED"
    assert plan.stated.start_box[0] == pytest.approx(4e-4)


def test_rows_change_with_the_poses_as_they_say(solved: tuple[fmopt.Problem, CertifiedMotion]) -> None:
    """What rows near binding come to bear after a small step is what they foretell, drift of earlier moves included."""
    problem, motion = solved
    at = growth._under(Posed.of(problem).under, 0.95, motion.placed.moves, 1e-3)
    x = growth._step(at, ClarabelSolver(), 2e-5)
    small = 0.03 * x
    there = growth._Grown.of(at.share, at.aim, displaced(at.aim, at.placed, small.reshape(-1, 6)), 1e-3)
    assert len(there.rows.values) == len(at.rows.values)
    told, found = (at.rows.at(small) - at.rows.values)[:], there.rows.values - at.rows.values
    near = np.argsort(at.rows.values / at.rows.counted)[:20]
    assert found[near] == pytest.approx(told[near], abs=0.35 * float(np.abs(small).max()) + 2e-8)
    assert there.bears > at.bears


@pytest.mark.wide
def test_a_share_of_the_errors_leads_to_all_of_them(tmp_path: Path) -> None:
    """A square of 9.4 mm at 50 µm a side, ± 0.94 mm, ± 1° and z ± 0.47 mm, by growing errors alone."""
    pair = replace(family_pair("4-gon", 0), clearance=0.05)
    wide = widened(pair.peg[0].outline, 0.05)
    pair = replace(pair, hole=tuple(replace(section, outline=wide) for section in pair.hole))
    file = write_toml(pair, tmp_path, error=(0.94, 1.0), time_limit=600.0)
    file.write_text(file.read_text().replace("\nz = 0\n", "\nz = 0.47\n").replace("height = 0.471", "height = 1"))
    posed = Posed.of(fmopt.load(file))
    stood = _Stood.of(posed, next(iter(images(posed.assembly, posed.problem.start_box))))
    found, placed = stood.grown(math.inf, Stages())
    assert placed.margin > 1e-5
    assert found.names[-1] == "-z"
    margin = certified(stood.task.assembly, placed.moves, stood.posed.start, stood.posed.tolerance, placed.step).margin
    assert margin == pytest.approx(placed.margin, rel=1e-6)


@pytest.mark.parametrize(("family", "seed"), [("chamfered", 102), ("plus", 102)])
def test_what_is_grown_stays_inside_its_facets_to_begin_with(family: str, seed: int, tmp_path: Path) -> None:
    """Contacts that would run past the end of a facet under a quarter of the errors are none that could bear all."""
    file = write_toml(family_pair(family, seed), tmp_path, error=(1.0, 1.0), time_limit=600.0)
    file.write_text(file.read_text().replace("\nz = 0\n", "\nz = 0.5\n").replace("\nheight", "\n# height"))
    posed = Posed.of(fmopt.load(file))
    stood = _Stood.of(posed, next(iter(images(posed.assembly, posed.problem.start_box))))
    found, aim = next(stood._under(math.inf, Stages(), [])), stood.posed.under(_SHARE)
    assert any(claim.contacts for claim in found.reached.claims)
    coarse = certified(stood.task.assembly, found.moves, aim.start, aim.tolerance, COARSE)
    assert coarse.care is Care.ALL
    assert coarse.margin > 0.0
