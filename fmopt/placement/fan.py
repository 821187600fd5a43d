"""Planes through the edges of fixed pieces, between the two faces of each, that keep a moving piece at most margin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fmopt.certificate.curvature import Lever
from fmopt.certificate.pair import BEHIND, Pair, free_plane
from fmopt.certificate.separation import Course, Separation
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.se3 import cross, lengths
from fmopt.uncertainty.error_set import Support
from fmopt.values import Array

_SHARES = 9  # planes tried through an edge in each pass
_SPREAD = np.linspace(0.0, 1.0, _SHARES)
_PASSES = 3
_REFINED = 6  # edges of a pair that are looked at more closely


@dataclass(frozen=True, eq=False)
class Fans:
    """The planes through all edges of the fixed pieces of some pairs with one moving piece.

    What the errors cost a plane depends on its normal alone, and pieces share many.

    Args:
        pairs: the m pairs.
        arcs: normals (k, 2, 3) of the two faces of each edge, pair by pair.
        cuts: where the edges of each pair begin, and end.
        normals: all different normals (n, 3) of the first pass.
        which: which of them each plane (k, shares) has.
        offsets: how far out each plane (k, shares) is, m.
        corners: vertices (m, v, 3) of the fixed pieces, some repeated where others have more.
    """

    pairs: tuple[Pair, ...]
    arcs: Array
    cuts: tuple[int, ...]
    normals: Array
    which: NDArray[np.intp]
    offsets: Array
    corners: Array

    @staticmethod
    def of(pairs: Sequence[Pair]) -> Fans:
        """The planes of pairs that no contact touches."""
        pieces = [pair.fixed for pair in pairs]
        most = max(len(piece.vertices) for piece in pieces)
        corners = np.array([np.resize(piece.vertices, (most, 3)) for piece in pieces])
        sides = [np.array([edge.faces for edge in piece.edges]) for piece in pieces]
        arcs = np.concatenate([piece.normals[faces] for piece, faces in zip(pieces, sides, strict=True)])
        owner = np.repeat(np.arange(len(pieces)), [len(faces) for faces in sides])
        _, fan = _between(arcs, np.zeros(len(arcs)), np.ones(len(arcs)))
        offsets = _farthest(fan, corners[owner])
        normals, which = np.unique(fan.reshape(-1, 3) + 0.0, axis=0, return_inverse=True)
        cuts = (0, *(int(n) for n in np.cumsum([len(faces) for faces in sides])))
        return Fans(tuple(pairs), arcs, cuts, normals, which.reshape(fan.shape[:2]), offsets, corners)

    def best(self, moving: Polyhedron, course: Course) -> list[list[Separation]]:
        """For each pair the plane with the largest certified margin over a piece of motion, and its clearance.

        No margin exceeds its plane's nominal clearance: only planes with more of that than the best margin so far are
        looked at with errors.

        Args:
            moving: the moving piece.
            course: pieces of motion (n).

        Returns:
            for each piece of motion one for each pair.
        """
        reached = _Reached.of(moving, course)
        kept, margins = self._first(reached)
        arcs = self.arcs[kept]
        low, high = np.zeros(kept.shape), np.ones(kept.shape)
        w, normals = _between(arcs, low, high)
        best, most = _largest(normals, margins)
        for _ in range(_PASSES - 1):
            centre = np.take_along_axis(w, margins.argmax(axis=-1)[..., None], axis=-1)[..., 0]
            step = (high - low) / (_SHARES - 1)
            low, high = np.maximum(centre - step, 0.0), np.minimum(centre + step, 1.0)
            w, normals = _between(arcs, low, high)
            planes, offsets = normals.reshape(len(w), -1, 3), _farthest(normals, self.corners[:, None])
            hopeful = reached.nominal(planes).reshape(w.shape) - offsets > most[..., None, None]
            which = np.flatnonzero(hopeful.any(axis=0))
            if not len(which):
                break
            margins = np.full((len(w), w[0].size), -np.inf)
            margins[:, which] = reached.lower(planes[:, which]) - offsets.reshape(margins.shape)[:, which]
            margins = margins.reshape(w.shape)
            closer, margin = _largest(normals, margins)
            best = np.where((margin > most)[..., None], closer, best)
            most = np.maximum(margin, most)
        offsets = _farthest(best[..., None, :], self.corners)[..., 0]
        clearances = reached.nominal(best) - offsets
        return [
            [
                Separation(free_plane(pair, normal), float(margin) - BEHIND, float(clearance) - BEHIND)
                for pair, normal, margin, clearance in zip(self.pairs, *chosen, strict=True)
            ]
            for chosen in zip(best, most, clearances, strict=True)
        ]

    def _first(self, reached: _Reached) -> tuple[NDArray[np.intp], Array]:
        """The roomiest edges (n, m, e) of each pair, and the margins (n, m, e, shares) of their planes.

        Of planes that cannot have the largest margin of their pair it is as if they had none.
        """
        nominal = reached.nominal(self.normals)[:, self.which] - self.offsets
        flat = nominal.reshape(len(nominal), -1)
        widest = np.stack([first + flat[:, first:last].argmax(axis=1) for first, last in self._spans], axis=1)
        tried = self.normals[self.which.reshape(-1)[widest]]
        bounds = reached.lower(tried) - self.offsets.reshape(-1)[widest]
        hopeful = nominal >= np.repeat(bounds, np.diff(self.cuts), axis=1)[..., None]
        which = np.unique(self.which[hopeful.any(axis=0)])
        lower = np.full((len(nominal), len(self.normals)), -np.inf)
        lower[:, which] = reached.lower(self.normals[which])
        margins = lower[:, self.which] - self.offsets
        rooms = margins.max(axis=2)
        kept = np.stack([first + _roomiest(rooms[:, first:last]) for first, last in pairwise(self.cuts)], axis=1)
        return kept, margins[np.arange(len(margins))[:, None, None], kept]

    @cached_property
    def _spans(self) -> tuple[tuple[int, int], ...]:
        """Where the planes of each pair begin, and end."""
        return tuple((_SHARES * first, _SHARES * last) for first, last in pairwise(self.cuts))


def _between(arcs: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Shares (…, s) between low and high (…), and the unit normals (…, s, 3) that part arcs (…, 2, 3) so."""
    w = low[..., None] + (high - low)[..., None] * _SPREAD
    normals = (1.0 - w)[..., None] * arcs[..., None, 0, :] + w[..., None] * arcs[..., None, 1, :]
    return w, normals / lengths(normals)[..., None]


