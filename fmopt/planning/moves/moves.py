"""Moves: from pose to pose along held contacts, unrolled into pieces that the certificate can follow."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import IntFlag
from itertools import pairwise

import numpy as np

from fmopt.certificate.assembly import Assembly, contact_forms, contact_rows
from fmopt.certificate.claim import Claim, Stepped, claimed, stepped
from fmopt.certificate.error_set import ErrorSet
from fmopt.certificate.kernels_rows import Table
from fmopt.certificate.segment_linearisation import Compliance, Piece, Tolerance
from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.contact.realisation import Poses
from fmopt.errors import InfeasibleError
from fmopt.planning.moves import constrained_path as keeping
from fmopt.planning.moves.contact_transition import described, on_wall
from fmopt.planning.moves.separating_planes import choose_separations, choose_tightest
from fmopt.runtime.clock import heed
from fmopt.spatial import se3
from fmopt.spatial.se3 import Pose, length
from fmopt.spatial.values import Array, remembered

_DIGITS = 9  # decimals of poses, m and rad, that tell one move from another
_LATEST = 2  # results that are kept with a move
_SHOTS = 16  # times that a twist is aimed, at most
_AIMED = 2e-15  # m and rad beside the goal, as near as rounding lets poses come
_RANK = 1e-6  # singular values of contact rows that are smaller are zero
_CONDITION = 1e8  # of contact rows along the basis's twists: where it is larger, these do not give way to the contact


class Care(IntFlag):
    """What is done to certify a move besides keeping its parts apart."""

    NONE = 0
    FACETS = 1
    """How far contacts stay inside their facets counts, too."""
    PIECES = 2
    """It is tried in all numbers of pieces, and its twist aimed until they end at the goal."""
    PLANES = 4
    """Each two parts are kept apart by the best plane that there is, not those alone that decide the margin."""
    MARGIN = FACETS | PIECES
    """All that its margin hangs on; planes between other parts are good enough for that."""
    ALL = MARGIN | PLANES


@dataclass(frozen=True, eq=False)
class Move:
    """A move from pose to pose inside held contacts, ending as new ones are made at once; the first one counts."""

    start: Pose
    goal: Pose
    held: tuple[PrimitiveContact, ...]
    making: tuple[PrimitiveContact, ...]
    left: tuple[PrimitiveContact, ...] = ()


Tried = set[tuple[bytes, tuple[PrimitiveContact, ...]]]
"""Where moves from one state lead to: poses, but for rounding, and the contacts there."""


def fresh(moves: Iterable[Move], tried: Tried) -> Iterator[Move]:
    """Moves that lead where none did before, which are added to those tried.

    Held contacts may leave the part but one way to go, whichever freedom it is asked for along.
    """
    for move in moves:
        where = (np.round(move.goal.vector(), decimals=_DIGITS) + 0.0).tobytes(), move.making
        if where not in tried:
            tried.add(where)
            yield move


@dataclass(frozen=True, eq=False)
class Reached:
    """Where a sequence of moves has come to: errors, basis, and the claims so far."""

    errors: ErrorSet
    basis: tuple[Compliance, ...]
    claims: tuple[Claim, ...]

    @property
    def margin(self) -> float:
        """The least margin so far, m; infinite before the first move."""
        return min((c.margin for c in self.claims), default=math.inf)


def claims_of_moves(claims: Sequence[Claim]) -> list[list[Claim]]:
    """The claims of each move."""
    found: list[list[Claim]] = []
    for claim in claims:
        if claim.piece.progress[0] == 0.0:
            found.append([])
        found[-1].append(claim)
    return found


def onto(assembly: Assembly, poses: Poses, basis: Sequence[Compliance], context: Iterable[PrimitiveContact]) -> Poses:
    """Poses shifted along the compliant directions until all contacts of the basis are zero, by Newton's method.

    Raises:
        InfeasibleError: the contacts cannot be met near one of them.
    """
    p, R = np.array(poses.p), np.array(poses.R)
    kept(keeping.onto(*held_by(assembly, basis, context), p, R))
    return Poses(p, R)


def held_by(
    assembly: Assembly, basis: Sequence[Compliance], context: Iterable[PrimitiveContact]
) -> tuple[Table, Array]:
    """The functions of a basis (r,) as kernels take them, and its compliant twists (r, 6)."""
    forms = contact_forms(assembly, tuple(c.contact for c in basis), tuple(context))
    return forms.table, np.array([c.direction for c in basis]).reshape(-1, 6)


def kept(state: int) -> None:
    """Refuses what a kernel could not do.

    Raises:
        InfeasibleError: contacts could not be kept.
    """
    if state == keeping.SINGULAR:
        raise InfeasibleError("contacts do not determine their compliant directions")
    if state == keeping.LOST:
        raise InfeasibleError("contacts cannot be held along the move", advice="shorten the move")


def way(assembly: Assembly, move: Move, basis: Sequence[Compliance], count: int, shots: int) -> tuple[Pose, ...]:
    """Nominal poses (count + 1) of a move in equal pieces that share one twist, held contacts kept by compliance.

    One twist is what lets a move be certified in pieces: an execution that touches late only goes on in the direction
    that all pieces share. Each piece is the twist and as much compliance as its contacts ask for; the twist is aimed
    anew, as many `shots`, until the last piece ends at the goal, or takes up what is left.
    """
    if count == 1:
        return move.start, move.goal
    directions = np.array([c.direction for c in basis]).reshape(-1, 6)
    return _way(move, assembly, tuple(c.contact for c in basis), directions.tobytes(), count, shots)


@remembered(_LATEST)
def _way(
    move: Move, assembly: Assembly, contacts: tuple[PrimitiveContact, ...], twists: bytes, count: int, shots: int
) -> tuple[Pose, ...]:
    """See `way`: no error enters it, so that a move certified under other errors has the same; `twists` are bytes."""
    table = contact_forms(assembly, contacts, contacts).table
    C = np.frombuffer(twists).reshape(-1, 6).copy()
    twist, gives = move.start.local(move.goal), np.zeros((count, len(contacts)))
    p, R = np.empty((count + 1, 3)), np.empty((count + 1, 3, 3))
    p[0], R[0] = move.start.p, move.start.R
    for shot in range(1, shots + 1):
        # Where the last piece of the last shot would end does not matter: it ends at the goal.
        n = count + (shot < shots)
        kept(keeping.repeated((table, C), twist / count, gives, shot == 1, p[:n], R[:n]))
        if shot < shots:
            miss = np.concatenate([move.goal.p - p[-1], se3.log(move.goal.R @ R[-1].T)])
            if np.abs(miss).max() < _AIMED:
                break
            twist = twist + miss
    return (move.start, *(Pose(p[k], R[k]) for k in range(1, count)), move.goal)


def unroll(
    assembly: Assembly, move: Move, reached: Reached, tolerance: Tolerance, step: float, care: Care = Care.ALL
) -> Reached:
    """Certifies a move piece by piece, none of which turns by more than a step, rad.

    Raises:
        InfeasibleError: parts overlap nominally on the way, or a step is impossible.
        OverdueError: there is no time left.
    """
    turn = length(se3.log(move.goal.R @ move.start.R.T))
    count = max(math.ceil(turn / step - 1e-9), 1)  # a whole number of steps, but for rounding, is no more
    failures: list[InfeasibleError] = []
    # Shorter pieces leave smaller remainders; but the last one must be longer than what errors make the touch differ.
    # Most of the moves that a search tries fail in every way: there two of them say enough.
    others = (2 * count, -(-2 * count // 3), -(-count // 2), 4 * count, -(-count // 3)) if care & Care.PIECES else ()
    for pieces in dict.fromkeys((count, *others, 1)):
        heed()
        try:
            return _unroll(assembly, move, reached, tolerance, pieces, care)
        except InfeasibleError as error:
            failures.append(error.with_traceback(None))  # which would hold on to this frame, and all that is in it
            if turn == 0.0:  # pieces are cut for their turns, and there is none
                break
    raise failures.pop(0)  # what was wrong with as many pieces as the turn asks for


def _unroll(assembly: Assembly, move: Move, reached: Reached, tolerance: Tolerance, count: int, care: Care) -> Reached:
    steps, there = carried(assembly, move, reached, tolerance, count, care)
    # What errors ask of the pieces is known by now: only where all can be followed is the rest worth its while.
    choose = choose_separations if care & Care.PLANES else choose_tightest
    claims = claimed(assembly, steps, tolerance, choose, bool(care & Care.FACETS))
    return Reached(there.errors, there.basis, (*reached.claims, *claims))


def carried(
    assembly: Assembly, move: Move, reached: Reached, tolerance: Tolerance, count: int, care: Care
) -> tuple[tuple[Stepped, ...], Reached]:
    """Carries the errors through a move in so many pieces: these, and where it comes to with nothing claimed of them.

    Arguments else as of `unroll`.

    Raises:
        InfeasibleError: a step is impossible.
    """
    basis = tuple(c for c in reached.basis if c.contact not in move.left)
    shots = _SHOTS if care & Care.PIECES and count > 1 else 1
    steps, end = _carried(move, (reached.errors, basis), assembly, tolerance, count, shots)
    return steps, Reached(*end, reached.claims)


_State = tuple[ErrorSet, tuple[Compliance, ...]]
"""The errors, and the basis of what is held."""


@remembered(_LATEST)
def _carried(
    move: Move, start: _State, assembly: Assembly, tolerance: Tolerance, count: int, shots: int
) -> tuple[tuple[Stepped, ...], _State]:
    """The pieces of a move, and the state at its end; what has been looked at may well be certified."""
    (errors, basis), steps = start, list[Stepped]()
    for k, (at, to) in enumerate(pairwise(way(assembly, move, basis, count, shots))):
        share = (k / count, (k + 1) / count)
        held = described(assembly, move.held, at, to, errors)
        current = _carried_over(assembly, basis, held, to)
        made = move.making[0] if move.making else None
        piece = Piece(at, to, held, (*held, *move.making), current, made, share, move.left)
        found = stepped(assembly, piece, errors, tolerance)
        steps.append((piece, found))
        errors = found.ends.goal_set
        basis = found.basis if piece.last else current
    return tuple(steps), (errors, basis)


def _carried_over(
    assembly: Assembly, basis: Sequence[Compliance], held: Sequence[PrimitiveContact], pose: Pose
) -> tuple[Compliance, ...]:
    """The basis in terms of the contacts now held: one that has gone is replaced by another of the same flush."""
    kept = list(basis)
    for n, entry in enumerate(basis):
        if entry.contact not in held:
            kept[n] = Compliance(_replacement(assembly, kept, n, held, pose), entry.direction)
    return tuple(kept)


def _replacement(
    assembly: Assembly, kept: Sequence[Compliance], n: int, held: Sequence[PrimitiveContact], pose: Pose
) -> PrimitiveContact:
    """A held contact on the same wall that says, with the rest of the basis, the same as contact n did."""
    gone = kept[n].contact
    rest = [k for i, k in enumerate(kept) if i != n and k.contact in held]
    C = np.array([k.direction for k in (*rest, kept[n])]).T
    before = _rows(assembly, [*(k.contact for k in rest), gone], (*held, gone), pose)
    for contact in held:
        same_wall = contact.kind is Kind.VERTEX_FACE and on_wall(assembly, gone, contact.fixed_feature)
        if not same_wall or any(contact == k.contact for k in rest):
            continue
        now = _rows(assembly, [*(k.contact for k in rest), contact], held, pose)
        # Both sets of rows span the same where together they have no more rank than the new ones alone.
        rank = np.linalg.matrix_rank(np.vstack([before, now]), _RANK)
        regular = np.linalg.cond((now / assembly.units) @ C) < _CONDITION
        if rank == len(now) == np.linalg.matrix_rank(now, _RANK) and regular:
            return contact
    raise InfeasibleError(f"contact {gone.id} ends along the move and nothing takes its place")


def _rows(
    assembly: Assembly, contacts: Sequence[PrimitiveContact], together: Sequence[PrimitiveContact], pose: Pose
) -> Array:
    """Contact rows (k, 6), angles weighed against lengths."""
    return np.asarray(contact_rows(assembly, contacts, together, pose).N * assembly.units)


def in_a_row(moves: Sequence[Move], start: Pose, goals: Iterable[Pose]) -> tuple[Move, ...]:
    """The moves from another start to other goals, one for each; each begins where the one before ends."""
    ways = pairwise((start, *goals))
    return tuple(replace(move, start=at, goal=to) for move, (at, to) in zip(moves, ways, strict=True))


def onto_surfaces(assembly: Assembly, pose: Pose, move: Move) -> Pose:
    """The nearest pose at which all contacts are exactly zero, by Gauss–Newton with the least turn.

    Raises:
        InfeasibleError: no pose near by makes all of them.
    """
    contacts = (*move.held, *move.making)
    if not contacts:
        return pose
    units = assembly.units * assembly.freedoms  # in the plane no step leads out of it
    for _ in range(20):
        rows = contact_rows(assembly, contacts, contacts, pose)
        if np.abs(rows.f).max() < 1e-16:
            return pose
        step = np.linalg.pinv(rows.N * units, rcond=1e-6) @ rows.f * units
        pose = pose.moved(-step)
    # Rounding may keep values from coming below 0.1 fm: with 0.1 pm a pose is on the surfaces.
    if np.abs(contact_rows(assembly, contacts, contacts, pose).f).max() > 1e-13:
        raise InfeasibleError("a goal pose left the true surfaces of its contact state")
    return pose
