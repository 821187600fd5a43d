"""Poses in which given contacts touch, inside their bounds, and all others are apart: on the true C-surfaces.

Many states and many starting poses go through one Levenberg–Marquardt iteration together. What is wanted with
equality, f = 0 of the state's own contacts, and what is wanted with room to spare, the bounds of those, the other
contacts' distances and the limits of the local space, is one vector of shortages r. Where its length cannot fall any
further above zero, Jᵀr = 0: the shortages themselves are the multipliers that say which demands contradict each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fmopt.contact.bounds import BoundTable
from fmopt.contact.space import LocalSpace
from fmopt.contact.surface import Surfaces
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.se3 import Pose, turns
from fmopt.values import Array, Value

Bits = NDArray[np.bool_]

_ROUNDS = 90
_NOTHING = 1e-11  # scaled units; a shortage of no more is none
_LEVEL = 1e-7  # slope of the shortage below which it cannot fall any further
_PAUSE = 10  # rounds after which it is compared with what it was
_DAMPING = 1e-3
_FARTHEST = 8.0  # scaled units that one step may go
_POLISH = 5
_FAR = 1.0  # m
_FLAT = 1e-5  # relative size of a singular value that counts as none


@dataclass(frozen=True, eq=False)
class Poses(Value):
    """Poses: positions p (n, 3) in m and rotations R (n, 3, 3)."""

    p: Array
    R: Array

    @staticmethod
    def around(pose: Pose, X: Array) -> Poses:
        """The poses at local coordinates X (n, 6) around one."""
        return Poses(pose.p + X[:, :3], turns(X[:, 3:]) @ pose.R)

    def moved(self, X: Array) -> Poses:
        """Each pose at its own local coordinates X (n, 6)."""
        return Poses(self.p + X[:, :3], turns(X[:, 3:]) @ self.R)

    def local(self, pose: Pose) -> Array:
        """Local coordinates X (n, 6) of these poses around one, for turns below a right angle."""
        T = self.R @ pose.R.T
        s = 0.5 * np.stack([T[:, 2, 1] - T[:, 1, 2], T[:, 0, 2] - T[:, 2, 0], T[:, 1, 0] - T[:, 0, 1]], axis=-1)
        sine = np.minimum(np.linalg.norm(s, axis=-1), 1.0)
        ratio = np.where(sine > 1e-6, np.arcsin(sine) / np.maximum(sine, 1e-6), 1.0)
        return np.concatenate([self.p - pose.p, ratio[:, None] * s], axis=-1)

    def kept(self, which: Bits | NDArray[np.intp]) -> Poses:
        """Some of the poses."""
        return Poses(self.p[which], self.R[which])

    def pose(self, i: int) -> Pose:
        """One of them."""
        return Pose(self.p[i], self.R[i])


@dataclass(frozen=True, eq=False)
class Measures(Value):
    """What n states have at n poses, in clearances.

    Attributes:
        own: (n, k), f of the contacts that are to touch, 0 for the others.
        others: (n, k), of the other contacts the distance, or how far outside their bounds they are; inf for own.
        depths: (n, k, clauses), how far inside each clause of its bounds an own contact is; inf for others.
        binding: (n, k, clauses), which bound of the table that is.
        limits: (n, l), how far inside the limits of the local space.
    """

    own: Array
    others: Array
    depths: Array
    binding: NDArray[np.intp]
    limits: Array

    @property
    def residual(self) -> Array:
        """Largest |f| of the contacts that are to touch (n,)."""
        return np.asarray(np.max(np.abs(self.own), axis=1, initial=0.0))

    @property
    def slack(self) -> Array:
        """Least distance of others and depth of own (n,)."""
        apart, deep = self.others.min(axis=1, initial=np.inf), self.depths.min(axis=(1, 2), initial=np.inf)
        return np.asarray(np.minimum(apart, deep))


@dataclass(frozen=True, eq=False)
class Neighbourhood(Value):
    """A local space with the true functions of its contacts and of their bounds."""

    space: LocalSpace
    surfaces: Surfaces
    table: BoundTable
    parts: tuple[Polyhedron, Polyhedron]

    @staticmethod
    def of(space: LocalSpace, moving: Polyhedron, fixed: Polyhedron) -> Neighbourhood:
        """The functions of a local space's contacts between these parts."""
        table = BoundTable.of(space.contacts, moving, fixed, space.pose)
        return Neighbourhood(space, Surfaces.of(space.contacts, moving, fixed), table, (moving, fixed))

    def measured(self, on: Bits, poses: Poses) -> Measures:
        """What states with contacts `on` (n, k) have at poses, one each."""
        unit = self.space.scale[0]
        f, _, g, _ = self._functions(poses)
        depth, which = self.table.depths(g)
        apart = np.where(on | self._ended(on, which), np.inf, np.maximum(f, -depth.min(axis=2, initial=np.inf)))
        deep = np.where(on[..., None], depth, np.inf) / unit
        return Measures(np.where(on, f, 0.0) / unit, apart / unit, deep, which, self.inside(poses))

    def inside(self, poses: Poses) -> Array:
        """How far (n, l) poses are inside the limits of the local space, in scaled units."""
        x = poses.local(self.space.pose) / self.space.scale
        return np.asarray(x @ self.space.limits[:, :6].T - self.space.limits[:, 6])

    def shortages(self, on: Bits, poses: Poses, room: float) -> Shortages:
        """What n states, one at each pose, are short of; nothing where there is enough.

        A contact that is not to touch is out of the way at a distance of `room` (clearances), or that far outside its
        bounds, whichever is nearer.
        """
        scale, unit = self.space.scale / self.space.scale[0], self.space.scale[0]
        f, N, g, G = self._functions(poses)
        depth, which = self.table.depths(g)
        inside, bound = _innermost(depth, which)
        out = -inside > f
        apart = np.where(self._ended(on, which), np.inf, np.where(out, -inside, f) / unit - room)
        deep = np.where(on, np.minimum(inside / unit - room, 0.0), 0.0)
        r, J = np.where(on, f / unit, np.minimum(apart, 0.0)), N * (on | (apart < 0.0))[..., None]
        aside = out & ~on & (apart < 0.0)
        J[aside] = -self._bounding(G, bound, aside)
        if deep.any():
            edges = np.zeros_like(J)
            edges[deep < 0.0] = self._bounding(G, bound, deep < 0.0)
            r, J = np.concatenate([r, deep], axis=1), np.concatenate([J, edges], axis=1)
        Jt = np.swapaxes(J, 1, 2)
        walls, beyond = self.space.limits[:, :6], np.minimum(self.inside(poses), 0.0)
        square = (walls[:, :, None] * walls[:, None]).reshape(-1, 36)
        return Shortages(
            np.sqrt(np.vecdot(r, r) + np.vecdot(beyond, beyond)),
            (Jt @ r[..., None])[..., 0] * scale + beyond @ walls,
            Jt @ J * np.outer(scale, scale) + ((beyond < 0.0) @ square).reshape(-1, 6, 6),
        )

    def _bounding(self, G: Array, bound: NDArray[np.intp], which: Bits) -> Array:
        """Gradients (m, 6) of how far poses are inside bounds (n, k), for the m contacts of a mask (n, k).

        Args:
            G: gradients (n, l, 6) of the bounds' contacts.
            bound: which bound of each contact counts.
            which: the mask.
        """
        number = bound[which]
        return np.asarray(-self.table.signs[number, None] * G[np.nonzero(which)[0], number])

    def _functions(self, poses: Poses) -> tuple[Array, Array, Array, Array]:
        """Values and gradients at poses of the contacts, and of the bounds' contacts, shared ones evaluated once."""
        joint, own, ends = self._joint
        f, N = _over(joint, poses)
        return f[:, own], N[:, own], f[:, ends], N[:, ends]

    @cached_property
    def _joint(self) -> tuple[Surfaces, slice, NDArray[np.intp]]:
        """The functions of contacts and of bounds, each once, and where those of either are."""
        contacts = self.surfaces.contacts
        extra = (contact for contact in self.table.surfaces.contacts if contact not in contacts)
        every = (*contacts, *dict.fromkeys(extra))
        ends = np.array([every.index(contact) for contact in self.table.surfaces.contacts], dtype=np.intp)
        return Surfaces.of(every, *self.parts), slice(len(contacts)), ends

    def _ended(self, on: Bits, which: NDArray[np.intp]) -> Bits:
        """Which contacts (n, k) end where one of `on` begins: no pose violates the one without violating the other."""
        # One column more for a bound that is no contact of the space, and for none at all.
        held = np.concatenate([on, np.zeros((len(on), 1), dtype=bool)], axis=1)[:, self._ending]
        found = held[np.arange(len(on))[:, None, None], which]
        return np.asarray(found.any(axis=2))

    @cached_property
    def _ending(self) -> list[int]:
        """Which contact of the space begins at each bound, −1 for none, and where there is no bound."""
        names = {contact.id: i for i, contact in enumerate(self.space.contacts)}
        return [*(names.get(b.contact.id, -1) if b.sign > 0 else -1 for b in self.table.listed), -1, -1]


