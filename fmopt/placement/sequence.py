"""Placement of all goal poses of a sequence together, so that its least certified margin is as large as possible.

One cone program for the whole sequence: the unknowns are small displacements of every goal pose inside its contact
state; each row of each separating plane of each piece is linear in them, its error allowance fixed, and the drift grows
with the length of the move, a second-order cone. The program is solved in a trust region, the poses are put back on
the true contact surfaces, everything is certified anew, and the step is taken only if the certified margin rose.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, takewhile

import numpy as np

from fmopt.certificate.claim import Claim, facet_rows
from fmopt.certificate.functions import contact_rows, made_form, made_scale
from fmopt.certificate.knowledge import Assembly
from fmopt.certificate.segment import Tolerance
from fmopt.certificate.separation import Pair, Separation, pairs, row_bounds
from fmopt.contact.primitive import PrimitiveContact
from fmopt.errors import InfeasibleError, SolverError
from fmopt.placement.motion import Move, Reached, unroll
from fmopt.placement.program import ConeProgram, Norm, Solver
from fmopt.se3 import Pose
from fmopt.values import Array

_RANK = 1e-7


@dataclass(frozen=True)
class Refinement:
    """How far placement goes: rounds, first and least trust radius (m, in the metric of ρ), when a gain counts (m)."""

    rounds: int
    radius: float
    least_radius: float
    least_gain: float

    @classmethod
    def of(cls, spread: float, clearance: float) -> Refinement:
        """For a start error that displaces the tip by up to `spread` and a clearance a side, both in m."""
        return cls(12, spread + clearance, 0.05 * clearance, 0.002 * clearance)


@dataclass(frozen=True, eq=False)
class Placed:
    """A sequence of moves with its claims, and what had been reached after each move.

    Where it is not `thorough`, nothing is claimed of how far contacts stay inside their facets.
    """

    moves: tuple[Move, ...]
    reached: Reached
    stages: tuple[Reached, ...]
    thorough: bool

    @property
    def margin(self) -> float:
        """Least certified margin, m."""
        return self.reached.margin


def claims_of_moves(claims: Sequence[Claim]) -> list[list[Claim]]:
    """The claims of each move."""
    found: list[list[Claim]] = []
    for claim in claims:
        if claim.piece.progress[0] == 0.0:
            found.append([])
        found[-1].append(claim)
    return found


@dataclass(frozen=True, eq=False)
class _LinearRow:
    """A row that must stay positive: value with its allowance, and its slope in the displacements of two poses."""

    value: float
    slopes: tuple[tuple[int, Array], ...]
    drift: float
    move: int


def certified(
    assembly: Assembly, moves: Sequence[Move], start: Reached, tolerance: Tolerance, step: float, thorough: bool = True
) -> Placed:
    """Certifies a sequence of moves from the start, all that is claimed of them unless it is not `thorough`.

    Raises:
        InfeasibleError: a move is impossible.
    """
    stages = [start]
    for move in moves:
        stages.append(unroll(assembly, move, stages[-1], tolerance, step, thorough))
    return Placed(tuple(moves), stages[-1], tuple(stages[1:]), thorough)


def better(
    assembly: Assembly,
    moves: Sequence[Move],
    than: Placed,
    start: Reached,
    tolerance: Tolerance,
    step: float,
    by: float,
) -> Placed | None:
    """Moves certified, if their margin is larger than that of another sequence; None if not, or one is impossible.

    The moves with which both begin are not certified again, nor those after one that has too little margin.

    Args:
        assembly: the two parts.
        moves: the sequence.
        than: the other one, certified in the same way.
        start: errors at the start of both.
        tolerance: velocity error and metric.
        step: greatest turn of one piece, rad.
        by: by how much the margin has to be larger, m.
    """
    shared = sum(1 for _ in takewhile(lambda pair: pair[0] is pair[1], zip(moves, than.moves, strict=True)))
    stages = [start, *than.stages[:shared]]
    try:
        for move in moves[len(stages) - 1 :]:
            stages.append(unroll(assembly, move, stages[-1], tolerance, step, than.thorough))
            if stages[-1].margin <= than.margin + by:
                return None
    except InfeasibleError:
        return None
    return Placed(tuple(moves), stages[-1], tuple(stages[1:]), than.thorough)


def refine(
    assembly: Assembly,
    placed: Placed,
    start: Reached,
    tolerance: Tolerance,
    step: float,
    solver: Solver,
    settings: Refinement,
    progress: Callable[[float], None] = lambda _: None,
) -> Placed:
    """Moves all goal poses until the certified margin rises no more; the margin never falls.

    Args:
        assembly: the two parts.
        placed: the sequence to improve.
        start: errors at its start.
        tolerance: velocity error and metric.
        step: greatest turn of one piece, rad.
        solver: for cone programs.
        settings: rounds and trust region.
        progress: told the margin (m) after each gain.
    """
    best, radius = placed, settings.radius
    program = _program(assembly, best, tolerance, settings.radius)
    for _ in range(settings.rounds):
        if program is None or radius < settings.least_radius:
            break
        candidate = _step(
            assembly, best, _within(program, tolerance.rho, radius), start, tolerance, step, solver, settings
        )
        if candidate is not None:
            best, radius = candidate, min(2.0 * radius, 4.0 * settings.radius)
            program = _program(assembly, best, tolerance, settings.radius)
            progress(best.margin)
        else:
            radius *= 0.35
    return best


def _step(
    assembly: Assembly,
    placed: Placed,
    program: ConeProgram,
    start: Reached,
    tolerance: Tolerance,
    step: float,
    solver: Solver,
    settings: Refinement,
) -> Placed | None:
    try:
        solution = solver.solve(program)
    except (InfeasibleError, SolverError):
        return None
    shift = solution.x[:-1].reshape(-1, 6) * assembly.freedoms
    try:
        moves = _shifted(assembly, placed.moves, shift)
    except InfeasibleError:
        return None
    return better(assembly, moves, placed, start, tolerance, step, settings.least_gain)


def _rows(assembly: Assembly, placed: Placed, rho: float, near: float) -> list[_LinearRow]:
    """Every row that is within `near` (m) of binding, linear in the displacements of the moves' poses."""
    most = placed.margin + near
    return [
        row
        for number, claims in enumerate(claims_of_moves(placed.reached.claims))
        for claim in claims
        for row in _claim_rows(assembly, number, claim, rho, most)
    ]


