"""Placement from poses at which the errors are too large to be followed: they grow as the poses come to bear them.

A sequence is certified for a share λ of all errors at which its moves are possible, in coarse pieces. Its rows look
ahead: what the generators of errors take of a row now they take 1/λ times once all of the errors are there. The least
row of that kind is made as large as possible, those that only keep the description of contacts among them, and where it
is positive the share grows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmopt.errors import InfeasibleError, SolverError
from fmopt.planning.moves.contact_transition import DOUBT
from fmopt.planning.moves.moves import Move
from fmopt.planning.optimise.cone_program import Solver
from fmopt.planning.placement.sequence_program import (
    SHORTER,
    Aim,
    Placed,
    Refinement,
    certified,
    displaced,
    program_of,
    refine,
)
from fmopt.planning.placement.sequence_rows import KEPT, SequenceRows, sequence_rows

COARSE = 0.03  # rad, the greatest turn of a piece while errors grow
_ROUNDS = 80
_HALVINGS = 6  # of the errors, until the moves are possible
_AHEAD = 10.0  # times the trust radius to begin with: rows that are looked at
_LOST = 0.05  # of these: what rows may fall by, to below zero, as errors grow
_EAGER = 3  # rounds after which more errors are tried though rows that look ahead still fall short
_WIDER = 4.0  # times the trust radius, with which the margin is raised once more in the end, and as much less
_CLOSER = 0.25  # times the least radius and gain in the end


@dataclass(frozen=True, eq=False)
class _Grown:
    """A sequence under a share of the errors.

    Args:
        share: of all errors.
        aim: what it is placed for, with the errors of that share.
        placed: the sequence.
        rows: its rows, as they would be under all errors.
    """

    share: float
    aim: Aim
    placed: Placed
    rows: SequenceRows

    @classmethod
    def of(cls, share: float, aim: Aim, placed: Placed, near: float) -> _Grown:
        """A certified sequence, with its rows within `near` (m) of binding."""
        rows = sequence_rows(aim.assembly, placed.reached, aim.tolerance, near)
        more = 1.0 / share
        values = rows.values - (more - 1.0) * np.abs(rows.products).sum(axis=1) - KEPT * DOUBT * (1.0 - rows.counted)
        every = np.ones_like(rows.counted)
        ahead = replace(rows, values=values, counted=every, products=more * rows.products, turning=more * rows.turning)
        return cls(share, aim, placed, ahead)

    @property
    def least(self) -> float:
        """The least of the rows, m."""
        return float(self.rows.values.min(initial=np.inf))


def grown(
    aim_at: Callable[[float], Aim], moves: Sequence[Move], solver: Solver, settings: Refinement, step: float
) -> Placed:
    """A sequence certified for all errors, from moves that cannot be followed under them.

    Args:
        aim_at: what for, under a share of all errors, in pieces that turn by `COARSE` at most.
        moves: the sequence; their goals make the contacts that they should.
        solver: for cone programs.
        settings: trust region, and how far the margin is raised in the end.
        step: greatest turn of one piece in the end, rad.

    Raises:
        InfeasibleError: it does not come to all of the errors.
    """
    near, radius = _AHEAD * settings.radius, settings.radius
    at = _begun(aim_at, moves, near)
    for count in range(_ROUNDS):
        if at.share == 1.0 or radius < settings.least_radius:
            break
        more = _more(aim_at, at, near) if at.least > 0.0 or count % _EAGER == _EAGER - 1 else None
        if more is not None:
            at, radius = more, settings.radius
            continue
        better = _better(at, solver, radius, settings, near)
        if better is None:
            radius *= SHORTER
        else:
            at, radius = better, min(2.0 * radius, 4.0 * settings.radius)
    if at.share < 1.0:
        raise InfeasibleError(f"the moves can be followed under {at.share:.0%} of the errors only")
    coarse = refine(at.aim, at.placed, solver, settings)
    fine = replace(at.aim, step=step)
    placed = certified(fine.assembly, coarse.moves, fine.start, fine.tolerance, step)
    closer = replace(settings, least_radius=_CLOSER * settings.least_radius, least_gain=_CLOSER * settings.least_gain)
    margin = -np.inf
    while placed.margin > margin + settings.least_gain:
        margin = placed.margin
        for wider in (1.0, _WIDER, 1.0 / _WIDER):
            placed = refine(fine, placed, solver, replace(closer, radius=wider * settings.radius))
    return placed


def _begun(aim_at: Callable[[float], Aim], moves: Sequence[Move], near: float) -> _Grown:
    """The sequence under the first of halved shares at which its moves are possible."""
    for halvings in range(_HALVINGS + 1):
        share = 0.5**halvings
        try:
            return _under(aim_at, share, moves, near)
        except InfeasibleError as error:
            told = error
    raise told


def _under(aim_at: Callable[[float], Aim], share: float, moves: Sequence[Move], near: float) -> _Grown:
    """The sequence under a share of the errors; raises what `certified` does."""
    aim = aim_at(share)
    return _Grown.of(share, aim, certified(aim.assembly, moves, aim.start, aim.tolerance, aim.step), near)


def _more(aim_at: Callable[[float], Aim], at: _Grown, near: float) -> _Grown | None:
    """The same poses under more of the errors, under as much as they are possible."""
    for share in (1.0, 0.5 * (1.0 + at.share), 1.25 * at.share, 1.1 * at.share):
        if at.share < share <= 1.0:
            try:
                found = _under(aim_at, share, at.placed.moves, near)
            except InfeasibleError:
                continue
            if found.least > min(at.least, 0.0) - _LOST * near:
                return found
    return None


def _better(at: _Grown, solver: Solver, radius: float, settings: Refinement, near: float) -> _Grown | None:
    """Poses in a trust region whose least row is larger; None where a step comes to no such."""
    try:
        solution = solver.solve(program_of(at.aim, at.placed, at.rows, radius))
        if solution.value <= at.least + settings.least_gain:
            return None
        placed = displaced(at.aim, at.placed, solution.x[:-1].reshape(-1, 6))
    except (InfeasibleError, SolverError):
        return None
    found = _Grown.of(at.share, at.aim, placed, near)
    return found if found.least > at.least else None
