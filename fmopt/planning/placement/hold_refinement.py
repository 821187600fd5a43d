"""Placement for contacts that are held more surely, before it is for the margin, of which it leaves a share."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from fmopt.errors import InfeasibleError, SolverError
from fmopt.planning.optimise.cone_program import ConeProgram, Solver
from fmopt.planning.placement.hold_rows import Hold, hold_rows
from fmopt.planning.placement.sequence_program import SHORTER, Aim, Placed, Refinement, displaced, program_of
from fmopt.planning.placement.sequence_rows import SequenceRows, sequence_rows
from fmopt.runtime.compiled import heed

_LEFT = 0.5  # of the margin, what is left at least where contacts are held more surely
_AIMED = 0.75  # of it, what steps are to leave
_ENOUGH = 1.5  # times what is asked, what they are to reach at most
_LITTLE = 0.01  # of what is asked, a gain that does not count


def surer(aim: Aim, placed: Placed, solver: Solver, settings: Refinement) -> Placed:
    """Moves all poses until contacts are held as surely as is asked, as far as half of the margin lets them.

    Args:
        aim: what for; where it asks for no holds, the sequence stays.
        placed: the sequence, with a margin.
        solver: for cone programs.
        settings: rounds and trust region.

    Raises:
        OverdueError: there is no time left.
    """
    best, radius = placed, settings.radius
    least, aimed = (min(left * placed.margin, placed.margin) for left in (_LEFT, _AIMED))
    holds = aim.holds(best.reached.claims)
    for _ in range(settings.rounds):
        heed()
        held = _surest(holds)
        if held >= 1.0 or held <= 0.0 or radius < settings.least_radius:
            break
        try:
            x = solver.solve(_program(aim, best, holds, min(aimed, best.margin), radius)).x[:-1]
            found = displaced(aim, best, x.reshape(-1, 6))
            now = aim.holds(found.reached.claims)
        except (InfeasibleError, SolverError):
            radius *= SHORTER
            continue
        if found.margin < least or _surest(now) < held + _LITTLE:
            radius *= SHORTER
            continue
        best, holds, radius = found, now, min(2.0 * radius, 4.0 * settings.radius)
    return best


def _surest(holds: list[Hold]) -> float:
    """The least of what contacts are held by, as a share of what is asked."""
    return min((hold.share / hold.least for hold in holds), default=math.inf)


def _program(aim: Aim, placed: Placed, holds: list[Hold], least: float, radius: float) -> ConeProgram:
    """The program that raises the least of some holds in a trust region (m), and leaves a margin of so much (m).

    Its last variable is by how much more of what is asked contacts come to be held, times the radius.
    """
    rho, held = aim.tolerance.rho, _surest(holds)
    rows = sequence_rows(aim.assembly, placed.reached, aim.tolerance, max(placed.margin, radius))
    rows = replace(rows, values=rows.values - least * rows.counted, counted=np.zeros(len(rows.counted)))
    gains = hold_rows(aim.assembly, placed.reached, aim.tolerance, holds, rows.products.shape[1])
    beyond = np.array([rho * (hold.share - held * hold.least) for hold in holds])
    gains = replace(gains, values=beyond, counted=gains.reach / radius)
    program = program_of(aim, placed, SequenceRows.joined([rows, gains]), radius)
    return replace(program, upper=np.append(program.upper[:-1], (_ENOUGH - held) * radius))