def _claim_rows(assembly: Assembly, number: int, claim: Claim, rho: float, most: float) -> list[_LinearRow]:
    piece, ends = claim.piece, claim.advance.ends
    found = []
    for pair, separation in pairs_of(assembly, claim):
        if separation.margin > most:
            continue
        rows = row_bounds(assembly, pair, separation.witness, ends)
        loss = np.minimum(rows.start.f, rows.goal.f) - rows.lower
        for at, share in ((rows.start, piece.progress[0]), (rows.goal, piece.progress[1])):
            for k in np.flatnonzero(at.f - loss < most * rows.scale):
                slopes = _slopes(number, share, at.N[k])
                value = float(at.f[k] - loss[k]) / rows.scale
                drift = float(np.linalg.norm(at.N[k])) / rows.scale
                found.append(_LinearRow(value, tuple((n, s / rows.scale) for n, s in slopes), drift, number))
    for facet in facet_rows(assembly, claim) if claim.contacts else ():
        for contact, margin in enumerate(facet.table.margins(facet.lower)):
            if margin < most and (slope := facet.table.slope(contact, facet.lower)).any():
                N, share = slope @ facet.rows.N, piece.progress[facet.end]
                found.append(_LinearRow(margin, tuple(_slopes(number, share, N)), float(np.linalg.norm(N)), number))
    if claim.early is not None and piece.made is not None:
        row = made_form(assembly, piece.made, piece.held).at(piece.start)
        scale = made_scale(assembly, piece.made, piece.held, rho)
        found.append(_LinearRow(claim.early, tuple(_slopes(number, 0.0, scale * row.N[0])), 0.0, number))
    return found


def pairs_of(assembly: Assembly, claim: Claim) -> list[tuple[Pair, Separation]]:
    """The pairs of pieces of a claim, with the planes that keep them apart."""
    found = pairs(assembly, claim.piece)
    return [(pair, kept) for (_, _, kept), (_, _, pair) in zip(claim.separations, found, strict=True)]


def _slopes(number: int, share: float, N: Array) -> list[tuple[int, Array]]:
    """∂f/∂(displacements of pose `number` and `number + 1`) of a row at a share of the move between them."""
    return [(n, weight * N) for n, weight in ((number, 1.0 - share), (number + 1, share)) if weight > 0.0]


