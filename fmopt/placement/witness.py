"""The choice of separating planes: for each pair of convex pieces the plane with the largest certified margin."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.pair import Pair, Witness, free_plane
from fmopt.certificate.rows import crossed, length, lengths
from fmopt.certificate.separation import Ends, Separation, best_separation, separation
from fmopt.contact.primitive import Kind
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.uncertainty.error_set import Support
from fmopt.values import Array

_GRAZING = 2e-6
_SHARES = (9, 9, 9)  # planes tried through an edge, pass by pass
_REFINED = 3
_MEMORY = 2048
_RECENT = 16


def choose_separation(assembly: Assembly, pair: Pair, ends: Ends) -> Separation | None:
    """The best plane between two pieces over a piece of motion, None when they are not apart nominally.

    Pieces in touch are kept apart by a plane that the contacts themselves lie in; others by any plane through an edge
    of the fixed piece, or by a face of the moving one.
    """
    found = best_separation(assembly, pair, _candidates(assembly, pair), ends, _GRAZING)
    if pair.touched:
        return found
    plane = separation(assembly, pair, free_plane(pair, _best_normal(pair, ends)), ends)
    if plane.clearance < -_GRAZING or (found is not None and found.margin >= plane.margin):
        return found
    return plane


@lru_cache(maxsize=_MEMORY)
def _candidates(assembly: Assembly, pair: Pair) -> tuple[Witness, ...]:
    """Planes of faces, and those along the two edges of the pair's edge–edge contacts."""
    own = [Witness("moving-face", face.loops[0], ()) for face in pair.moving.faces]
    if not pair.touched:
        return tuple(own)
    faces = [Witness("fixed-face", (), face.loops[0]) for face in pair.fixed.faces]
    return (*faces, *own, *_contact_edges(assembly, pair))


def _contact_edges(assembly: Assembly, pair: Pair) -> list[Witness]:
    found = []
    for contact in (*pair.held, *pair.opening):
        if contact.kind is Kind.EDGE_EDGE:
            moving = _edge_along(pair.moving, *assembly.moving.polyhedron.vertices[list(contact.moving)])
            fixed = _edge_along(pair.fixed, *assembly.fixed.polyhedron.vertices[list(contact.fixed)])
            found.append(Witness("edges", moving, fixed))
    return list(dict.fromkeys(found))


def _edge_along(piece: Polyhedron, a: Array, b: Array) -> tuple[int, int]:
    """The piece's edge on the line through a and b, run from a towards b."""
    direction = (b - a) / length(b - a)
    off = lengths(crossed(piece.vertices - a, direction))
    for edge in piece.edges:
        i, j = edge.vertices
        if max(off[i], off[j]) <= 1e-9:
            forward = float((piece.vertices[j] - piece.vertices[i]) @ direction) > 0.0
            return (i, j) if forward else (j, i)
    raise KeyError("no edge of the piece lies along the contact's edge")


def _best_normal(pair: Pair, ends: Ends) -> Array:
    """The normal (3,) through an edge of the fixed piece, between its two faces, that keeps the largest margin."""
    one, two = _sides(pair.fixed)
    low, high = np.zeros(len(one)), np.ones(len(one))
    margins_of = _Margins(pair, ends)
    best, margin = one[0], -np.inf
    for count in _SHARES:
        w = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, count)
        normals = (1.0 - w)[..., None] * one[:, None] + w[..., None] * two[:, None]
        normals /= lengths(normals)[..., None]
        margins = margins_of(normals.reshape(-1, 3)).reshape(w.shape)
        i, j = np.unravel_index(int(np.argmax(margins)), margins.shape)
        if margins[i, j] > margin:
            best, margin = normals[i, j], float(margins[i, j])
        # Only the roomiest edges are looked at more closely.
        kept = np.argsort(-margins.max(axis=1), kind="stable")[:_REFINED]
        centre = w[kept, np.argmax(margins[kept], axis=1)]
        step = (high - low)[kept] / (count - 1)
        one, two = one[kept], two[kept]
        low, high = np.maximum(centre - step, 0.0), np.minimum(centre + step, 1.0)
    return np.asarray(best)


@lru_cache(maxsize=_MEMORY)
def _sides(piece: Polyhedron) -> tuple[Array, Array]:
    """Normals (k, 3) of the two faces of each edge."""
    sides = np.array([edge.faces for edge in piece.edges])
    return piece.normals[sides[:, 0]], piece.normals[sides[:, 1]]


class _Margins:
    """Certified margins of many planes in front of the fixed piece, against all vertices of the moving one."""

    def __init__(self, pair: Pair, ends: Ends) -> None:
        self.left = lengths(pair.moving.vertices) * ends.extent.kappa
        self.fixed = pair.fixed.vertices
        self.sides = _displaced(pair.moving, ends)

    def __call__(self, normals: Array) -> Array:
        """Margins (k,) of planes with unit normals (k, 3), m."""
        offsets = (normals @ self.fixed.T).max(axis=1)
        lower = []
        for support, world, moved in self.sides:
            reach = support.seen((normals @ moved).reshape(len(normals), len(world), -1))
            lower.append(normals @ world.T - reach)
        least = np.minimum(*lower) - self.left
        return np.asarray(least.min(axis=1) - offsets)


@lru_cache(maxsize=_RECENT)
def _displaced(piece: Polyhedron, ends: Ends) -> tuple[tuple[Support, Array, Array], ...]:
    """At both ends: the errors' support, the vertices (n, 3), and how the errors' columns displace them (3, n·k).

    A plane's row N = (n, Rv × n) has N·c = n·(c_t + c_r × Rv): the columns are turned into displacements of the
    vertices once, and each plane costs a product.
    """
    found = []
    for pose, support in zip((ends.start, ends.goal), ends.supports, strict=True):
        arm = piece.vertices @ pose.R.T
        moved = support.columns[:3].T + crossed(support.columns[3:].T, arm[:, None])
        found.append((support, arm + pose.p, np.ascontiguousarray(moved.reshape(-1, 3).T)))
    return tuple(found)
