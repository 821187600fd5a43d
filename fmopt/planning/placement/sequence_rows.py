"""The rows that bound the margin of a sequence, as functions of displacements of all its poses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from fmopt.certificate.assembly import Assembly, contact_rows, made_form, made_scale
from fmopt.certificate.claim import Claim, facet_rows
from fmopt.certificate.piece_pairs import Pair, facing
from fmopt.certificate.remainder import Curvature, EndsBatch
from fmopt.certificate.rows import Forms
from fmopt.certificate.segment_linearisation import Growth, Tolerance
from fmopt.certificate.separating_plane import Separation, counted_rows
from fmopt.contact.primitive import PrimitiveContact
from fmopt.planning.moves.contact_transition import DOUBTED, within_rims
from fmopt.planning.moves.moves import Reached, claims_of_moves
from fmopt.planning.placement.error_derivatives import GeneratorDerivatives, pose_derivatives, sensitivities
from fmopt.spatial.values import Array, Bits, Indices

_STEPS = 4  # steps of the trust region that a row is kept away from where contacts are described otherwise
KEPT = 0.5  # of how far vertices are from there, and of what only has to hold, that a step leaves
_ALIKE = 1e-6  # slopes that differ by less are one


@dataclass(frozen=True, eq=False)
class Linear:
    """Rows (r,) within a trust region: value + slopes·x − Σ|at + slope·x| over its kinks, at least counted·t."""

    values: Array  # at x = 0, kinks and all, m
    slopes: Array  # (r, n)
    counted: Array  # 1 for rows of the margin, or their weight in it; 0 for those that only have to hold
    drifts: Array
    moves: Indices
    kinks: tuple[list[int], list[float], list[Array]]  # row, value and slope (n,) of each product whose sign may change


@dataclass(frozen=True, eq=False)
class SequenceRows:
    """Rows (r,) near binding: their values, with slopes (r, n), and what they lose to k generators of errors."""

    values: Array  # what is left for the margin, m
    slopes: Array  # of the distance (r, n)
    counted: Array  # 1 for rows of the margin, or their weight in it; 0 for those that only have to hold
    drifts: Array  # sizes of gradients (r,)
    moves: Indices  # whose row it is (r,)
    products: Array  # N·g (r, k), m; zero where something else than the generators bounds the errors
    turning: Array  # their slopes (r, k, n)
    reach: Array  # what errors take of the values, to first order (r,), m
    rest: Array  # what remainders take (r,), m

    @staticmethod
    def none(k: int, n: int) -> SequenceRows:
        """No rows at all, of so many generators and displacements."""
        empty = np.zeros(0)
        slopes, generators = np.zeros((0, n)), (np.zeros((0, k)), np.zeros((0, k, n)))
        return SequenceRows(empty, slopes, empty, empty, np.zeros(0, np.intp), *generators, empty, empty)

    @staticmethod
    def joined(parts: Sequence[SequenceRows]) -> SequenceRows:
        """All rows of some, one after the other."""
        names = [field.name for field in fields(SequenceRows)]
        return SequenceRows(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})

    def taken(self, which: Indices | Bits) -> SequenceRows:
        """Some of the rows."""
        return SequenceRows(**{field.name: getattr(self, field.name)[which] for field in fields(SequenceRows)})

    def at(self, x: Array) -> Array:
        """Values (r,) after displacements (n,), m; that longer moves drift farther does not count."""
        more = np.abs(self.products + self.turning @ x) - np.abs(self.products)
        return np.asarray(self.values + self.slopes @ x - more.sum(axis=1))

    def within(self, most: Array, fine: float) -> Linear:
        """The rows that may bind where displacements are no larger than these (n,), and no two that are the same.

        These are in m and rad. Products that change by less than `fine` (m) count as they are.
        """
        spread = np.abs(self.turning) @ most
        signs = np.where(np.abs(self.products) > spread, np.sign(self.products), 0.0)
        slopes = self.slopes - np.einsum("rk,rkn->rn", signs, self.turning)
        bent = (signs == 0.0) & (spread > fine)
        far = np.abs(slopes) @ most
        # What a kink takes at most more than it does where nothing is displaced.
        lost = np.where(bent, spread, 0.0).sum(axis=1)
        counts = self.counted > 0.0
        # No t within the region is larger than this: rows that stay above it everywhere cannot bind.
        top = float(((self.values + far + lost)[counts] / self.counted[counts]).min(initial=np.inf))
        used = self.values - far - lost < np.where(counts, self.counted * top, 0.0)
        rounded = np.column_stack([self.values / fine, slopes / _ALIKE, lost / fine]).round()
        _, first = np.unique(rounded[used], axis=0, return_index=True)
        kept = np.flatnonzero(used)[np.sort(first)]  # in their own order, which np.unique does not keep
        rows, columns = np.nonzero(bent[kept])
        kinks = (rows.tolist(), self.products[kept[rows], columns].tolist(), list(self.turning[kept[rows], columns]))
        return Linear(self.values[kept], slopes[kept], self.counted[kept], self.drifts[kept], self.moves[kept], kinks)


class _Block(NamedTuple):
    """Rows of a piece at one of its ends."""

    N: Array  # gradients (m, 6)
    values: Array  # (m,), what errors and remainders take of them off
    reach: Array  # what errors take (m,)
    rest: Array  # what remainders take (m,)
    end: int
    scale: float = 1.0
    factor: float = 1.0
    counted: float = 1.0  # whether they are rows of the margin


def sequence_rows(
    assembly: Assembly, reached: Reached, tolerance: Tolerance, near: float, drifting: bool = False, felt: bool = True
) -> SequenceRows:
    """Every row of a sequence that is within `near` (m) of binding.

    If `drifting`, it counts in later moves that a longer one drifts farther, too. That leads on where poses are far
    from where they are to be; near there, steps without it ended higher. If `felt`, what ends a move has to be.
    """
    most, moves = reached.margin + near, claims_of_moves(reached.claims)
    sensitivity = iter(found := sensitivities(assembly, reached.claims, tolerance, drifting))
    shape = max((len(each.start[0]) for each in found), default=0), 6 * (len(moves) + 1)
    parts = [SequenceRows.none(*shape)]
    for number, claims in enumerate(moves):
        courses = [EndsBatch.of((claim.advance.ends,)) for claim in claims]
        sure = _surely(assembly, claims[0].piece.held, courses)
        for claim, course in zip(claims, courses, strict=True):
            changing = next(sensitivity)
            binding = _near(assembly, claim, course, tolerance.rho, most)
            if blocks := [*binding, *_described(course, sure, _STEPS * near)]:
                parts.append(_rows(blocks, course, claim, changing, (number, *shape)))
        gains = [gain for claim in claims for gain in _gains(assembly, claim, felt)]
        parts.append(_growing(gains, claims[-1], changing, number, shape))
    return SequenceRows.joined(parts)


def _rows(
    blocks: Sequence[_Block],
    course: EndsBatch,
    claim: Claim,
    sensitivity: GeneratorDerivatives,
    among: tuple[int, int, int],
) -> SequenceRows:
    """Blocks of rows of a piece as functions of displacements (n): `among` are its move's number, generators and n."""
    each = [(*block[:4], *(np.full(len(block.values), number) for number in block[4:])) for block in blocks]
    N, values, reach, rest, ends, scale, factor, counted = map(np.concatenate, zip(*each, strict=True))
    (number, width, n), m = among, len(values)
    gradients = N / scale[:, None]
    slopes, products, turning = np.zeros((m, n)), np.zeros((m, width)), np.zeros((m, width, n))
    for end, share in enumerate(claim.piece.progress):
        at = np.flatnonzero(ends == end)
        own = gradients[at]
        along = own @ sensitivity.held[end]
        change = -sensitivity.drift(own, end)
        change[:, 6 * number : 6 * number + 6] += (1.0 - share) * along
        change[:, 6 * number + 6 : 6 * number + 12] += share * along
        slopes[at] = change
        generators, derivatives = sensitivity.goal if end else sensitivity.start
        if len(generators):
            weight = (factor[at] * course.spread(end, N[at]))[:, None]
            products[at, : len(generators)] = weight * (own @ generators.T)
            turning[at, : len(generators)] = weight[..., None] * np.einsum("mi,kin->mkn", own, derivatives)
    moves, sizes = np.full(m, number, dtype=np.intp), np.linalg.norm(gradients, axis=1)
    return SequenceRows(values / scale, slopes, counted, sizes, moves, products, turning, reach / scale, rest / scale)


