"""Polygonal objects of planar contacts: vertices, edges, outward normals, and how far uncertainty turns an edge."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from fmopt.errors import GeometryError
from fmopt.papers.basanez_suarez.gap import wrapped
from fmopt.papers.basanez_suarez.sources import edge_turn
from fmopt.spatial.values import Array, Indices, Value, frozen


@dataclass(frozen=True, eq=False)
class Profile(Value):
    """A polygonal object, material on the left of its loops: outlines run counter-clockwise, holes clockwise.

    Vertices of all loops are numbered in a row; edge i runs from vertex i to `after[i]`. A grasped object is described
    in the frame of the gripper's reference point at φ = 0.

    Args:
        vertices: (n, 2), m.
        after: (n,), the next vertex of the same loop.
        before: (n,), the one before.
    """

    vertices: Array
    after: Indices
    before: Indices

    @staticmethod
    def of(*loops: ArrayLike) -> "Profile":
        """The object with these loops (k, 2) in m.

        Raises:
            GeometryError: a loop has fewer than three vertices, an edge has no length, an edge folds back on the one
                before it, or the loops enclose no area.
        """
        arrays = [frozen(loop, None, 2, name="loop of vertices") for loop in loops]
        if not arrays or any(len(loop) < 3 for loop in arrays):
            raise GeometryError("a polygonal object with a loop of fewer than three vertices", "give at least three")
        rows = [np.arange(a, b) for a, b in pairwise(np.cumsum([0, *(len(loop) for loop in arrays)]))]
        after = np.concatenate([np.roll(row, -1) for row in rows]).astype(np.intp)
        before = np.concatenate([np.roll(row, 1) for row in rows]).astype(np.intp)
        for indices in (after, before):
            indices.setflags(write=False)
        profile = Profile(frozen(np.vstack(arrays)), after, before)
        profile._refuse_degenerate()
        return profile

    @property
    def edges(self) -> Array:
        """Vectors (n, 2) along the edges, m."""
        return np.asarray(self.vertices[self.after] - self.vertices)

    @property
    def lengths(self) -> Array:
        """Lengths (n,) of the edges, m."""
        return np.asarray(np.hypot(*self.edges.T))

    @property
    def normals(self) -> Array:
        """Directions ψ (n,) of the edges' outward normals, rad."""
        e = self.edges
        # The right-hand normal of an edge with the material on its left.
        return np.arctan2(-e[:, 0], e[:, 1])

    @property
    def turns(self) -> Array:
        """Turn (n,) of the outward normal at each vertex, rad in (−π, π); negative at a reflex vertex."""
        psi = self.normals
        return np.asarray(wrapped(psi - psi[self.before]))

    def edge_turns(self, epsilon: ArrayLike) -> Array:
        """Greatest turn (n,) in rad of each edge whose ends move by up to ε: one number, or one for each vertex, m."""
        e = np.broadcast_to(np.asarray(epsilon, dtype=np.float64), len(self.vertices))
        # The mean of both ends: 2 ε̄ / L is then (ε₁ + ε₂) / L, the most that one may move against the other.
        means = 0.5 * (e + e[self.after])
        return np.array([edge_turn(float(a), float(L)) for a, L in zip(means, self.lengths, strict=True)])

    def at(self, pose: Sequence[float] | Array) -> Array:
        """Vertices (n, 2) of a grasped object at the configuration (p_x, p_y, φ), m and rad."""
        x, y, phi = pose
        c, s = math.cos(phi), math.sin(phi)
        return np.asarray(self.vertices @ np.array([[c, s], [-s, c]]) + (x, y))

    def region(self, pose: Sequence[float] | Array) -> BaseGeometry:
        """The object at a configuration (p_x, p_y, φ) as a polygon with its holes, m."""
        # The vertices of a loop follow each other, the last one is followed by the first.
        begins = np.flatnonzero(self.after[:-1] <= np.arange(len(self.after) - 1)) + 1
        # Holes by symmetric difference: they are within outlines, and do not cross them.
        return reduce(BaseGeometry.symmetric_difference, map(Polygon, np.split(self.at(pose), begins)))

    def _refuse_degenerate(self) -> None:
        size = float(np.ptp(self.vertices, axis=0).max())
        short = np.flatnonzero(self.lengths <= 1e-12 * size)
        if size == 0.0 or len(short):
            i = int(short[0]) if len(short) else 0
            raise GeometryError(f"edge {i} of a polygonal object has no length", "remove one of its vertices")
        # A vertex without an inside has no normal cone.
        folded = np.flatnonzero(np.abs(self.turns) >= math.pi - 1e-9)
        if len(folded):
            raise GeometryError(f"the edges at vertex {folded[0]} fold back on each other", "remove the vertex")
        a, b = self.vertices, self.vertices[self.after]
        area = 0.5 * float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))
        if area <= 1e-12 * size**2:
            message = f"the loops of a polygonal object enclose {area:.3g} m²"
            raise GeometryError(message, "list outlines counter-clockwise, holes clockwise")
