"""Errors that ways to begin leave room for, and the funnel that the slopes of a mouth make.

Everywhere `start_box` has half-widths (6,) of the start error, m and rad; `per_side` is the clearance a side, m.
"""

import math
from collections.abc import Iterator

import numpy as np

from fmopt.certificate.assembly import Assembly
from fmopt.geometry.part import Part
from fmopt.geometry.section import leading_corners
from fmopt.planning.search.entry import start_spread, swung_by
from fmopt.spatial.values import Array

_SLOPED = 1e-3  # upward part of the normal of a face that is neither a wall nor level
_MEETS = 1e-9  # m, heights that differ by less are one
_ROOMY = 4.0  # clearances a side that ways to enter tilted leave room for at least, as if the errors were that large
_DRIFTED = 0.7  # of how far the part may drift at most, in position and in angle, which hardly happens at once
_EACH = 0.25  # of errors widened to so many clearances, what is along either axis and what is by turning at least


def room(assembly: Assembly, per_side: float, start_box: Array, drift: Array) -> Array:
    """Half-widths (6,) of the errors that ways to begin leave room for, wide enough for contacts some clearances apart.

    They are those with which the part comes to the mouth: what it drifts by until then counts, too.
    """
    met = start_box + _DRIFTED * (drift * assembly.freedoms)
    return roomy_in_plane(per_side, met) if assembly.planar else roomy_errors(assembly.moving, per_side, met)


def roomy_errors(moving: Part, per_side: float, start_box: Array) -> Array:
    """Half-widths (6,) of errors to leave room for: the start errors, widened where they are next to nothing.

    A part that enters tilted goes through contacts a few clearances apart, however small its errors are.
    """
    tip, least = leading_corners(moving), _ROOMY * per_side
    part, spread = _EACH * least, start_spread(moving, start_box)
    wider = start_box * max(1.0, least / max(spread, 1e-3 * least))
    wider = np.maximum(wider, part * np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0]))
    if swung_by(tip, wider) >= part:
        return np.asarray(wider)
    about = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 0.0])
    return np.asarray(np.maximum(wider, about * part / swung_by(tip, about)))


def roomy_in_plane(per_side: float, start_box: Array) -> Array:
    """The same (6,) for a part that moves in the plane of x and z: a few clearances (m) along x at least."""
    return np.asarray(np.maximum(start_box, _ROOMY * per_side * np.eye(6)[0]))


def funnel(fixed: Part) -> tuple[float, float]:
    """How deep the sloped faces that begin at the mouth go down, and how far outside the walls they end, m; else 0."""
    slopes = [(0.0, 0.0), *((depth, depth * rise) for depth, rise in _slopes(fixed))]
    return max(depth for depth, _ in slopes), max(width for _, width in slopes)


def _slopes(fixed: Part) -> Iterator[tuple[float, float]]:
    """The sloped faces that begin at the mouth: how deep they go down, and how far outside they are for each depth.

    They lead to walls that go on steeper below them: those of a tapered hole, which end with it, are its walls.
    """
    body = fixed.polyhedron
    lowest = [float(body.vertices[list(face.vertices), 2].min()) for face in body.faces]
    for face, low in zip(body.faces, lowest, strict=True):
        heights, rise = body.vertices[list(face.vertices), 2], float(face.normal[2])
        if not _SLOPED < rise < 1.0 - _SLOPED or abs(float(heights.max())) > _MEETS:
            continue
        end = {v for v, z in zip(face.vertices, heights.tolist(), strict=True) if z <= low + _MEETS}
        if any(
            abs(other.normal[2]) < rise - _SLOPED and deep < low - _MEETS and not end.isdisjoint(other.vertices)
            for other, deep in zip(body.faces, lowest, strict=True)
        ):
            yield -low, rise / math.hypot(*face.normal[:2])