@dataclass(frozen=True, eq=False)
class _Gain:
    """How much a row grows along a move, were all of it like a piece; `turned` (6,) by where that ends, as it turns."""

    growth: Growth
    turned: Array
    share: float
    size: float


def _growing(
    gains: list[_Gain], claim: Claim, ending: GeneratorDerivatives, number: int, shape: tuple[int, int]
) -> SequenceRows:
    """The rows that let errors be carried through a move, and its end be felt.

    A contact being made comes nearer all along, as it is and as errors are seen through those held; contacts given up
    get farther away; and a move is longer than errors make its end differ by. `shape` is of generators and
    displacements.
    """
    piece, last, (width, n) = claim.piece, claim.advance, shape
    share, row = piece.progress[1] - piece.progress[0], None
    if last.approach is not None:
        row, whole = last.approach.row, last.approach.nominal / share
        growth = Growth(row, whole, last.overtravel * whole)
        gains = [*gains, _Gain(growth, np.zeros(6), 1.0, growth.lost)]
    m = len(gains)
    slopes, products, turning = np.zeros((m, n)), np.zeros((m, width)), np.zeros((m, width, n))
    if row is not None:
        generators, derivatives = ending.start
        products[-1, : len(generators)] = generators @ row / share
        turning[-1, : len(generators)] = np.einsum("i,kin->kn", row, derivatives) / share
    for slope, gain in zip(slopes, gains, strict=True):
        slope[6 * number : 6 * number + 6] = (1.0 - gain.share) * gain.turned - gain.growth.row
        slope[6 * number + 6 : 6 * number + 12] = gain.share * gain.turned + gain.growth.row
    values, sizes = np.array([(KEPT * gain.growth.least, gain.size) for gain in gains]).reshape(m, 2).T
    none, moves = np.zeros(m), np.full(m, number, dtype=np.intp)
    return SequenceRows(values, slopes, none, none, moves, products, turning, sizes, none)