def _program(assembly: Assembly, placed: Placed, tolerance: Tolerance, near: float) -> ConeProgram | None:
    """The program without a trust region, of the rows within `near` (m) of binding; None where there are none.

    Variables: displacements (6) of all poses from the start to the goal, then the margin t, which is maximised.
    """
    rows = _rows(assembly, placed, tolerance.rho, near)
    if not rows:
        return None
    moves = placed.moves
    poses = len(moves) + 1
    n = 6 * poses + 1
    scale = np.array([1.0, 1.0, 1.0, *[tolerance.rho] * 3])
    G, h, W = np.zeros((len(rows), n)), np.zeros(len(rows)), np.zeros((len(rows), len(moves)))
    norms = []
    rate = max(tolerance.velocity_error)
    for m, move in enumerate(moves):
        F = np.zeros((6, n))
        F[:, 6 * m : 6 * m + 6], F[:, 6 * m + 6 : 6 * m + 12] = -np.diag(scale), np.diag(scale)
        norms.append(Norm(F, scale * move.start.local(move.goal)))
    for r, row in enumerate(rows):
        for pose, slope in row.slopes:
            G[r, 6 * pose : 6 * pose + 6] += slope
        G[r, -1] = -1.0
        here = float(np.linalg.norm(norms[row.move].g))
        W[r, row.move] = rate * min(row.drift, 1.0)
        h[r] = row.value + W[r, row.move] * here
    A = _equalities(assembly, moves, n)
    c = np.append(np.zeros(n - 1), 1.0)
    return ConeProgram.of(c, A=A, b=np.zeros(len(A)), G=G, h=h, W=W, norms=tuple(norms))


def _within(program: ConeProgram, rho: float, radius: float) -> ConeProgram:
    """The program in a trust region (m, in the metric of ρ)."""
    most = radius / np.array([1.0, 1.0, 1.0, *[rho] * 3])
    poses = len(program.c) // 6
    upper = np.append(np.tile(most, poses), np.inf)
    units = np.append(np.tile(0.25 * most, poses), 0.25 * radius)
    return replace(program, lower=-upper, upper=upper, units=units)


def _equalities(assembly: Assembly, moves: Sequence[Move], n: int) -> Array:
    """Each pose stays in its contact state; the start and the seated pose stay where they are."""
    first = np.zeros((6, n))
    first[:, :6] = np.eye(6)
    blocks = [first]
    for k, move in enumerate(moves):
        contacts = (*move.held, *move.making)
        rows = np.eye(6) if k == len(moves) - 1 else state_rows(assembly, contacts, move.goal)
        block = np.zeros((len(rows), n))
        block[:, 6 * (k + 1) : 6 * (k + 2)] = rows
        blocks.append(block)
    return np.vstack(blocks)


def state_rows(assembly: Assembly, contacts: Sequence[PrimitiveContact], pose: Pose) -> Array:
    """A basis (r, 6) of the displacements out of a contact state, orthonormal in the units of displacements."""
    N = np.eye(6)[assembly.freedoms == 0.0]
    if contacts:
        N = np.vstack([contact_rows(assembly, contacts, contacts, pose).N, N])
    _, s, Vt = np.linalg.svd(N * assembly.units, full_matrices=False)
    return np.asarray(Vt[s > _RANK * s.max(initial=0.0)] / assembly.units)


def in_a_row(moves: Sequence[Move], start: Pose, goals: Iterable[Pose]) -> tuple[Move, ...]:
    """The moves from another start to other goals, one for each; each begins where the one before ends."""
    ways = pairwise((start, *goals))
    return tuple(replace(move, start=at, goal=to) for move, (at, to) in zip(moves, ways, strict=True))


def _shifted(assembly: Assembly, moves: Sequence[Move], shift: Array) -> tuple[Move, ...]:
    """The moves with their poses displaced and put back onto the true contact surfaces."""
    *placed, last = moves
    goals = [onto_surfaces(assembly, move.goal.moved(shift[k]), move) for k, move in enumerate(placed, 1)]
    return in_a_row(moves, moves[0].start.moved(shift[0]), (*goals, last.goal))


def onto_surfaces(assembly: Assembly, pose: Pose, move: Move) -> Pose:
    """The nearest pose at which all contacts are exactly zero, by Gauss–Newton with the least turn.

    Args:
        assembly: the two parts.
        pose: a pose near by.
        move: the move that ends with the contacts.

    Raises:
        InfeasibleError: no pose near by makes all of them.
    """
    contacts = (*move.held, *move.making)
    if not contacts:
        return pose
    units = assembly.units * assembly.freedoms
    for _ in range(20):
        rows = contact_rows(assembly, contacts, contacts, pose)
        if np.abs(rows.f).max() < 1e-16:
            return pose
        step = np.linalg.pinv(rows.N * units, rcond=1e-6) @ rows.f * units
        pose = pose.moved(-step)
    if np.abs(contact_rows(assembly, contacts, contacts, pose).f).max() > 1e-13:
        raise InfeasibleError("a goal pose left the true surfaces of its contact state")
    return pose