def _over(surfaces: Surfaces, poses: Poses) -> tuple[Array, Array]:
    """Values (n, k) and gradients (n, k, 6) at poses.

    Edges that are level there cross nowhere: they count as far from each other.
    """
    f, N = surfaces.over(poses.p, poses.R)
    crossing = np.isfinite(N[..., -1])
    if not crossing.all():
        f, N = np.where(crossing, f, _FAR), np.where(crossing[..., None], N, 0.0)
    return f, N


def _innermost(depth: Array, which: NDArray[np.intp]) -> tuple[Array, NDArray[np.intp]]:
    """How far (n, k) poses are inside all bounds of each contact, m, and which bound that is.

    Args:
        depth: of each clause (n, k, clauses), m.
        which: the bound that this depth belongs to.
    """
    if not depth.shape[2]:
        return np.full(depth.shape[:2], np.inf), np.zeros(depth.shape[:2], dtype=np.intp)
    n, k = np.arange(len(depth))[:, None], np.arange(depth.shape[1])
    tight = np.argmin(depth, axis=2)
    return depth[n, k, tight], which[n, k, tight]


@dataclass(frozen=True, eq=False)
class Shortages(Value):
    """Shortages r of n states at poses with gradients J: the length |r| (n,), Jᵀr (n, 6) and JᵀJ (n, 6, 6), scaled."""

    size: Array
    slope: Array
    square: Array

    def kept(self, which: Bits) -> Shortages:
        """Those of some states."""
        return Shortages(self.size[which], self.slope[which], self.square[which])

    def replaced(self, which: Bits, other: Shortages) -> Shortages:
        """With those of another for some states."""
        return Shortages(
            np.where(which, other.size, self.size),
            np.where(which[:, None], other.slope, self.slope),
            np.where(which[:, None, None], other.square, self.square),
        )


