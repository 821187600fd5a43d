"""The rows that bound the margin of a sequence, as functions of displacements of all its poses.

How the errors along a sequence of moves change as the poses do that its moves start from and go to.

A move takes errors up along its own direction: of a contact that is made, along the motion v by which it is made, and
of one that is held, along the motion C by which it was. Where a pose is displaced, v turns, and with it

    Π = Π_h + φ v N′ᵀ/rate,   Π_h = 1 − C (N_h C)⁻¹ N_h,   N′ = Π_hᵀ N_m,   rate = −N_m·v,

of this move and of all later ones that hold the contact. Rows N count as they are: what turns them is second order.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from fmopt.certificate.assembly import Assembly, made_form, made_scale
from fmopt.certificate.claim import Claim, facet_rows
from fmopt.certificate.piece_pairs import Pair, pairs
from fmopt.certificate.remainder import Course, Ends
from fmopt.certificate.rows import Forms
from fmopt.certificate.segment_linearisation import Linearisation, Piece, Tolerance, linearisation_of
from fmopt.certificate.separating_plane import Separation, counted_rows
from fmopt.contact.primitive import PrimitiveContact
from fmopt.planning.moves.contact_transition import DOUBTED, within_rims
from fmopt.planning.moves.moves import Reached, claims_of_moves
from fmopt.spatial import ellipsoid
from fmopt.spatial.values import Array

_STEPS = 4  # steps of the trust region that a row is kept away from where contacts are described otherwise
KEPT = 0.5  # of how far vertices are from there
_ALIKE = 1e-6  # slopes that differ by less are one


@dataclass(frozen=True, eq=False)
class Linear:
    """Rows (r,) within a trust region: value + slopes·x − Σ|at + slope·x| over its kinks, at least counted·t.

    Args:
        values: at x = 0, kinks and all, m.
        slopes: (r, n).
        counted: 1 for rows of the margin, 0 for those that only have to hold.
        drifts: sizes of gradients, of which the velocity error takes its share.
        moves: whose row it is.
        kinks: row, value and slope (n,) of each product whose sign may change.
    """

    values: Array
    slopes: Array
    counted: Array
    drifts: Array
    moves: NDArray[np.intp]
    kinks: tuple[list[int], list[float], list[Array]]


@dataclass(frozen=True, eq=False)
class SequenceRows:
    """Rows (r,) near binding: their values, with slopes (r, n), and what they lose to k generators of errors.

    Args:
        values: what is left for the margin, m.
        slopes: of the distance (r, n).
        counted: 1 for rows of the margin, 0 for those that only have to hold.
        drifts: sizes of gradients (r,).
        moves: whose row it is (r,).
        products: N·g (r, k), m; zero where something else than the generators bounds the errors.
        turning: their slopes (r, k, n).
    """

    values: Array
    slopes: Array
    counted: Array
    drifts: Array
    moves: NDArray[np.intp]
    products: Array
    turning: Array

    @staticmethod
    def none(k: int, n: int) -> SequenceRows:
        """No rows at all, of so many generators and displacements."""
        empty = np.zeros(0)
        return SequenceRows(
            empty, np.zeros((0, n)), empty, empty, np.zeros(0, np.intp), np.zeros((0, k)), np.zeros((0, k, n))
        )

    @staticmethod
    def joined(parts: Sequence[SequenceRows]) -> SequenceRows:
        """All rows of some, one after the other."""
        names = [field.name for field in fields(SequenceRows)]
        return SequenceRows(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})

    def within(self, most: Array, fine: float) -> Linear:
        """The rows that may bind where displacements are no larger than these (n,), and no two that are the same.

        Products that change by less than `fine` (m) count as they are.
        """
        spread = np.abs(self.turning) @ most
        signs = np.where(np.abs(self.products) > spread, np.sign(self.products), 0.0)
        slopes = self.slopes - np.einsum("rk,rkn->rn", signs, self.turning)
        bent = (signs == 0.0) & (spread > fine)
        far = np.abs(slopes) @ most
        # What a kink takes at most more than it does where nothing is displaced.
        lost = np.where(bent, spread, 0.0).sum(axis=1)
        top = float((self.values + far + lost)[self.counted > 0.0].min(initial=np.inf))
        used = self.values - far - lost < np.where(self.counted > 0.0, top, 0.0)
        rounded = np.column_stack([self.values / fine, slopes / _ALIKE, lost / fine]).round()
        _, first = np.unique(rounded[used], axis=0, return_index=True)
        kept = np.flatnonzero(used)[np.sort(first)]
        rows, columns = np.nonzero(bent[kept])
        kinks = (
            rows.tolist(),
            self.products[kept[rows], columns].tolist(),
            list(self.turning[kept[rows], columns]),
        )
        return Linear(self.values[kept], slopes[kept], self.counted[kept], self.drifts[kept], self.moves[kept], kinks)


@dataclass(frozen=True, eq=False)
class _Block:
    """Rows of a piece at one of its ends: gradients N (m, 6), values (m,), and whether errors are bounded by g (m,)."""

    N: Array
    values: Array
    end: int
    spread: NDArray[np.bool_]
    scale: float = 1.0
    factor: float = 1.0
    counted: float = 1.0


def sequence_rows(assembly: Assembly, reached: Reached, tolerance: Tolerance, near: float) -> SequenceRows:
    """Every row of a sequence that is within `near` (m) of binding."""
    most, moves = reached.margin + near, claims_of_moves(reached.claims)
    sensitivity = iter(found := sensitivities(assembly, reached.claims, tolerance))
    shape = max((len(each.start[0]) for each in found), default=0), 6 * (len(moves) + 1)
    parts = [SequenceRows.none(*shape)]
    for number, claims in enumerate(moves):
        courses = [Course.of((claim.advance.ends,)) for claim in claims]
        sure = _surely(assembly, claims[0].piece.held, courses)
        for claim, course in zip(claims, courses, strict=True):
            changing = next(sensitivity)
            blocks = chain(_near(assembly, claim, course, tolerance.rho, most), _described(course, sure, _STEPS * near))
            parts += [_rows(block, claim, changing, number, shape) for block in blocks]
    return SequenceRows.joined(parts)


def _rows(block: _Block, claim: Claim, sensitivity: Sensitivity, number: int, shape: tuple[int, int]) -> SequenceRows:
    """A block of rows of a move as functions of all displacements (n), with up to so many generators."""
    (width, n), share, m = shape, claim.piece.progress[block.end], len(block.values)
    N = block.N / block.scale
    slopes = np.zeros((m, n))
    slopes[:, 6 * number : 6 * number + 6] = (1.0 - share) * N
    slopes[:, 6 * number + 6 : 6 * number + 12] = share * N
    generators, derivatives = sensitivity.goal if block.end else sensitivity.start
    products, turning = np.zeros((m, width)), np.zeros((m, width, n))
    if len(generators):
        weight = block.factor * block.spread[:, None]
        products[:, : len(generators)] = weight * (N @ generators.T)
        turning[:, : len(generators)] = weight[..., None] * np.einsum("mi,kin->mkn", N, derivatives)
    counted, moves = np.full(m, block.counted), np.full(m, number, dtype=np.intp)
    sizes = np.linalg.norm(N, axis=1)
    return SequenceRows(block.values / block.scale, slopes, counted, sizes, moves, products, turning)


def _near(assembly: Assembly, claim: Claim, course: Course, rho: float, most: float) -> Iterator[_Block]:
    """The rows of a piece that are below `most` (m)."""
    piece = claim.piece
    for pair, kept in pairs_of(assembly, claim):
        if kept.margin > most:
            continue
        counted = counted_rows(assembly, pair, kept.witness)
        rows = course.over(counted.forms)
        counts = counted.counts(rows.lower[0])
        ends = claim.advance.ends
        scale = counted.scale(ends.start, ends.goal, ends.extent)
        for end in (0, 1):
            values = rows.bounds[end, 0]
            which = np.flatnonzero(counts & (values < most * scale))
            if len(which):
                N = rows.N[end, 0, which]
                yield _Block(N, values[which], end, course.spread(end, N), scale)
    for facet in facet_rows(assembly, claim) if claim.contacts else ():
        for contact, margin in enumerate(facet.table.margins(facet.lower)):
            if margin < most and (slope := facet.table.slope(contact, facet.lower)).any():
                N = (slope @ facet.rows.N)[None]
                yield _Block(N, np.array([margin]), facet.end, course.spread(facet.end, N))
    if claim.early is not None and piece.made is not None:
        made = made_form(assembly, piece.made, piece.held).at(piece.start)
        scale = made_scale(assembly, piece.made, piece.held, rho)
        N = scale * made.N
        yield _Block(N, np.array([claim.early]), 0, course.spread(0, N))


def _described(course: Course, sure: Sequence[tuple[Forms, NDArray[np.intp]]], near: float) -> Iterator[_Block]:
    """The rows of a piece that keep the description of its contacts, below `near` (m)."""
    for forms, which in sure:
        rows = course.over(forms)
        for end in (0, 1):
            room = rows.f[end, 0, which] - DOUBTED * rows.reach[end, 0, which]
            close = room < near
            N = rows.N[end, 0, which[close]]
            if len(N):
                yield _Block(N, KEPT * room[close], end, course.spread(end, N), 1.0, DOUBTED, 0.0)


def pairs_of(assembly: Assembly, claim: Claim) -> list[tuple[Pair, Separation]]:
    """The pairs of pieces of a claim, with the planes that keep them apart."""
    found = pairs(assembly, claim.piece)
    return [(pair, kept) for (_, _, kept), (_, _, pair) in zip(claim.separations, found, strict=True)]


def _surely(
    assembly: Assembly, held: tuple[PrimitiveContact, ...], courses: Sequence[Course]
) -> list[tuple[Forms, NDArray[np.intp]]]:
    """How far vertices are within convex rims of walls that they lie in, and which are so for sure all along a move."""
    found = []
    for forms in within_rims(assembly, held):
        rows = [course.over(forms) for course in courses]
        sure = np.all([(each.f - DOUBTED * each.reach)[:, 0] > 0.0 for each in rows], axis=(0, 1))
        if sure.any():
            found.append((forms, np.flatnonzero(sure)))
    return found


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """The generators (k, 6) that a piece carries on, at both ends, and their derivatives (k, 6, n).

    Derivatives are with respect to displacements (d, δ) of all poses one after the other, n = 6 (moves + 1).
    """

    start: tuple[Array, Array]
    goal: tuple[Array, Array]


def sensitivities(assembly: Assembly, claims: Sequence[Claim], tolerance: Tolerance) -> list[Sensitivity]:
    """How generators change along a sequence of moves, piece by piece.

    Args:
        assembly: the two parts.
        claims: of all pieces of the moves, in order.
        tolerance: velocity error and metric.
    """
    n = 6 + 6 * sum(claim.piece.progress[0] == 0.0 for claim in claims)
    found, number = list[Sensitivity](), -1
    changed, turned = np.zeros((0, 6, n)), dict[bytes, Array]()
    for claim in claims:
        piece, ends = claim.piece, claim.advance.ends
        number += piece.progress[0] == 0.0
        core, share = carried_on(ends), piece.progress[1] - piece.progress[0]
        displaced = np.zeros((6, n))
        displaced[:, 6 * number : 6 * number + 6] = -share * np.eye(6)
        displaced[:, 6 * number + 6 : 6 * number + 12] = share * np.eye(6)
        before = np.zeros((len(core), 6, n))
        before[: len(changed)] = changed[: len(core)]
        moved = _Moved.of(piece, linearisation_of(assembly, piece, tolerance), turned, displaced)
        changed = moved.carried(core, before)
        found.append(Sensitivity((core, before), (ends.goal_set.generators[: len(core)], changed)))
        if piece.last and piece.made is not None:
            turned[claim.advance.basis[-1].direction.tobytes()] = moved.direction(ellipsoid.metric(tolerance.rho))
    return found


def carried_on(ends: Ends) -> Array:
    """The generators (k, 6) that a piece carries on."""
    return ends.start_set.generators if ends.core is None else ends.core


@dataclass(frozen=True, eq=False)
class _Moved:
    """A piece of motion, and how it changes.

    Args:
        way: its linear picture.
        share: φ.
        inverse: (N_h C)⁻¹ (h, h).
        compliant: derivatives of the twists C (h, 6, n).
        motion: derivative of v (6, n).
    """

    way: Linearisation
    share: float
    inverse: Array
    compliant: Array
    motion: Array

    @staticmethod
    def of(piece: Piece, way: Linearisation, turned: dict[bytes, Array], displaced: Array) -> _Moved:
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

    def carried(self, generators: Array, before: Array) -> Array:
        """The derivatives (k, 6, n) at the end, of generators (k, 6) with derivatives (k, 6, n) at the start."""
        projector = self.way.hold if self.way.made is None else self.way.projector
        after = np.array([self._projected(g) for g in generators]).reshape(before.shape)
        return np.asarray(after + np.einsum("ij,kjn->kin", projector, before))

    def direction(self, metric: Array) -> Array:
        """The derivative (6, n) of the motion's direction, of length one in a metric (6,)."""
        v, size = self.way.motion, float(np.linalg.norm(self.way.motion * metric))
        return np.asarray(self.motion / size - np.outer(v, (v * metric**2) @ self.motion) / size**3)