def _gains(assembly: Assembly, claim: Claim, felt: bool) -> Iterator[_Gain]:
    """What has to grow along a piece: the contact being made nears, and is felt to; those given up get farther away."""
    piece, step = claim.piece, claim.advance
    share, at = piece.progress[1] - piece.progress[0], piece.progress[1]
    twist = piece.start.local(piece.goal)

    def gain(growth: Growth, size: float) -> _Gain:
        whole = Growth(growth.row, growth.nominal / share, growth.lost / share)
        return _Gain(whole, growth.turned / share, at, size / share)

    for growth in step.departures:
        yield gain(growth, growth.lost)
    if piece.made is not None and step.approach is not None:
        yield gain(step.approach, step.approach.lost)
        if not felt:
            return
        rows = contact_rows(assembly, piece.making, (), piece.goal)
        pushed, turned = -rows.N.mean(axis=0), -Curvature.of(rows, rows, twist).power().mean(axis=0)
        yield gain(Growth(pushed, float(pushed @ twist), 0.0, turned), float(np.abs(pushed * twist).sum()))


def _near(assembly: Assembly, claim: Claim, course: EndsBatch, rho: float, most: float) -> Iterator[_Block]:
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
                reach, rest = rows.reach[end, 0, which], rows.rest[0, which]
                yield _Block(N, values[which], reach, rest, end, scale)
    for facet in facet_rows(assembly, claim) if claim.contacts else ():
        for contact, margin in enumerate(facet.table.margins(facet.lower)):
            if margin < most and (slope := facet.table.slope(contact, facet.lower)).any():
                N, taken = (slope @ facet.rows.N)[None], np.array([slope @ (facet.rows.f - facet.lower)])
                yield _Block(N, np.array([margin]), taken, np.zeros(1), facet.end)
    if claim.early is not None and piece.made is not None:
        made = made_form(assembly, piece.made, piece.held).at(piece.start)
        scale = made_scale(assembly, piece.made, piece.held, rho)
        N, early = scale * made.N, np.array([claim.early])
        yield _Block(N, early, scale * made.f - early, np.zeros(1), 0)


