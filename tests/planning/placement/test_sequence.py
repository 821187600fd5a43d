"""Placement of whole sequences: errors that move along with the poses, rows within a trust region, what is kept."""

import numpy as np
import pytest

from fmopt.errors import InfeasibleError
from fmopt.planning.control.controlled_motion import least_firm, least_steady
from fmopt.planning.moves.moves import Care, Reached, in_a_row, onto_surfaces
from fmopt.planning.optimise.solvers import ClarabelSolver
from fmopt.planning.placement.error_derivatives import sensitivities
from fmopt.planning.placement.sequence_program import Aim, Placed, Refinement, certified, refine, state_rows
from fmopt.planning.placement.sequence_rows import SequenceRows, sequence_rows
from fmopt.planning.posed import FINE, FIRM, STEADY
from fmopt.planning.robustness.error_tolerance import CertifiedMotion
from fmopt.spatial.values import Array
from tests.shared.searched import shipped_motion

STEP = 1e-6


def displaced(done: CertifiedMotion, number: int, shift: Array) -> Placed | None:
    """The motion with one goal displaced inside its contact state, certified anew, where it has as many pieces."""
    moves, start = done.placed.moves, Reached(done.errors, (), ())
    goals = [move.goal for move in moves]
    try:
        goals[number] = onto_surfaces(done.assembly, goals[number].moved(shift), moves[number])
        ways = in_a_row(moves, moves[0].start, goals)
        other = certified(done.assembly, ways, start, done.tolerance, FINE, Care.NONE)
    except InfeasibleError:
        return None
    return other if len(other.reached.claims) == len(done.placed.reached.claims) else None


def test_generators_change_with_the_poses_as_differences_say() -> None:
    _, done = shipped_motion("square_peg")
    predicted = sensitivities(done.assembly, done.placed.reached.claims, done.tolerance)
    weights, seen = np.array([1.0, 1.0, 1.0, *[done.tolerance.rho] * 3]), 0
    for number, move in enumerate(done.placed.moves[:-1]):
        N = state_rows(done.assembly, (*move.held, *move.making), move.goal)
        free = np.linalg.svd(N * done.assembly.units, full_matrices=True)[2][len(N) :]
        for direction in free * done.assembly.units:
            ends = [displaced(done, number, sign * STEP * direction) for sign in (1.0, -1.0)]
            if ends[0] is None or ends[1] is None:
                continue
            off, largest = 0.0, 0.0
            claims = zip(ends[0].reached.claims, ends[1].reached.claims, predicted, strict=True)
            for one, other, sensitivity in claims:
                k = len(sensitivity.goal[0])
                there, here = (end.advance.ends.goal_set.generators[:k] for end in (one, other))
                change = (there - here) / (2.0 * STEP)
                said = sensitivity.goal[1][:, :, 6 * (number + 1) : 6 * (number + 2)] @ direction
                off = max(off, np.abs((change - said) * weights).max())
                largest = max(largest, np.abs(change * weights).max())
            assert off <= 0.06 * largest  # rows turn with the part, too
            seen += 1
    assert seen >= 15


def random_rows(rng: np.random.Generator, n: int) -> SequenceRows:
    r, k = 40, 3
    shape = rng.normal(size=(r, k, n)) * rng.choice([0.0, 1.0], (r, k, 1))
    products = 1e-4 * rng.normal(size=(r, k)) * rng.choice([0.0, 1.0], (r, k))
    slopes, moves = rng.normal(size=(r, n)), np.zeros(r, dtype=np.intp)
    values, counted = 1e-3 * rng.uniform(size=r), rng.choice([0.3, 1.0], r)
    return SequenceRows(values, slopes, counted, np.ones(r), moves, products, shape, np.zeros(r), np.zeros(r))


@pytest.mark.parametrize("seed", range(5))
def test_rows_within_a_trust_region_bind_as_all_rows_do(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, most = random_rows(rng, 4), np.full(4, 3e-5)
    linear = rows.within(most, 1e-12)
    assert len(linear.values) < len(rows.values)
    for x in rng.uniform(-1.0, 1.0, (50, 4)) * most:
        bent = np.abs(rows.products + rows.turning @ x) - np.abs(rows.products)
        exact = rows.values + rows.slopes @ x - bent.sum(axis=1)
        short = linear.values + linear.slopes @ x
        for row, at, slope in zip(*linear.kinks, strict=True):
            short[row] -= abs(at + slope @ x) - abs(at)
        assert rows.at(x) == pytest.approx(exact)
        assert (short / linear.counted).min() == pytest.approx((exact / rows.counted).min(), abs=1e-9)


def test_a_sequence_is_placed_for_more_margin_and_contacts_hold_no_less() -> None:
    problem, done = shipped_motion("square_peg")
    begun = done.placed
    start = Reached(done.errors, (), ())
    shift = np.array([2e-4, -1e-4, 0.0, 0.004, 0.003, 0.004])
    others = [displaced(done, number, shift) for number in range(1, 5)]
    certain = [certified(done.assembly, other.moves, start, done.tolerance, FINE) for other in others if other]
    worse = min((other for other in certain if other.margin > 0.0), key=lambda other: other.margin)
    assert worse.margin < 0.9 * begun.margin
    asked = list[Placed]()

    def fit(placed: Placed) -> bool:
        asked.append(placed)
        return True

    aim = Aim(done.assembly, start, done.tolerance, FINE, fit)
    settings = Refinement.of(1e-3, 1e-4)
    again = refine(aim, worse, ClarabelSolver(), settings)
    assert again.margin > 0.97 * begun.margin
    assert again is asked[-1]
    never = Aim(done.assembly, start, done.tolerance, FINE, lambda _: False)
    assert refine(never, worse, ClarabelSolver(), settings) is worse
    for least, rule in ((least_firm, FIRM), (least_steady, STEADY)):
        assert least(problem, done.assembly, begun.reached.claims, done.tolerance) >= rule


def test_every_row_is_at_least_the_margin_where_nothing_is_displaced() -> None:
    _, done = shipped_motion("square_peg")
    rows = sequence_rows(done.assembly, done.placed.reached, done.tolerance, 2e-4)
    counted = rows.values[rows.counted > 0.0]
    assert counted.min() == pytest.approx(done.placed.margin, rel=1e-9)
