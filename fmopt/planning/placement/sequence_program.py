"""Placement of all goal poses of a sequence together, so that its least certified margin is as large as possible.

One cone program for the whole sequence: the unknowns are small displacements of every goal pose inside its contact
state. Each row of each separating plane of each piece is linear in them, and so are the products N·g of that row with
the generators of the errors, which turn with the moves: of |N·g| what cannot change its sign within the trust region is
linear, the rest is kept as it is. The drift grows with the length of the move. The program is solved in a trust region,
the poses are put back on the true contact surfaces, everything is certified anew, and the step is taken only if the
certified margin rose.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile

import numpy as np

from fmopt.certificate.assembly import Assembly, contact_rows
from fmopt.certificate.claim import Claim
from fmopt.certificate.segment_linearisation import Tolerance
from fmopt.contact.primitive import PrimitiveContact
from fmopt.errors import InfeasibleError, OverdueError, SolverError
from fmopt.geometry.section import lowest_point
from fmopt.planning.moves.moves import Care, Move, Reached, in_a_row, onto_surfaces, unroll
from fmopt.planning.optimise.cone_program import ConeProgram, Norm, Solver
from fmopt.planning.placement.sequence_rows import HoldMargin, SequenceRows, hold_rows, sequence_rows
from fmopt.runtime.clock import heed
from fmopt.spatial.se3 import Pose, length
from fmopt.spatial.values import Array

COARSE = 0.03  # rad, the greatest turn of a piece while errors grow
_RANK = 1e-7  # of the largest singular value: smaller ones are zero
_FINE = 5e-3  # times the trust radius: what changes a row by less does not count
SHORTER = 0.35  # times the trust radius after a step that was none
_SLIDE = 1e-3  # rad; moves that turn by less are slides, and stay so where the start may be displaced
_LEFT = 0.5  # of the margin, what is left at least where contacts are held more surely
_AIMED = 0.75  # of it, what steps are to leave
_ENOUGH = 1.5  # times what is asked, what they are to reach at most
_LITTLE = 0.01  # of what is asked, a gain that does not count
_STRAIGHT = 4.0  # times the trust radius: moves that are longer are so by the same share along all of it


@dataclass(frozen=True)
class Refinement:
    """How far placement goes: rounds, first and least trust radius (m, in the metric of ρ), when a gain counts (m)."""

    rounds: int
    radius: float
    least_radius: float
    least_gain: float

    @classmethod
    def of(cls, spread: float, clearance: float) -> "Refinement":
        """For a start error that displaces the tip by up to `spread` and a clearance a side, both in m."""
        return cls(16, 0.1 * (spread + clearance), 0.05 * clearance, 0.002 * clearance)


@dataclass(frozen=True, eq=False)
class Placed:
    """A sequence of moves with its claims, what had been reached after each, and the greatest turn of a piece, rad.

    Without care for them, nothing is claimed of how far contacts stay inside their facets.
    """

    moves: tuple[Move, ...]
    reached: Reached
    stages: tuple[Reached, ...]
    care: Care
    step: float

    @property
    def margin(self) -> float:
        """Least certified margin, m."""
        return self.reached.margin


def certified(
    assembly: Assembly, moves: Sequence[Move], start: Reached, tolerance: Tolerance, step: float, care: Care = Care.ALL
) -> Placed:
    """Certifies a sequence of moves in pieces that turn by `step`, rad, at most, with all care unless told otherwise.

    Raises:
        InfeasibleError: a move is impossible.
    """
    stages = [start]
    for move in moves:
        stages.append(unroll(assembly, move, stages[-1], tolerance, step, care))
    return Placed(tuple(moves), stages[-1], tuple(stages[1:]), care, step)


@dataclass(frozen=True, eq=False)
class Aim:
    """What a sequence is placed for."""

    assembly: Assembly
    start: Reached
    tolerance: Tolerance
    step: float  # greatest turn of one piece, rad
    fit: Callable[[Placed], bool] = lambda _: True  # whether a sequence will do, whatever its margin
    # Whether goal poses in free space may turn. If not, how the part is tilted as it enters is for the search to say:
    # what gives way under a contact that is aslant is the robot.
    turning: bool = False
    # Height of the lowest point above the mouth at the start, m, where the start may be displaced at that height; None
    # where it stays
    lift: float | None = None
    holds: Callable[[Sequence[Claim]], list[HoldMargin]] = lambda _: []

    def rows(self, placed: Placed, near: float) -> SequenceRows:
        """All rows of a sequence that are within `near` (m) of binding, and those of its holds."""
        rows = sequence_rows(self.assembly, placed.reached, self.tolerance, near)
        holds, width = self.holds(placed.reached.claims), rows.products.shape[1]
        return SequenceRows.joined([rows, hold_rows(self.assembly, placed.reached, self.tolerance, holds, width)])


def better(aim: Aim, moves: Sequence[Move], than: Placed, by: float) -> Placed | None:
    """Moves certified if their margin is larger than that of a sequence by so much, m; None if not, or if impossible.

    The moves with which both begin are not certified again, nor those after one that has too little margin.
    """
    shared = sum(1 for _ in takewhile(lambda pair: pair[0] is pair[1], zip(moves, than.moves, strict=True)))
    stages = [aim.start, *than.stages[:shared]]
    try:
        for move in moves[len(stages) - 1 :]:
            stages.append(unroll(aim.assembly, move, stages[-1], aim.tolerance, aim.step, than.care))
            if stages[-1].margin <= than.margin + by:
                return None
    except InfeasibleError:
        return None
    return Placed(tuple(moves), stages[-1], tuple(stages[1:]), than.care, aim.step)


def refine(
    aim: Aim, placed: Placed, solver: Solver, settings: Refinement, progress: Callable[[float], None] = lambda _: None
) -> Placed:
    """Moves all goal poses until the certified margin rises no more, or time is up; the margin never falls."""
    best, radius = placed, settings.radius
    try:
        rows = aim.rows(best, settings.radius)
        for _ in range(settings.rounds):
            heed()
            if not rows.counted.any() or radius < settings.least_radius:
                break
            try:
                solution = solver.solve(program_of(aim, best, rows, radius))
            except (InfeasibleError, SolverError):
                radius *= SHORTER
                continue
            if solution.value <= best.margin + settings.least_gain:  # and a smaller region promises less
                break
            candidate = _moved(aim, best, solution.x[:-1].reshape(-1, 6), settings.least_gain)
            if candidate is None:
                radius *= SHORTER
                continue
            best, radius = candidate, min(2.0 * radius, 4.0 * settings.radius)
            rows = aim.rows(best, settings.radius)
            progress(best.margin)
    except OverdueError:
        pass  # what there is by now counts
    return best


def surer(aim: Aim, placed: Placed, solver: Solver, settings: Refinement) -> Placed:
    """Moves all poses until contacts are held as surely as is asked, as far as half of the margin lets them."""
    best, radius = placed, settings.radius
    least, aimed = (min(left * placed.margin, placed.margin) for left in (_LEFT, _AIMED))  # none below zero falls
    holds = aim.holds(best.reached.claims)
    for _ in range(settings.rounds):
        held = _surest(holds)
        if held >= 1.0 or held <= 0.0 or radius < settings.least_radius:
            break
        try:
            heed()
            x = solver.solve(_surer(aim, best, holds, min(aimed, best.margin), radius)).x[:-1]
            found = displaced(aim, best, x.reshape(-1, 6))
            now = aim.holds(found.reached.claims)
        except OverdueError:
            break
        except (InfeasibleError, SolverError):
            radius *= SHORTER
            continue
        if found.margin < least or _surest(now) < held + _LITTLE:
            radius *= SHORTER
            continue
        best, holds, radius = found, now, min(2.0 * radius, 4.0 * settings.radius)
    return best


def _surest(holds: list[HoldMargin]) -> float:
    """The least of what contacts are held by, as a share of what is asked."""
    return min((hold.share / hold.least for hold in holds), default=math.inf)


def _surer(aim: Aim, placed: Placed, holds: list[HoldMargin], least: float, radius: float) -> ConeProgram:
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


def sequence_program(aim: Aim, placed: Placed, radius: float) -> ConeProgram:
    """The program whose optimum `refine` takes its first step to, in a trust region (m, in the metric of ρ).

    Its variables are the displacements (6) of the start and of the goal pose of each move, m and rad, then the margin,
    m; the seated pose stays where it is, the start at least at its height.
    """
    return program_of(aim, placed, aim.rows(placed, radius), radius)


def displaced(aim: Aim, placed: Placed, shift: Array) -> Placed:
    """The sequence, its poses displaced by shifts (m + 1, 6), m and rad, put back onto their surfaces, certified anew.

    Raises:
        InfeasibleError: a pose leaves its contact state, or a move is impossible.
    """
    moves = _shifted(aim, placed.moves, shift)
    return certified(aim.assembly, moves, aim.start, aim.tolerance, aim.step, placed.care)


def _moved(aim: Aim, placed: Placed, shift: Array, by: float) -> Placed | None:
    """The sequence with its poses displaced, if that is possible, better by so much (m), and will do."""
    try:
        moves = _shifted(aim, placed.moves, shift)
    except InfeasibleError:
        return None
    found = better(aim, moves, placed, by)
    return found if found is not None and aim.fit(found) else None


def program_of(aim: Aim, placed: Placed, rows: SequenceRows, radius: float) -> ConeProgram:
    """The program of a sequence with its rows, in a trust region (m, in the metric of ρ).

    Variables: displacements (6) of all poses from the start to the goal, then the margin t, which is maximised.
    """
    rho, moves = aim.tolerance.rho, placed.moves
    scale = np.array([1.0, 1.0, 1.0, *[rho] * 3])
    most = np.tile(radius / scale, len(moves) + 1)
    linear = rows.within(most, _FINE * radius)
    n = len(most) + 1
    G, h = np.zeros((len(linear.values), n)), linear.values.copy()
    G[:, :-1], G[:, -1] = linear.slopes, -linear.counted
    norms, W = list[Norm](), list[Array]()
    drift = max(aim.tolerance.velocity_error) * np.minimum(linear.drifts, 1.0)
    for m, move in enumerate(moves):
        F, way = np.zeros((6, n)), scale * move.start.local(move.goal)
        F[:, 6 * m : 6 * m + 6], F[:, 6 * m + 6 : 6 * m + 12] = -np.diag(scale), np.diag(scale)
        far, own = float(np.linalg.norm(way)), drift * (linear.moves == m)
        if far > _STRAIGHT * radius:  # a long way grows as much as its end is displaced along it
            G -= np.outer(own, way / far @ F)
        elif own.any():
            norms.append(Norm(F, way))
            W.append(own)
            h += own * far  # drift of the way as it is has been taken off
    for number, at, slope in zip(*linear.kinks, strict=True):
        norms.append(Norm(np.append(slope, 0.0)[None], np.array([at])))
        W.append((np.arange(len(h)) == number).astype(np.float64))
        h[number] += abs(at)
    A = _equalities(aim, moves, n)
    upper = np.append(most, np.inf)
    weights = np.array(W).reshape(len(W), len(h)).T
    units = np.append(0.25 * most, 0.25 * radius)
    box = {"lower": -upper, "upper": upper, "units": units}
    c = np.append(np.zeros(n - 1), 1.0)
    return ConeProgram(c, A=A, b=np.zeros(len(A)), G=G, h=h, W=weights, norms=tuple(norms), **box)


def _equalities(aim: Aim, moves: Sequence[Move], n: int) -> Array:
    """Each pose stays in its contact state, the start at its height or where it is, the seated pose where it is."""
    fixed = np.eye(6) if aim.lift is None else _rising(aim.assembly, moves[0].start)
    first = np.zeros((len(fixed), n))
    first[:, :6] = fixed
    blocks = [first]
    for k, move in enumerate(moves):
        contacts = (*move.held, *move.making)
        rows = np.eye(6) if k == len(moves) - 1 else state_rows(aim.assembly, contacts, move.goal)
        if not (move.held or aim.turning) and k < len(moves) - 1:
            rows = np.vstack([rows, np.eye(6)[3:]])
        block = np.zeros((len(rows), n))
        block[:, 6 * (k + 1) : 6 * (k + 2)] = rows
        blocks.append(block)
        if aim.lift is not None and length(move.start.local(move.goal)[3:]) < _SLIDE:
            slide = np.zeros((3, n))
            slide[:, 6 * k + 3 : 6 * k + 6], slide[:, 6 * k + 9 : 6 * k + 12] = -np.eye(3), np.eye(3)
            blocks.append(slide)
    return np.vstack(blocks)


def state_rows(assembly: Assembly, contacts: Sequence[PrimitiveContact], pose: Pose) -> Array:
    """A basis (r, 6) of the displacements out of a contact state, orthonormal in the units of displacements."""
    N = np.eye(6)[assembly.freedoms == 0.0]
    if contacts:
        N = np.vstack([contact_rows(assembly, contacts, contacts, pose).N, N])
    _, s, Vt = np.linalg.svd(N * assembly.units, full_matrices=False)
    return np.asarray(Vt[s > _RANK * s.max(initial=0.0)] / assembly.units)


def _rising(assembly: Assembly, pose: Pose) -> Array:
    """How displacements raise the lowest point of the moving part, a row (1, 6)."""
    body = assembly.moving.polyhedron
    lowest = body.vertices[int(np.argmin(pose.apply(body.vertices)[:, 2] - body.radii))]
    arm = pose.R @ lowest
    return np.array([[0.0, 0.0, 1.0, arm[1], -arm[0], 0.0]])


def _shifted(aim: Aim, moves: Sequence[Move], shift: Array) -> tuple[Move, ...]:
    """The moves with their poses displaced and put back onto the true contact surfaces."""
    shift = shift * aim.assembly.freedoms
    *placed, last = moves
    goals = [onto_surfaces(aim.assembly, move.goal.moved(shift[k]), move) for k, move in enumerate(placed, 1)]
    start = moves[0].start.moved(shift[0])
    if aim.lift is not None:
        start = start.moved([0.0, 0.0, aim.lift - lowest_point(aim.assembly.moving, start), 0.0, 0.0, 0.0])
    return in_a_row(moves, start, (*goals, last.goal))