def _described(course: EndsBatch, sure: Sequence[tuple[Forms, Indices]], near: float) -> Iterator[_Block]:
    """The rows of a piece that keep the description of its contacts, below `near` (m)."""
    for forms, which in sure:
        rows = course.over(forms)
        for end in (0, 1):
            reach = DOUBTED * rows.reach[end, 0, which]
            room = rows.f[end, 0, which] - reach
            close = room < near
            N = rows.N[end, 0, which[close]]
            if len(N):
                yield _Block(N, KEPT * room[close], reach[close], np.zeros(len(N)), end, 1.0, DOUBTED, 0.0)


def pairs_of(assembly: Assembly, claim: Claim) -> list[tuple[Pair, Separation]]:
    """The pairs of pieces of a claim, with the planes that keep them apart."""
    both = zip(claim.separations, facing(assembly, claim.piece).listed, strict=True)
    return [(pair, kept) for (_, _, kept), (_, _, pair) in both]


def _surely(
    assembly: Assembly, held: tuple[PrimitiveContact, ...], courses: Sequence[EndsBatch]
) -> list[tuple[Forms, Indices]]:
    """How far vertices are within convex rims of walls that they lie in, and which are so for sure all along a move."""
    found = []
    for forms in within_rims(assembly, held):
        rows = [course.over(forms) for course in courses]
        sure = np.all([(each.f - DOUBTED * each.reach)[:, 0] > 0.0 for each in rows], axis=(0, 1))
        if sure.any():
            found.append((forms, np.flatnonzero(sure)))
    return found


class HoldMargin(NamedTuple):
    """How surely a piece of a motion holds its contacts; slopes (12,) by its start and goal, 1/m and 1/rad."""

    claim: int
    share: float
    least: float
    slopes: Array


def hold_rows(
    assembly: Assembly, reached: Reached, tolerance: Tolerance, holds: Sequence[HoldMargin], width: int
) -> SequenceRows:
    """A row for each hold: that it is no less than it has to be, or than it is where it is less; shares on an arm of ρ.

    Rows have so many generators as `width` says; holds lose to none.
    """
    rho, m = tolerance.rho, len(holds)
    numbers = np.cumsum([claim.piece.progress[0] == 0.0 for claim in reached.claims], dtype=np.intp) - 1
    n = 6 * (int(numbers[-1]) + 2)
    slopes, moves = np.zeros((m, n)), np.array([numbers[hold.claim] for hold in holds], dtype=np.intp)
    poses = pose_derivatives(assembly, reached.claims, tolerance) if holds else []
    for row, hold in zip(slopes, holds, strict=True):
        row[:] = rho * hold.slopes @ np.vstack(poses[hold.claim])
    beyond = np.array([KEPT * rho * max(hold.share - hold.least, 0.0) for hold in holds])
    asked, none = np.array([rho * hold.least for hold in holds]), np.zeros(m)
    generators = np.zeros((m, width)), np.zeros((m, width, n))
    return SequenceRows(beyond, slopes, none, none, moves, *generators, asked, none)
