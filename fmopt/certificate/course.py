"""Pieces of motion with their errors, several at once, and rows over them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from fmopt.certificate.curvature import Extent
from fmopt.certificate.lower import Motion, over
from fmopt.certificate.rows import Forms, Mask
from fmopt.se3 import Pose, lengths
from fmopt.uncertainty.error_set import ErrorSet
from fmopt.values import Array

_NONE = np.zeros((0, 6))

Reaching = tuple[Array, Array, Array, Array, Array]
"""The columns (…, 6) of a support: generators, roots of slide, swing and shape, and slack."""


@dataclass(frozen=True, eq=False)
class Ends:
    """A piece of motion: nominal poses and error sets at both ends, its extent, and the thickness of its contacts.

    `slack` (6, h) holds the columns T^Sᵢtᵢ: how far the true contact surfaces may push the error at the start, beyond
    the start set's core; `core` (k, 6) its generators, those of the whole start set by default.
    """

    start: Pose
    goal: Pose
    start_set: ErrorSet
    goal_set: ErrorSet
    extent: Extent
    slack: Array
    core: Array | None = None

    @property
    def columns(self) -> tuple[Reaching, Reaching]:
        """What errors reach along rows with at both ends."""
        core = self.start_set.generators if self.core is None else self.core
        start, goal = self.start_set, self.goal_set
        return (
            (core, start.slide_root.T, start.swing_root.T, start.shape_root.T, self.slack.T),
            (goal.generators, goal.slide_root.T, goal.swing_root.T, goal.shape_root.T, _NONE),
        )


@dataclass(frozen=True, eq=False)
class Course:
    """Several pieces of motion (n), of which the same is asked: what `Ends` has of one, at once."""

    motion: Motion

    @staticmethod
    def of(listed: Sequence[Ends]) -> Course:
        """Pieces of motion together."""
        at, to = zip(*(ends.columns for ends in listed), strict=True)
        columns, cuts = _columns((*at, *to))
        p = np.array([ends.start.p for ends in listed] + [ends.goal.p for ends in listed])
        R = np.array([ends.start.R for ends in listed] + [ends.goal.R for ends in listed])
        twist = np.array([ends.extent.twist for ends in listed])
        half = np.array([ends.extent.half for ends in listed])
        n, coupling = len(listed), np.array([ends.extent.coupling for ends in listed])
        shapes = p.reshape(2, n, 3), R.reshape(2, n, 3, 3), columns.reshape(2, n, *columns.shape[1:])
        return Course(Motion(*shapes, cuts, twist, half, coupling))

    def piece(self, n: int) -> Course:
        """One of the pieces."""
        p, R, columns, cuts, twist, half, coupling = self.motion
        if len(twist) == 1:
            return self
        only = np.array([n])
        return Course(Motion(p[:, only], R[:, only], columns[:, only], cuts, twist[only], half[only], coupling[only]))

    def ended(self) -> Course:
        """The same pieces when they have ended, without the motion."""
        p, R, columns, cuts, twist, half, coupling = self.motion
        goal = np.array([1, 1])
        return Course(Motion(p[goal], R[goal], columns[goal], cuts, np.zeros_like(twist), half, coupling))

    def spread(self, end: int, N: Array) -> Mask:
        """Whether generators and drifts, not the ellipsoid of everything, bound the errors along rows (m, 6): (m,).

        Args:
            end: of the first piece.
            N: the rows.
        """
        first, second, third, fourth = self.motion.cuts.tolist()
        X = N @ self.motion.columns[end, 0].T
        summed = np.abs(X[:, :first]).sum(axis=1) + lengths(X[:, first:second]) + lengths(X[:, second:third])
        return np.asarray(summed <= lengths(X[:, third:fourth]))

    def over(self, forms: Forms) -> Heights:
        """Rows (k) over all pieces."""
        return Heights(*over(forms.table, self.motion))


def _columns(supports: Sequence[Reaching]) -> tuple[Array, NDArray[np.intp]]:
    """The columns (n, k, 6) of supports, some zero where others have more, and their cuts (4,)."""
    ends = list(accumulate(max(map(len, parts)) for parts in zip(*supports, strict=True)))
    columns = np.zeros((len(supports), ends[-1], 6))
    for parts, found in zip(supports, columns, strict=True):
        for first, part in zip((0, *ends), parts, strict=False):
            found[first : first + len(part)] = part
    return columns, np.array(ends[:4])


@dataclass(frozen=True, eq=False)
class Heights:
    """Rows (k) over pieces of motion (n): at both ends values and gradients, what errors take there, and remainders.

    Args:
        f: values (2, n, k), m.
        N: gradients (2, n, k, 6), m and m/rad.
        reach: how far errors reach along the gradients (2, n, k), m.
        rest: remainders (n, k), m.
    """

    f: Array
    N: Array
    reach: Array
    rest: Array

    @property
    def bounds(self) -> Array:
        """Certified lower bounds (2, n, k) where either end is the worst, m."""
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
