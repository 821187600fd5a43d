"""Contacts about a pose to first order, a wrench on the axes that give way, and the twists that escape from contacts.

A twist of the axes that give way is an escape from a set of contacts if the wrench works along it and each contact
opens by more than friction times how fast it slides: no friction up to there holds the part on these contacts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fmopt.contact.c_surface import LEVEL, Surfaces, contact_point, sliding_maps
from fmopt.contact.primitive import feature_distances, near_contacts
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.plan.press_rows import FREE_OF_JAMS
from fmopt.planning.optimise.cone_program import ConeProgram, Norm
from fmopt.planning.optimise.solvers import ClarabelSolver
from fmopt.spatial.se3 import Pose, cross
from fmopt.spatial.values import Array, Bits, Value

_MOST = 72  # contacts that are looked at, nearest first
_POWER = 1e-5  # of a wrench along a twist of size 1, from which the twist counts as an escape
_BESIDE = 0.5  # of the clearance, that a feature may be outside of the bounds of another
_FINE = 2e-4  # of friction


@dataclass(frozen=True, eq=False)
class Touches(Value, f=(None,), N=("f", 6), T=("f", 2, 6)):
    """k contacts about a pose: distances f (k,), m, gradients N (k, 6), and T (k, 2, 6) to speeds along the surface."""

    names: tuple[str, ...]
    f: Array
    N: Array
    T: Array

    @staticmethod
    def near(
        moving: Polyhedron, fixed: Polyhedron, pose: Pose, reach: float, angle: float, clearance: float
    ) -> Touches:
        """Contacts that a shift, m, and a turn, rad, can make, nearest first.

        Their features are as far apart as their surfaces, to half the clearance, m: beyond its bounds none is a wall.
        """
        found = near_contacts(moving, fixed, pose, reach, angle)
        surfaces = Surfaces.of(found, moving, fixed)
        f, N = surfaces.values_and_rows(pose)
        apart = _BESIDE * clearance
        beside = np.abs(feature_distances(found, moving, fixed, pose) - np.abs(f))
        real = (beside < apart) & (-apart < f) & (f < reach) & (surfaces.sines(pose) >= LEVEL)
        order = [k for k in np.argsort(f, kind="stable").tolist() if real[k]][:_MOST]
        arms = [contact_point(found[k], moving, fixed, pose) - pose.p for k in order]
        return Touches.at([found[k].id for k in order], f[order], N[order, :3], np.reshape(arms, (-1, 3)))

    @staticmethod
    def at(names: Sequence[str], f: Array, normals: Array, arms: Array) -> Touches:
        """Contacts at arms (k, 3), m, from the pose's origin, along unit normals (k, 3) into the moving part."""
        return Touches(tuple(names), f, np.hstack([normals, cross(arms, normals)]), sliding_maps(normals, arms))

    def __len__(self) -> int:
        return len(self.f)

    def some(self, which: Bits | Sequence[int]) -> Touches:
        """Those of a mask (k,), or of numbers."""
        at = np.flatnonzero(which) if isinstance(which, np.ndarray) else np.array(which, dtype=np.intp)
        return Touches(tuple(self.names[k] for k in at.tolist()), self.f[at], self.N[at], self.T[at])


@dataclass(frozen=True, eq=False)
class PressWrench:
    """A wrench (6,), N and N·m about the pose's origin, on the axes that give way; turns count by `rho`, m."""

    wrench: Array
    gives: Bits
    rho: float

    @cached_property
    def scale(self) -> Array:
        """Lengths (6,) that units of a twist count for."""
        return np.array([1.0] * 3 + [self.rho] * 3)

    @cached_property
    def free(self) -> Array:
        """The wrench on the axes that give way, in N."""
        return np.asarray((self.wrench / self.scale)[self.gives])

    @property
    def size(self) -> float:
        """Its length, N."""
        return float(np.linalg.norm(self.free))

    def rows(self, N: Array) -> Array:
        """Gradients or maps (…, 6) on the axes that give way, for scaled twists."""
        return np.asarray((N / self.scale)[..., self.gives])

    def twist(self, u: Array) -> Array:
        """A scaled twist of the axes that give way as a whole one (6,)."""
        return self._whole(u) / self.scale

    def whole(self, w: Array) -> Array:
        """A wrench on the axes that give way, in N, as a whole one (6,), the others as they are."""
        return np.where(self.gives, self._whole(w) * self.scale, self.wrench)

    def _whole(self, values: Array) -> Array:
        found = np.zeros(6)
        found[self.gives] = values
        return found


def escape(touches: Touches, push: PressWrench, friction: float) -> ConeProgram:
    """The program over a scaled twist of size 1 and the margin by which it escapes from contacts at some friction."""
    N, T = push.rows(touches.N), push.rows(touches.T)
    k, n = N.shape
    margins = np.append(np.linalg.norm(N, axis=1), [1.0, 0.0])
    rows = np.hstack([np.vstack([N, push.free / push.size, np.zeros(n)]), -margins[:, None]])
    norms = [Norm(np.hstack([t, np.zeros((2, 1))]), np.zeros(2)) for t in T] + [Norm(np.eye(n, n + 1), np.zeros(n))]
    W = np.diag(np.append(np.full(k + 1, friction), 1.0))[:, [*range(k), k + 1]]
    return ConeProgram(np.append(np.zeros(n), 1.0), G=rows, h=np.append(np.zeros(k + 1), 1.0), W=W, norms=tuple(norms))


def frictions(touches: Touches, push: PressWrench, twist: Array) -> Array:
    """The friction (k,) up to which a twist (6,) escapes from each contact; below 0 where it does not."""
    if push.wrench @ twist <= _POWER * push.size * np.linalg.norm(twist * push.scale):
        return np.full(len(touches), -1.0)
    opens, slides = touches.N @ twist, np.linalg.norm(touches.T @ twist, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(opens < 0.0, -1.0, np.where(slides > 0.0, opens / slides, np.inf))


def escaped(touches: Touches, push: PressWrench, twist: Array) -> float:
    """The friction up to which a twist (6,) escapes from all of some contacts; below 0 where it does not."""
    return float(frictions(touches, push, twist).min(initial=FREE_OF_JAMS))


def largest_friction(touches: Touches, push: PressWrench, below: float = FREE_OF_JAMS) -> tuple[float, Array]:
    """The largest friction, up to `below`, without a jam on contacts, and the twist (6,) that escapes; −1 if none."""
    low, high, twist = -1.0, below, np.zeros(6)
    at = below
    while True:
        found = push.twist(ClarabelSolver().proposed(escape(touches, push, at))[:-1])
        reached = escaped(touches, push, found)
        if reached > low:
            low, twist = reached, found
        if reached < at - 0.5 * _FINE:
            high = at
        if low >= below - _FINE or high - max(low, 0.0) < _FINE or high == 0.0:
            return min(low, below), twist
        at = 0.0 if low < 0.0 else 0.5 * (low + high)
