"""Parts grown to the sides: interference fits, which must fail, out of fits that go together."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fmopt.plan import Body, Plan

_SIDEWAYS = 0.5  # |z| of the unit normal up to which a face looks sideways
_SAME = 1e-9  # m between vertices that are one


def grown(plan: Plan, growth: float) -> Plan:
    """A plan whose moving part is thicker by `growth`, m, on each side: its pieces' faces that look sideways move out.

    Only what the scene is built from changes; moves and contacts stay as they are.
    """
    pieces = tuple(_piece(piece, growth) for piece in plan.moving.pieces)
    return replace(plan, moving=replace(plan.moving, pieces=pieces))


def _piece(piece: Body, growth: float) -> Body:
    """The convex hull with faces n·x ≤ d moved to n·x ≤ d + growth where they look sideways; vertices alone."""
    from scipy.spatial import ConvexHull, HalfspaceIntersection

    vertices = np.array(piece.vertices)
    rows = np.unique(np.round(ConvexHull(vertices).equations, 12), axis=0)
    rows[:, 3] -= np.where(np.abs(rows[:, 2]) <= _SIDEWAYS, growth, 0.0)
    return Body(_merged(HalfspaceIntersection(rows, vertices.mean(axis=0)).intersections), ())


def _merged(points: Any) -> tuple[tuple[float, ...], ...]:
    kept: list[Any] = []
    for point in points:
        if all(float(np.abs(point - other).max()) > _SAME for other in kept):
            kept.append(point)
    return tuple(sorted(tuple(float(value) for value in point) for point in kept))
