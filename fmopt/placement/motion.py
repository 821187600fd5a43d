"""Moves: from pose to pose along held contacts, unrolled into pieces that the certificate can follow."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fmopt import se3
from fmopt.certificate.claim import Claim, claimed, stepped
from fmopt.certificate.functions import contact_forms, contact_rows
from fmopt.certificate.knowledge import Assembly
from fmopt.certificate.rows import Forms
from fmopt.certificate.segment import Advance, Compliance, Piece, Tolerance
from fmopt.contact.meet import Poses
from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.errors import InfeasibleError
from fmopt.memory import remembered
from fmopt.placement.flush import described, on_wall
from fmopt.placement.witness import choose_separations
from fmopt.se3 import Pose, length
from fmopt.uncertainty.error_set import ErrorSet
from fmopt.values import Array

_NEWTON = 12
_MEMORY = 128
_SHOTS = 16
_AIMED = 2e-15
_RANK = 1e-6
_CONDITION = 1e8


@dataclass(frozen=True, eq=False)
class Move:
    """A move from pose to pose inside held contacts, ending as new ones are made.

    Args:
        start: nominal pose at the beginning.
        goal: nominal pose at the end.
        held: contacts held on the way.
        making: contacts made at the end, all at once; the first is the one that counts.
        left: contacts held up to the beginning, which the move gives up.
    """

    start: Pose
    goal: Pose
    held: tuple[PrimitiveContact, ...]
    making: tuple[PrimitiveContact, ...]
    left: tuple[PrimitiveContact, ...] = ()


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


def onto(assembly: Assembly, poses: Poses, basis: Sequence[Compliance], context: Iterable[PrimitiveContact]) -> Poses:
    """Poses shifted along the compliant directions until all contacts of the basis are zero, by Newton's method.

    Raises:
        InfeasibleError: the contacts cannot be met near one of them.
    """
    forms = contact_forms(assembly, tuple(c.contact for c in basis), tuple(context))
    directions = np.array([c.direction for c in basis]).T
    for _ in range(_NEWTON):
        f, N = forms.along(poses.p, poses.R)
        if np.abs(f).max(initial=0.0) < 1e-16:
            return poses
        try:
            step = np.linalg.solve(N @ directions, f[..., None])[..., 0] @ directions.T
        except np.linalg.LinAlgError as error:
            raise InfeasibleError("contacts do not determine their compliant directions") from error
        if not np.abs(step).max() < 0.1:
            break
        poses = poses.moved(-step)
    if np.abs(forms.along(poses.p, poses.R)[0]).max(initial=0.0) < 1e-12:
        return poses
    raise InfeasibleError("contacts cannot be held along the move", advice="shorten the move")


def way(assembly: Assembly, move: Move, basis: Sequence[Compliance], count: int, shots: int) -> tuple[Pose, ...]:
    """Nominal poses (count + 1) of a move in equal pieces that share one twist, held contacts kept by compliance.

    One twist is what lets a move be certified in pieces: an execution that touches late only goes on in the direction
    that all pieces share. Each piece is the twist and as much compliance as its contacts ask for; the twist is aimed
    anew until the last piece ends at the goal.

    Args:
        assembly: the two parts.
        move: the move.
        basis: independent held contacts with their compliant directions.
        count: how many pieces.
        shots: how often the twist is aimed; the last piece takes up what is left.
    """
    if count == 1:
        return move.start, move.goal
    directions = np.array([c.direction for c in basis]).reshape(-1, 6)
    return _way(assembly, move, tuple(c.contact for c in basis), directions.tobytes(), count, shots)


@remembered(_MEMORY)
def _way(
    assembly: Assembly, move: Move, contacts: tuple[PrimitiveContact, ...], twists: bytes, count: int, shots: int
) -> tuple[Pose, ...]:
    """See `way`: no error enters it, so that a move certified under other errors has the same; `twists` are bytes."""
    directions = np.frombuffer(twists).reshape(-1, 6).T
    forms = contact_forms(assembly, contacts, contacts)
    twist, poses = move.start.local(move.goal), [move.start]
    gives = [np.zeros(len(contacts))] * count
    for shot in range(1, shots + 1):
        poses = [move.start]
        # Where the last piece of the last shot would end does not matter: it ends at the goal.
        for k in range(count if shot < shots else count - 1):
            guess = gives[k if shot > 1 else max(k - 1, 0)]
            there, gives[k] = _kept(forms, poses[-1], twist / count, directions, guess)
            poses.append(there)
        if shot < shots:
            miss = np.concatenate([move.goal.p - poses[-1].p, se3.log(move.goal.R @ poses.pop().R.T)])
            if np.abs(miss).max() < _AIMED:
                break
            twist = twist + miss
    return (*poses, move.goal)


def _kept(forms: Forms, pose: Pose, twist: Array, directions: Array, give: Array) -> tuple[Pose, Array]:
    """The pose after one twist (6,) and as much compliance as keeps the contacts, added to the twist; and how much.

    Args:
        forms: functions of the contacts (r).
        pose: where to start.
        twist: the twist.
        directions: of compliance (6, r).
        give: a guess (r,) of how much.
    """
    for _ in range(_NEWTON):
        X = twist + directions @ give
        p, R = pose.p + X[:3], se3.exp(X[3:]) @ pose.R
        (f,), (N,) = forms.along(p[None], R[None])
        if np.abs(f).max(initial=0.0) < 1e-16:
            return Pose(p, R), give
        try:
            give = give - np.linalg.solve(N @ directions, f)
        except np.linalg.LinAlgError as error:
            raise InfeasibleError("contacts do not determine their compliant directions") from error
        if not np.abs(give).max() < 1.0:
            break
    if np.abs(f).max() < 1e-12:
        return Pose(p, R), give
    raise InfeasibleError("contacts cannot be held along the move", advice="shorten the move")


def unroll(
    assembly: Assembly, move: Move, reached: Reached, tolerance: Tolerance, step: float, thorough: bool = True
) -> Reached:
    """Certifies a move piece by piece.

    Args:
        assembly: the two parts.
        move: the move.
        reached: where it starts.
        tolerance: velocity error and metric.
        step: greatest turn of one piece, rad.
        thorough: whether to compute how far contacts stay inside their facets, too.

    Raises:
        InfeasibleError: parts overlap nominally on the way, or a step is impossible.
    """
    turn = length(se3.log(move.goal.R @ move.start.R.T))
    count = max(math.ceil(turn / step - 1e-9), 1)
    failure: InfeasibleError | None = None
    # Shorter pieces leave smaller remainders; but the last one must be longer than what errors make the touch differ.
    for pieces in dict.fromkeys((count, 2 * count, -(-2 * count // 3), -(-count // 2), 4 * count, -(-count // 3), 1)):
        try:
            return _unroll(assembly, move, reached, tolerance, pieces, thorough)
        except InfeasibleError as error:
            failure = failure or error
            if turn == 0.0:
                break
    assert failure is not None
    raise failure


def _unroll(
    assembly: Assembly, move: Move, reached: Reached, tolerance: Tolerance, count: int, thorough: bool
) -> Reached:
    errors, steps = reached.errors, list[tuple[Piece, Advance]]()
    basis = tuple(c for c in reached.basis if c.contact not in move.left)
    poses = way(assembly, move, basis, count, _SHOTS if thorough else 1)
    for k, (at, to) in enumerate(pairwise(poses)):
        share = (k / count, (k + 1) / count)
        held = described(assembly, move.held, at, to, errors)
        current = _carried_over(assembly, basis, held, to)
        made = move.making[0] if move.making else None
        piece = Piece(at, to, held, (*held, *move.making), current, made, share, move.left)
        found = stepped(assembly, piece, errors, tolerance)
        steps.append((piece, found))
        errors = found.ends.goal_set
        basis = found.basis if piece.last else current
    # What errors ask of the pieces is known by now: only where all can be followed is the rest worth its while.
    claims = claimed(assembly, steps, tolerance, choose_separations, thorough)
    return Reached(errors, basis, (*reached.claims, *claims))


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
        if any(contact == k.contact for k in rest) or not _same_wall(assembly, gone, contact):
            continue
        now = _rows(assembly, [*(k.contact for k in rest), contact], held, pose)
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


def _same_wall(assembly: Assembly, gone: PrimitiveContact, other: PrimitiveContact) -> bool:
    return other.kind is Kind.VERTEX_FACE and on_wall(assembly, gone, other.fixed_feature)
