"""How surely contacts are held, as rows of the placement of a sequence."""

from dataclasses import replace

import numpy as np
import pytest

from fmopt.planning.control.holding import holds
from fmopt.planning.optimise.solvers import ClarabelSolver
from fmopt.planning.placement.error_derivatives import pose_derivatives
from fmopt.planning.placement.sequence_program import Aim, displaced, refine, state_rows, surer
from fmopt.planning.placement.sequence_rows import hold_rows
from fmopt.planning.posed import FINE, Posed
from fmopt.spatial.values import Array
from tests.shared.searched import shipped_motion

LEAST = 0.05, 0.17  # more than the plan of the problem is asked for


def aim_of(name: str) -> tuple[Posed, Aim]:
    problem, done = shipped_motion(name)
    posed = Posed.of(problem)

    def asked(claims: object) -> list:  # type: ignore[type-arg]
        return holds(problem, done.assembly, claims, done.tolerance, LEAST)  # type: ignore[arg-type]

    return posed, Aim(done.assembly, posed.start, done.tolerance, FINE, holds=asked)


def free_shift(aim: Aim, name: str, seed: int) -> Array:
    """A random small displacement (m + 1, 6) of all goal poses but the last inside their contact states."""
    moves, rng = shipped_motion(name)[1].placed.moves, np.random.default_rng(seed)
    shift = np.zeros((len(moves) + 1, 6))
    for k, move in enumerate(moves[:-1], 1):
        N = state_rows(aim.assembly, (*move.held, *move.making), move.goal)
        free = np.linalg.svd(N * aim.assembly.units)[2][len(N) :] * aim.assembly.units
        shift[k] = 2e-7 * rng.normal(size=len(free)) @ free
    return shift


def test_holds_change_with_the_poses_of_a_sequence_as_their_rows_say() -> None:
    name = "square_peg"
    _, aim = aim_of(name)
    placed = shipped_motion(name)[1].placed
    here = aim.holds(placed.reached.claims)
    rows = hold_rows(aim.assembly, placed.reached, aim.tolerance, here, 2)
    assert len(here) >= 5
    assert np.array_equal(rows.reach, [aim.tolerance.rho * hold.least for hold in here])
    for seed in range(10):
        shift = free_shift(aim, name, seed)
        ends = [aim.holds(displaced(aim, placed, s * shift).reached.claims) for s in (1.0, -1.0)]
        told = rows.slopes @ shift.ravel() / aim.tolerance.rho
        for k, hold in enumerate(here):
            shares = [{other.claim: other.share for other in end}[hold.claim] for end in ends]
            change = 0.5 * (shares[0] - shares[1])
            assert abs(change - told[k]) <= 0.05 * max(abs(change), 1e-5)


def test_poses_between_pieces_change_with_those_of_the_sequence_as_differences_say() -> None:
    name = "square_peg"
    _, aim = aim_of(name)
    placed = shipped_motion(name)[1].placed
    claims = placed.reached.claims
    changes = pose_derivatives(aim.assembly, claims, aim.tolerance)
    for seed in range(3):
        shift = free_shift(aim, name, seed)
        ends = [displaced(aim, placed, s * shift).reached.claims for s in (1.0, -1.0)]
        for claim, one, other, told in zip(claims, *ends, changes, strict=True):
            for end, change in zip(("start", "goal"), told, strict=True):
                here, there, back = (getattr(each.piece, end) for each in (claim, one, other))
                difference = 0.5 * (here.local(there) - here.local(back))
                assert difference == pytest.approx(change @ shift.ravel(), abs=1e-3 * np.abs(shift).max())


def test_contacts_come_to_be_held_as_surely_as_is_asked_and_stay_so() -> None:
    posed, aim = aim_of("square_peg")
    begun = shipped_motion("square_peg")[1].placed

    def surest(placed: object) -> float:
        return min(hold.share / hold.least for hold in aim.holds(placed.reached.claims))  # type: ignore[attr-defined]

    assert surest(begun) < 0.9
    held = surer(aim, begun, ClarabelSolver(), posed.refinement)
    assert surest(held) >= 1.0
    assert held.margin >= 0.5 * begun.margin
    # A row is of the forces that press least as poses are; after a long step others may, and the rule says no.
    asked = replace(aim, fit=lambda placed: surest(placed) >= 0.98)
    again, ruled, free = (
        refine(way, held, ClarabelSolver(), posed.refinement)
        for way in (asked, replace(asked, holds=lambda _: []), replace(aim, holds=lambda _: []))
    )
    assert surest(again) >= 0.98 > surest(free)
    assert again.margin > ruled.margin > held.margin


def test_nothing_that_is_held_surely_is_moved() -> None:
    posed, aim = aim_of("square_peg")
    begun = shipped_motion("square_peg")[1].placed
    assert surer(replace(aim, holds=lambda _: []), begun, ClarabelSolver(), posed.refinement) is begun
    rows = posed.holds(begun.reached.claims)
    assert min(hold.share / hold.least for hold in rows) >= 1.0
