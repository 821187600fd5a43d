"""How the errors along a sequence of moves, and the poses of its pieces, change as those do that its moves go to.

A move takes errors up along its own direction: of a contact that is made, along the motion v by which it is made, and
of one that is held, along the motion C by which it was. Where a pose is displaced, v turns, and with it

    Π = Π_h + φ v N′ᵀ/rate,   Π_h = 1 − C (N_h C)⁻¹ N_h,   N′ = Π_hᵀ N_m,   rate = −N_m·v,

of this move and of all later ones that hold the contact. Rows N count as they are: what turns them is second order.

All pieces of a move share one twist τ per unit of progress, but for the compliance that keeps the held contacts: a
piece that is a share a of the move goes a (τ + C g). With A = diag(1, exp ω) and J = diag(1, J_l(ω)) of its turn ω, a
displacement ε of its start goes on as

    ε′ = Π_h (A ε + a J (∂τ + ∂C g)),

and ∂τ is what brings the last one to the goal of the move. The twists C are motions by which contacts were made: they
turn with the poses of the moves before, and so does what gives way by more or less than in the first piece.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.claim import Claim
from fmopt.certificate.segment_linearisation import Linearisation, Piece, Tolerance, linearisation_of
from fmopt.planning.moves.moves import claims_of_moves
from fmopt.spatial import ellipsoid
from fmopt.spatial.se3 import Pose, exp, left_jacobian
from fmopt.spatial.values import Array, remembered

_STANDSTILL = 1e-12  # m
_RANK = 1e-9  # of the largest singular value, what counts as none


@dataclass(frozen=True, eq=False)
class GeneratorDerivatives:
    """The generators (k, 6) that a piece carries on, at both ends, and their derivatives (k, 6, n).

    Derivatives are with respect to displacements (d, δ) of all poses one after the other, n = 6 (moves + 1).
    """

    start: tuple[Array, Array]
    goal: tuple[Array, Array]
    # Maps (6, 6) of displacements at both ends to their rest once compliance has kept the held contacts
    held: tuple[Array, Array]
    compliant: Array  # derivatives of the twists along which the contacts of the held basis give way (h, 6, n)
    brought: tuple[Array, Array]  # what errors at the end of each move before have become at both ends (k, 6, 6)
    longer: Array  # how much longer displacements make these moves (k, n)
    rates: tuple[float, float]  # velocity errors per unit of length, in translation and in angle (1/m)

    def drift(self, N: Array, end: int) -> Array:
        """How displacements (n,) change what drift before takes of rows N (m, 6) at end 0 or 1: (m, n)."""
        there = np.einsum("mi,kij->mkj", N, self.brought[end])
        t, r = (np.linalg.norm(half, axis=-1) for half in (there[..., :3], there[..., 3:]))
        return np.asarray((self.rates[0] * t + self.rates[1] * r) @ self.longer)


@remembered(1)  # rows of the same sequence ask twice: those of the certificate, then those of holds
def sensitivities(
    assembly: Assembly, claims: tuple[Claim, ...], tolerance: Tolerance, drifting: bool = False
) -> tuple[GeneratorDerivatives, ...]:
    """How generators change along a sequence of moves, piece by piece, with drift that grows with the moves or not."""
    n = 6 + 6 * sum(claim.piece.progress[0] == 0.0 for claim in claims)
    found, number = list[GeneratorDerivatives](), -1
    brought, longer, begun = np.zeros((0, 6, 6)), np.zeros((0, n)), Pose(np.zeros(3), np.eye(3))
    translation, rotation = tolerance.velocity_error
    rates = translation, rotation / tolerance.rho
    changed, turned = np.zeros((0, 6, n)), dict[bytes, Array]()
    for claim in claims:
        piece, ends = claim.piece, claim.advance.ends
        number += piece.progress[0] == 0.0
        core = ends.start_set.generators if ends.core is None else ends.core
        share = piece.progress[1] - piece.progress[0]
        displaced = np.zeros((6, n))
        displaced[:, 6 * number : 6 * number + 6] = -share * np.eye(6)
        displaced[:, 6 * number + 6 : 6 * number + 12] = share * np.eye(6)
        # Thickness comes last among generators: what is not carried on is cut off, what has come anew does not change.
        before = np.zeros((len(core), 6, n))
        before[: len(changed)] = changed[: len(core)]
        moved = _Moved.of(piece, linearisation_of(assembly, piece, tolerance), turned, displaced)
        changed = moved.carried(core, before)
        onward, now = moved.projector @ brought, (ends.goal_set.generators[: len(core)], changed)
        held = np.eye(6) - moved.way.start_dual @ moved.way.held[0].N, moved.way.hold
        found.append(GeneratorDerivatives((core, before), now, held, moved.compliant, (brought, onward), longer, rates))
        brought, begun = onward, piece.start if piece.progress[0] == 0.0 else begun
        if piece.last and drifting:
            brought = np.concatenate([onward, np.eye(6)[None]])
            longer = np.vstack([longer, _longer(begun, piece.goal, number, n, tolerance.rho)])
        if piece.last and piece.made is not None:
            # Later bases carry this very direction along: its bytes tell whose derivative they need.
            turned[claim.advance.basis[-1].direction.tobytes()] = moved.direction(ellipsoid.metric(tolerance.rho))
    return tuple(found)


def _longer(start: Pose, goal: Pose, number: int, n: int, rho: float) -> Array:
    """How much longer, in the metric of ρ, displacements (n,) make a move, by its number."""
    metric = ellipsoid.metric(rho)
    way = start.local(goal) * metric
    along, found = way / max(float(np.linalg.norm(way)), _STANDSTILL) * metric, np.zeros(n)
    found[6 * number : 6 * number + 6], found[6 * number + 6 : 6 * number + 12] = -along, along
    return found


def pose_derivatives(assembly: Assembly, claims: tuple[Claim, ...], tolerance: Tolerance) -> list[tuple[Array, Array]]:
    """The derivatives (6, n) of the start and of the goal of each piece, m and rad.

    They are with respect to displacements (d, δ) of all poses that moves start from or go to, n = 6 (moves + 1), inside
    the held contacts.
    """
    moves, changing = claims_of_moves(claims), iter(sensitivities(assembly, claims, tolerance))
    displaced, found = np.eye(6 * (len(moves) + 1)), list[tuple[Array, Array]]()
    for number, pieces in enumerate(moves):
        changes = [next(changing) for _ in pieces]
        ways = [linearisation_of(assembly, claim.piece, tolerance) for claim in pieces]
        shares = [claim.piece.progress[1] - claim.piece.progress[0] for claim in pieces]
        start, goal = displaced[6 * number : 6 * number + 12].reshape(2, 6, -1)
        ends = changes[0].held[0] @ start, changes[-1].held[1] @ goal
        found += pairwise(_between(ways, shares, changes[0].compliant, ends))
    return found


def _between(
    ways: Sequence[Linearisation], shares: Sequence[float], compliant: Array, ends: tuple[Array, Array]
) -> list[Array]:
    """The derivatives (6, n) of all poses of a move in k pieces, from those of its start and its goal, its `ends`.

    Twists along which held contacts give way have the derivatives `compliant` (h, 6, n).
    """
    # As the twist stays, and with the twist: what all pieces give way by alike is part of it.
    (start, goal), first = ends, ways[0].twist / shares[0]
    still, driven = [start], [np.zeros((6, 6))]
    for way, share in zip(ways, shares, strict=True):
        turn = way.twist[3:]
        onward, twisted = _turning(exp(turn)), share * _turning(left_jacobian(turn))
        gives = np.linalg.lstsq(way.directions.T, way.twist / share - first, rcond=_RANK)[0]
        still.append(way.hold @ (onward @ still[-1] + twisted @ np.tensordot(gives, compliant, 1)))
        driven.append(way.hold @ (onward @ driven[-1] + twisted))
    aimed = np.linalg.lstsq(driven[-1], goal - still[-1], rcond=_RANK)[0]  # nothing is driven against held contacts
    return [at + by @ aimed for at, by in zip(still, driven, strict=True)]


def _turning(by: Array) -> Array:
    """diag(1, by) (6, 6)."""
    found = np.eye(6)
    found[3:, 3:] = by
    return found


@dataclass(frozen=True, eq=False)
class _Moved:
    """A piece of motion, and how it changes."""

    way: Linearisation
    share: float
    inverse: Array  # (N_h C)⁻¹ (h, h)
    compliant: Array  # derivatives of the twists C (h, 6, n)
    motion: Array  # derivative of v (6, n)

    @staticmethod
    def of(piece: Piece, way: Linearisation, turned: dict[bytes, Array], displaced: Array) -> "_Moved":
        """With derivatives of compliant twists, and of the commanded motion (6, n)."""
        none = np.zeros_like(displaced)
        directions = [c.direction for c in piece.basis]
        compliant = np.array([turned.get(c.tobytes(), none) for c in directions]).reshape(-1, *displaced.shape)
        C = np.array(directions).reshape(-1, 6).T
        inverse = ellipsoid.coupling_inverse(way.held[1].N, C) if directions else np.zeros((0, 0))
        begun = _Moved(way, piece.share, inverse, compliant, none)
        return _Moved(way, piece.share, inverse, compliant, begun._held(way.twist) + way.hold @ displaced)

    def _held(self, x: Array) -> Array:
        """The derivative of Π_h x (6, n)."""
        taken = self.inverse @ (self.way.held[1].N @ x)
        return np.asarray(-self.way.hold @ np.tensordot(taken, self.compliant, 1))

    def _projected(self, x: Array) -> Array:
        """The derivative of Π x (6, n)."""
        way, held = self.way, self._held(x)
        if way.made is None:
            return held
        N, v, seen = way.made[1].N[0], way.motion, float(way.seen @ x)
        slower = N @ self.motion  # −∂rate
        closing = self.motion * seen + np.outer(v, N @ held + seen / way.rate * slower)
        return np.asarray(held + self.share / way.rate * closing)

    @property
    def projector(self) -> Array:
        """How errors go on along the piece (6, 6)."""
        return self.way.hold if self.way.made is None else self.way.projector

    def carried(self, generators: Array, before: Array) -> Array:
        """The derivatives (k, 6, n) at the end, of generators (k, 6) with derivatives (k, 6, n) at the start."""
        after = np.array([self._projected(g) for g in generators]).reshape(before.shape)
        return np.asarray(after + np.einsum("ij,kjn->kin", self.projector, before))

    def direction(self, metric: Array) -> Array:
        """The derivative (6, n) of the motion's direction, of length one in a metric (6,)."""
        v, size = self.way.motion, float(np.linalg.norm(self.way.motion * metric))
        return np.asarray(self.motion / size - np.outer(v, (v * metric**2) @ self.motion) / size**3)