@dataclass(frozen=True, eq=False)
class Met(Value):
    """Where n searches ended: the poses, how much is short there in all (scaled units), and whether that is final.

    It is where the shortage cannot fall any further, or falls too slowly ever to be gone.
    """

    poses: Poses
    short: Array
    settled: Bits


def meet(near: Neighbourhood, on: Bits, start: Poses, room: float) -> Met:
    """Searches from each start for a pose where its contacts touch and everything else is at least `room` away.

    Args:
        near: the local space and its true functions.
        on: (n, k), the contacts that are to touch.
        start: n poses.
        room: clearances.
    """
    poses, short, settled = _levenberg_marquardt(near, on, start, room)
    return Met(project(near, on, poses, 6), short, settled)


def _levenberg_marquardt(near: Neighbourhood, on: Bits, start: Poses, room: float) -> tuple[Poses, Array, Bits]:
    """The poses where the shortages end, their sizes, and whether that is final, see `Met`."""
    p, R, scale = start.p.copy(), start.R.copy(), near.space.scale
    short, settled = np.full(len(p), np.inf), np.zeros(len(p), dtype=bool)
    damping, then = np.full(len(p), _DAMPING), np.full(len(p), np.inf)
    open_ = np.arange(len(p))
    now = near.shortages(on, start, room)
    for count in range(_ROUNDS):
        short[open_] = now.size
        done = (now.size <= _NOTHING) | (np.linalg.norm(now.slope, axis=1) <= _LEVEL * now.size)
        if count % _PAUSE == _PAUSE - 1:
            done |= _left(now.size, then[open_], (_ROUNDS - count) / _PAUSE) > _NOTHING
            then[open_] = now.size
        settled[open_[done]] = True
        open_, now = open_[~done], now.kept(~done)
        if not len(open_):
            break
        A = now.square + damping[open_, None, None] * np.eye(6)
        step = -np.linalg.solve(A, now.slope[..., None])[..., 0]
        step *= np.minimum(1.0, _FARTHEST / np.maximum(np.linalg.norm(step, axis=1), _FARTHEST))[:, None]
        trial = Poses(p[open_], R[open_]).moved(scale * step)
        new = near.shortages(on[open_], trial, room)
        better = new.size < now.size
        damping[open_] = np.clip(np.where(better, 0.1, 10.0) * damping[open_], 1e-14, 1e8)
        p[open_[better]], R[open_[better]] = trial.p[better], trial.R[better]
        now = now.replaced(better, new)
    return Poses(p, R), short, settled


def _left(now: Array, then: Array, pauses: float) -> Array:
    """What shortages (n,) come to after more pauses that take as large a share as the last; 0 before there was one."""
    return np.asarray(now * np.where(np.isfinite(then), now / then, 0.0) ** pauses)


def project(near: Neighbourhood, on: Bits, poses: Poses, rank: int | NDArray[np.intp]) -> Poses:
    """The nearest poses where the contacts `on` (n, k) touch, by Gauss–Newton with shortest scaled steps.

    Args:
        near: the local space and its true functions.
        on: the contacts.
        poses: where to start.
        rank: how many singular directions a step may use, of all or of each. The rank of a state's linear picture
            stays near its facet; 6 also uses those that only curvature provides.
    """
    scale = near.space.scale
    allowed = np.arange(6) < np.reshape(rank, (-1, 1))
    for _ in range(_POLISH):
        f, N = _over(near.surfaces, poses)
        U, s, Vt = np.linalg.svd(np.where(on[..., None], N * scale, 0.0), full_matrices=False)
        used = allowed[:, : s.shape[1]] & (s > _FLAT * s[:, :1])
        along = np.einsum("nki,nk->ni", U, np.where(on, f, 0.0))
        step = np.where(used, along / np.where(used, s, 1.0), 0.0)
        poses = poses.moved(-scale * np.einsum("nij,ni->nj", Vt, step))
    return poses