def _farthest(normals: Array, corners: Array) -> Array:
    """The largest n·v (…, s) over vertices (…, v, 3), for normals (…, s, 3)."""
    return np.asarray((normals @ np.swapaxes(corners, -1, -2)).max(axis=-1))


def _roomiest(margins: Array) -> NDArray[np.intp]:
    """Which edges have the largest margins (n, k)."""
    return np.argsort(-margins, axis=1, kind="stable")[:, :_REFINED]


def _largest(normals: Array, margins: Array) -> tuple[Array, Array]:
    """The normal (n, m, 3) with the largest of margins (n, m, edges, shares), and that margin (n, m)."""
    flat = margins.reshape(*margins.shape[:2], -1)
    at = flat.argmax(axis=2)[..., None]
    largest = np.take_along_axis(normals.reshape(*flat.shape, 3), at[..., None], axis=2)[:, :, 0]
    return largest, np.take_along_axis(flat, at, axis=2)[..., 0]


@dataclass(frozen=True, eq=False)
class _Reached:
    """How far a moving piece reaches against planes at both ends of pieces of motion (n).

    A plane's row N = (n, Rv × n) has N·c = n·(c_t + c_r × Rv): the columns c of the errors' support are turned into
    displacements of the vertices once, and each plane costs a product.

    Args:
        left: what remainders take at each vertex.
        support: how far errors reach at both ends.
        vertices: at both ends (2, n, v, 3).
        moved: how the support's columns displace them (2, n, 3, v·k).
    """

    left: Lever
    support: Support
    vertices: Array
    moved: Array

    @staticmethod
    def of(piece: Polyhedron, course: Course) -> _Reached:
        arms = piece.vertices @ np.swapaxes(course.R, -1, -2)
        columns = np.swapaxes(course.both.columns, -1, -2)[:, :, None]
        moved = columns[..., :3] + cross(columns[..., 3:], arms[..., None, :])
        vertices = arms + course.p[..., None, :]
        flat = moved.reshape(2, len(course.listed), -1, 3)
        return _Reached(Lever.of(course.extent, arms), course.both, vertices, np.swapaxes(flat, -1, -2))

    def lower(self, normals: Array) -> Array:
        """Certified lower bounds (n, m) of n·v over all vertices v, for unit normals (n, m, 3) or (m, 3), m."""
        heights = normals @ np.swapaxes(self.vertices, -1, -2)
        reach = self.support.seen((normals @ self.moved).reshape(*heights.shape, -1))
        return np.asarray(((heights - reach).min(axis=0) - self.left.beside(normals)).min(axis=-1))

    def nominal(self, normals: Array) -> Array:
        """The least n·v (n, m) without errors."""
        return np.asarray((normals @ np.swapaxes(self.vertices, -1, -2)).min(axis=(0, -1)))
