"""What a row's linear picture leaves over a piece of motion: second order in the errors, arcs, and turning gradients.

A piece turns by τ and travels Δ, at a constant twist. Its errors (d, ε) stay in a box, |ε| ≤ θ, and are interpolated
between the ends, as are value and gradient of the row. With w = R k, β = R b and y = A p + s, A = σ + [a]×, of a row
n·p + u·w + β·y − c:

A row without b. Turned by ε, u·w changes by u·(ε × w) and, the rest of the exponential as an integral,
−∫(1 − t)(ε × exp(−tε)u)·(ε × w) dt, at most ½|ε × u||ε × w|. On the nominal path it bends off its chord by at most
⅛|τ × u||τ × w|. Its gradient turns along the path, weighted 2s(1 − s) ≤ ½ between the ends: ½|ε × u||τ × w|.

A bilinear row has the Hessian −G in ε, G = (u·w + β·y) − (w uᵀ + β yᵀ) made symmetric, and [β]× A in ε and d.
At a contact u·w + β·y is nearly zero, and the two parts cancel. J = (Aᵀ(τ × β), β × AΔ − G τ) is the derivative of its
gradient along the path, J·(Δ, τ) that of its slope. All are taken at both ends; what they change in between and terms
of third order have closed bounds. A bound by lengths alone serves where it is better.

Pieces of motion with their errors, several at once, and rows over them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import accumulate

import numpy as np

from fmopt.certificate.error_set import UNCOUPLED, ErrorSet
from fmopt.certificate.kernels_rows import Bending, Turned, differing, products
from fmopt.certificate.row_bounds import PieceMotions, over
from fmopt.certificate.rows import Forms, Rows
from fmopt.certificate.tube import powers, varied
from fmopt.runtime.compiled import compiled
from fmopt.spatial.kernels import halves, size
from fmopt.spatial.se3 import Pose, length, lengths
from fmopt.spatial.values import Array, Bits, Indices

_NONE = np.zeros((0, 6))

Reaching = tuple[Array, Array, Array, Array, Array]
"""The columns (…, 6) of a support: generators, roots of slide, swing and shape, and slack."""


@dataclass(frozen=True, eq=False)
class Extent:
    """How far a piece of motion and its errors reach."""

    twist: Array  # V = (Δ, τ) (6,) of the nominal motion, m and rad
    half: Array  # half-widths (6,) of a box around the errors all along, m and rad
    # Greatest rest (2,) that the linear picture leaves of errors in different frames, m and rad
    coupling: Array = field(default_factory=lambda: UNCOUPLED)

    @property
    def turn(self) -> float:
        """|τ|, rad."""
        return length(self.twist[3:])

    @property
    def theta(self) -> float:
        """Bound θ of |ε|, rad."""
        # Half-widths as one vector: no error of the box turns farther.
        return length(self.half[3:])

    @property
    def angles(self) -> Array:
        """Half-widths (3,) of the box around ε, rad."""
        return self.half[3:]

    @property
    def offset(self) -> Array:
        """Half-widths (3,) of the box around the translation error, m."""
        return self.half[:3]


@dataclass(frozen=True, eq=False)
class Curvature:
    """How rows (k) bend over a piece of motion: what of their remainders does not depend on the errors."""

    bending: Bending

    @staticmethod
    def of(start: Rows, goal: Rows, twist: Array) -> Curvature:
        """The curvature of rows over a piece with a twist V (6,), m and rad."""
        w, b, y = (np.array(ends) for ends in zip(start.turned, goal.turned, strict=True))
        return Curvature(Bending(start.forms.table, Turned(w, b, y), np.array(twist)))

    @staticmethod
    def joined(one: Curvature, other: Curvature) -> Curvature:
        """The curvature of the rows of both, over the same piece."""
        (table, turned, twist), (more, ends, _) = one.bending, other.bending
        w, b, y = (np.concatenate(both, axis=1) for both in zip(turned, ends, strict=True))
        return Curvature(Bending(np.concatenate([table, more]), Turned(w, b, y), twist))

    def power(self) -> Array:
        """How N·V, V the twist, changes with the error at the start, to first order: rows (k, 6)."""
        return powers(self.bending)

    def variation(self, half: Array, motion: Array) -> Array:
        """Bound (k,) of how much N·v, v (6,), differs between poses of the piece, errors up to `half` (6,) included."""
        return varied(self.bending, half, motion)

    def inside(self, N: Array, motions: Array, half: Array, drift: Array) -> tuple[Array, Array, float, Array]:
        """How much the last row grows while the others are held, at every pose of the piece and with every error.

        Held rows Nᵢ turn as the last one, N, does. With the combination r = N − Σ aᵢ Nᵢ that gives way to nothing where
        the piece ends, r D = 0 there, it grows by r·(v + w + D λ), with λ what the directions D give way by so that
        Nᵢ·(v + w + D λ) = 0 at each pose: r·v at first order; what r D and λ come to is of second order in what differs
        between the poses. In r·v what turns all rows alike cancels.

        Args:
            N: gradients (2, h + 1, 6) of all rows at both ends.
            motions: v and D (h + 1, 6): the motion inside the held rows at the goal, and directions dual to them there.
            half: half-widths (6,) of a box around the errors, m and rad.
            drift: what else the part may move by in any direction, m and rad (2,).

        Returns:
            how much it grows nominally, at the start and at the goal (2,), and how that changes with the pose (6,);
            what is lost of it at most, infinite where the directions may come not to reach the rows; and |λ| at most
            (h,).
        """
        return _inside(self.bending, N, motions, half, drift)


@compiled
def _inside(bending: Bending, N: Array, motions: Array, half: Array, drift: Array) -> tuple[Array, Array, float, Array]:
    """See `Curvature.inside`."""
    h = len(motions) - 1
    along = products(N, motions)
    shares = np.ones(h + 1)
    for i in range(h):
        shares[i] = -along[1, h, 1 + i]
    own, loose, felt = differing(bending, motions, half, drift, shares)
    grows, lost, given = np.zeros(2), own[h, 0], np.zeros(h)
    for i in range(h + 1):
        grows[0], grows[1] = grows[0] + shares[i] * along[0, i, 0], grows[1] + shares[i] * along[1, i, 0]
        lost += abs(shares[i]) * loose[i]
    turning = 0.5 * (felt[0, 0] + felt[0, 1])
    # (1 + Ε)λ = −η: |λ| ≤ η + Εη/(1 − q), q the largest row sum of Ε.
    eta, most, q = np.empty(h), 0.0, 0.0
    for i in range(h):
        slide, spin = halves(N[1, i])
        eta[i] = max(abs(along[0, i, 0]), abs(along[1, i, 0])) + own[i, 0]
        eta[i] += drift[0] * size(slide) + drift[1] * size(spin) + loose[i]
    for i in range(h):
        total, taken = 0.0, 0.0
        for j in range(h):
            differs = abs(along[0, i, 1 + j] - (1.0 if i == j else 0.0)) + own[i, 1 + j]
            total, taken = total + differs, taken + differs * eta[j]
        q, most = max(q, total), max(most, taken)
    if q >= 1.0:
        return grows, turning, np.inf, given
    for j in range(h):
        given[j] = eta[j] + most / (1.0 - q)
        tied = 0.0
        for i in range(h + 1):
            tied += shares[i] * along[0, i, 1 + j]
        lost += (abs(tied) + own[h, 1 + j]) * given[j]
    return grows, turning, lost, given


@dataclass(frozen=True, eq=False)
class Ends:
    """A piece of motion: nominal poses and error sets at both ends, its extent, and the thickness of its contacts.

    `slack` (6, h) holds the columns T^Sᵢtᵢ: how far the true contact surfaces may push the error at the start, beyond
    the start set's core; `core` (k, 6) its generators, those of the whole start set by default. `form` (m) is how far
    the surfaces of both parts may lie from those planned with.
    """

    start: Pose
    goal: Pose
    start_set: ErrorSet
    goal_set: ErrorSet
    extent: Extent
    slack: Array
    core: Array | None = None
    form: float = 0.0

    @property
    def columns(self) -> tuple[Reaching, Reaching]:
        """What errors reach along rows with at both ends."""
        # Without the old thickness, which at the start is in the slack; the set of everything has it.
        core = self.start_set.generators if self.core is None else self.core
        start, goal = self.start_set, self.goal_set
        return (
            (core, start.slide_root.T, start.swing_root.T, start.shape_root.T, self.slack.T),
            (goal.generators, goal.slide_root.T, goal.swing_root.T, goal.shape_root.T, _NONE),
        )


@dataclass(frozen=True, eq=False)
class EndsBatch:
    """Several pieces of motion (n), of which the same is asked: what `Ends` has of one, at once."""

    motion: PieceMotions

    @staticmethod
    def of(listed: Sequence[Ends]) -> EndsBatch:
        """Pieces of motion together."""
        at, to = zip(*(ends.columns for ends in listed), strict=True)
        columns, cuts = _columns((*at, *to))
        p = np.array([ends.start.p for ends in listed] + [ends.goal.p for ends in listed])
        R = np.array([ends.start.R for ends in listed] + [ends.goal.R for ends in listed])
        twist = np.array([ends.extent.twist for ends in listed])
        half = np.array([ends.extent.half for ends in listed])
        n, coupling = len(listed), np.array([ends.extent.coupling for ends in listed])
        shapes = p.reshape(2, n, 3), R.reshape(2, n, 3, 3), columns.reshape(2, n, *columns.shape[1:])
        return EndsBatch(PieceMotions(*shapes, cuts, twist, half, coupling, listed[0].form))

    def piece(self, n: int) -> EndsBatch:
        """One of the pieces."""
        p, R, columns, cuts, twist, half, coupling, form = self.motion
        if len(twist) == 1:
            return self
        only = np.array([n])
        ends = p[:, only], R[:, only], columns[:, only]
        return EndsBatch(PieceMotions(*ends, cuts, twist[only], half[only], coupling[only], form))

    def ended(self) -> EndsBatch:
        """The same pieces when they have ended, without the motion."""
        p, R, columns, cuts, twist, half, coupling, form = self.motion
        goal = np.array([1, 1])
        # Both ends at the goal: what counts is one pose, and a piece of no motion has the rest of the errors alone.
        return EndsBatch(
            PieceMotions(p[goal], R[goal], columns[goal], cuts, np.zeros_like(twist), half, coupling, form)
        )

    def spread(self, end: int, N: Array) -> Bits:
        """Whether generators and drifts, not the ellipsoid of everything, bound the errors along rows (m, 6): (m,)."""
        # Where the sum is the smaller bound, derivatives of generators are the ones that count.
        first, second, third, fourth = self.motion.cuts.tolist()
        X = N @ self.motion.columns[end, 0].T
        summed = np.abs(X[:, :first]).sum(axis=1) + lengths(X[:, first:second]) + lengths(X[:, second:third])
        return np.asarray(summed <= lengths(X[:, third:fourth]))

    def over(self, forms: Forms) -> Heights:
        """Rows (k) over all pieces."""
        return Heights(*over(forms.table, self.motion))


def _columns(supports: Sequence[Reaching]) -> tuple[Array, Indices]:
    """The columns (n, k, 6) of supports, some zero where others have more, and their cuts (4,)."""
    ends = list(accumulate(max(map(len, parts)) for parts in zip(*supports, strict=True)))
    columns = np.zeros((len(supports), ends[-1], 6))
    for parts, found in zip(supports, columns, strict=True):
        # Columns of zeros reach nowhere: shorter supports are filled up with them.
        for first, part in zip((0, *ends), parts, strict=False):
            found[first : first + len(part)] = part
    return columns, np.array(ends[:4])


@dataclass(frozen=True, eq=False)
class Heights:
    """Rows (k) over pieces of motion (n): at both ends values and gradients, what errors take there, and remainders."""

    f: Array  # values (2, n, k), m
    N: Array  # gradients (2, n, k, 6), m and m/rad
    reach: Array  # how far errors reach along the gradients (2, n, k), m
    rest: Array  # remainders (n, k), m

    @property
    def bounds(self) -> Array:
        """Certified lower bounds (2, n, k) where either end is the worst, m."""
        # The remainder is one for the whole piece, as it is bounded between the ends, not at them.
        return np.asarray(self.f - self.reach - self.rest)

    @property
    def lower(self) -> Array:
        """Certified lower bounds (n, k): worst end, less errors and remainder, m."""
        return np.asarray((self.f - self.reach).min(axis=0) - self.rest)

    def end(self, end: int) -> AtEnd:
        """The rows at one end of the first piece."""
        return AtEnd(self.f[end, 0], self.N[end, 0])


@dataclass(frozen=True, eq=False)
class AtEnd:
    """Rows at one end of a piece: values (k,) and gradients (k, 6), m and m/rad."""

    f: Array
    N: Array
