"""Placement from poses at which the errors are too large to be followed: they grow as the poses come to bear them.

A sequence is certified for a share of all errors at which its moves are possible, in coarse pieces. Each of its rows
says which share of the errors it bears: what they take of it grows with them, to first order, and remainders with their
square. The least of these shares is made as large as possible, rows among them that only keep the description of
contacts, and where it exceeds the share that is certified, that grows.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fmopt.errors import InfeasibleError, OverdueError, SolverError
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
from fmopt.spatial.values import Array

_ROUNDS = 120
_PATIENCE, _SLOW = 10, 0.01  # rounds in which the share borne has to rise, by so much of all errors
_FINER = 0.4  # of the pieces that a sequence is placed in, where it comes to all of the errors in these only
_NEARLY = 0.85  # of the errors, taken in coarse pieces, from where finer ones may come to all: they add 0.15 at most
_HALVINGS = 6  # of the errors, until the moves are possible
_AHEAD = 10.0  # times the trust radius to begin with: rows that are looked at
_MORE = 1.02  # times the share, what rows have to bear for more of the errors to be tried
_RESERVE = 0.05  # of all errors, what is borne beyond them in the end
_LITTLE = 1e-3  # of all errors, a gain that does not count
_AT_ONCE, _ADDED = 80, 6  # rows that a step is solved with at first, and added at once; how often at most
_BROKEN = 0.02  # of the trust radius, by which rows may be broken that a step is not solved with
_WIDER = 4.0  # times the trust radius, with which the margin is raised once more in the end, and as much less
_CLOSER = 0.25  # times the least radius and gain in the end


@dataclass(frozen=True, eq=False)
class _Grown:
    """A sequence under a share of the errors: its rows, and what these take of the row that they take most of, m."""

    share: float
    aim: Aim
    placed: Placed
    rows: SequenceRows
    unit: float

    @classmethod
    def of(cls, share: float, aim: Aim, placed: Placed, near: float) -> "_Grown":
        """A certified sequence, with its rows within `near` (m) of binding."""
        rows = sequence_rows(aim.assembly, placed.reached, aim.tolerance, near, drifting=True, felt=share == 1.0)
        # Of a row errors take λ a + λ² b, its reach and rest: per λ that is a + 2 λ b, or (reach + 2 rest) / λ.
        taken = np.maximum(rows.reach + 2.0 * rows.rest, _LITTLE * near) / share
        unit = float(taken.max(initial=_LITTLE * near))
        # Rows that only have to hold count like others here: all of what is left to them, not what a step may take.
        values = np.where(rows.counted > 0.0, rows.values, rows.values / KEPT - DOUBT * (rows.drifts > 0.0))
        return cls(share, aim, placed, replace(rows, values=values, counted=taken / unit), unit)

    def borne(self, x: Array) -> float:
        """The share of all errors that the rows bear after displacements (n,), about."""
        return self.share + float((self.rows.at(x) / self.rows.counted).min(initial=np.inf)) / self.unit

    @cached_property
    def bears(self) -> float:
        """The share of all errors that the rows bear."""
        return self.borne(np.zeros(self.rows.slopes.shape[1]))

    @property
    def taken(self) -> float:
        """The share of all errors that it takes, about."""
        return max(min(self.share, self.bears), 0.0)


def grown(
    aim_at: Callable[[float], Aim], moves: Sequence[Move], solver: Solver, settings: Refinement, step: float
) -> Placed:
    """A sequence certified for all errors, from moves that cannot be followed under them.

    `aim_at` says what for, under a share of all errors, in pieces that turn by
    `fmopt.planning.placement.sequence_program.COARSE` at most; whether a sequence will do is asked in the end. Goals of
    the moves make the contacts that they should. The step is the greatest turn of one piece in the end, rad.

    Raises:
        InfeasibleError: it does not come to all of the errors.
    """
    near = _AHEAD * settings.radius
    at = _towards_all(aim_at, _begun(aim_at, moves, near), solver, settings)
    if _NEARLY < at.share < 1.0:

        def finer(share: float) -> Aim:
            aim = aim_at(share)
            return replace(aim, step=_FINER * aim.step)

        with suppress(InfeasibleError, OverdueError):
            at = _towards_all(finer, _under(finer, at.share, at.placed.moves, near), solver, settings)
    if at.share < 1.0:
        error = InfeasibleError(f"the moves can be followed under {at.taken:.0%} of the errors only")
        error.share = at.taken
        raise error
    coarse = refine(_kept(at.aim, at.placed), at.placed, solver, settings)
    fine = replace(at.aim, step=min(step, at.aim.step))
    placed = certified(fine.assembly, coarse.moves, fine.start, fine.tolerance, fine.step)
    fine = _kept(fine, placed)
    closer = replace(settings, least_radius=_CLOSER * settings.least_radius, least_gain=_CLOSER * settings.least_gain)
    margin = -np.inf
    while placed.margin > margin + settings.least_gain:
        margin = placed.margin
        for wider in (1.0, _WIDER, 1.0 / _WIDER):
            placed = refine(fine, placed, solver, replace(closer, radius=wider * settings.radius))
    return placed


def _kept(aim: Aim, placed: Placed) -> Aim:
    """The aim with nothing asked of a sequence, whatever its margin, where another one does not do either."""
    return aim if aim.fit(placed) else replace(aim, fit=lambda _: True)


def _towards_all(aim_at: Callable[[float], Aim], begun: _Grown, solver: Solver, settings: Refinement) -> _Grown:
    """As much of the errors as a sequence comes to bear, step by step, while there is time; arguments as of `grown`."""
    near, radius, at, borne = _AHEAD * settings.radius, settings.radius, begun, [begun.bears]
    with suppress(OverdueError):
        for _ in range(_ROUNDS):
            if at.bears >= 1.0 + _RESERVE and at.share == 1.0:
                break
            better = _better(at, solver, radius, near)
            now = at if better is None else better
            radius = SHORTER * radius if better is None else min(2.0 * radius, 4.0 * settings.radius)
            more = _more(aim_at, now, near) if now.bears > _MORE * now.share else None
            if more is not None:
                now, radius = more, max(radius, settings.radius)
            at = now
            borne.append(at.bears)
            slow = len(borne) > _PATIENCE and at.bears < borne[-_PATIENCE] + _SLOW
            if radius < settings.least_radius or slow:
                break
    return at


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
    """The same poses under more of the errors, as much as leaves them room to be placed better; None if none does."""
    for part in (1.0, 0.5, 0.25):
        share = min(1.0, at.share + part * (at.bears - at.share))
        if share > at.share:
            with suppress(InfeasibleError):
                found = _under(aim_at, share, at.placed.moves, near)
                if found.bears >= at.share:
                    return found
    return None


def _better(at: _Grown, solver: Solver, radius: float, near: float) -> _Grown | None:
    """Poses in a trust region that bear more of the errors; None where a step comes to no such."""
    try:
        x = _step(at, solver, radius)
        if at.borne(x) <= at.bears + _LITTLE:
            return None
        found = _Grown.of(at.share, at.aim, displaced(at.aim, at.placed, x.reshape(-1, 6)), near)
    except (InfeasibleError, SolverError):
        return None
    return found if found.bears > at.bears else None


def _step(at: _Grown, solver: Solver, radius: float) -> Array:
    """The displacements (n,) in a trust region after which the rows bear most of the errors, nearly.

    Few of the rows bind: those that bear least are solved for, and the ones that the answer breaks added.
    """
    rows, used = at.rows, np.zeros(len(at.rows.values), dtype=np.bool_)
    short = np.argsort(rows.values / rows.counted, kind="stable")[:_AT_ONCE]
    for _ in range(_ADDED):
        used[short] = True
        solution = solver.solve(program_of(at.aim, at.placed, rows.taken(used), radius))
        left = rows.at(solution.x[:-1]) - solution.value * rows.counted
        short = np.flatnonzero((left < -_BROKEN * radius) & ~used)
        if not len(short):
            break
        short = short[np.argsort(left[short], kind="stable")[:_AT_ONCE]]
    return solution.x[:-1]
