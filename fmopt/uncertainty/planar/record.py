"""Planar sets as plain data, for the plan's diagnostics and for whoever draws them: arcs, segments, and what they are.

A piece of a boundary is {"on": carrier, "line": [x, y, x, y]} or {"on": carrier, "arc": [x, y, radius, start, sweep]},
m and rad.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fmopt.plane.curve import Arc, Segment
from fmopt.uncertainty.planar.boundary import Loop
from fmopt.uncertainty.planar.contact import CU, Kind
from fmopt.uncertainty.planar.edge import TurnedEdge, edge_position
from fmopt.uncertainty.planar.planar_set import PlanarSet
from fmopt.uncertainty.planar.reach import Reach
from fmopt.uncertainty.planar.vertex import vertex_position
from fmopt.values import Array


def boundary_record(found: PlanarSet, name: str, nominal: ArrayLike = ()) -> dict[str, Any]:
    """A set with its name, its boundary, and the polyline (k, 2) that it shrinks to without deviations, m."""
    return {
        "name": name,
        "loops": [_loop(loop) for loop in found.boundary()],
        "nominal": np.reshape(np.asarray(nominal, dtype=np.float64), (-1, 2)).tolist(),
    }


def _loop(loop: Loop) -> list[dict[str, Any]]:
    pieces: list[dict[str, Any]] = []
    for piece in loop:
        curve = piece.curve
        if isinstance(curve, Segment):
            pieces.append({"on": str(piece.on), "line": [*curve.start.tolist(), *curve.end.tolist()]})
        elif isinstance(curve, Arc):
            arc = [*curve.centre.tolist(), curve.radius, curve.start, curve.sweep]
            pieces.append({"on": str(piece.on), "arc": arc})
    return pieces


def contact_records(cu: CU, phi: float, pose: Sequence[float] | Array) -> list[dict[str, Any]]:
    """The sets of one contact at an orientation φ (rad): where the feature may be, and what reference points touch.

    Type 1: Uv, CUv of the middle of the edge, CUl. Type 2: Ul with its case, CUl.

    Args:
        cu: the contact.
        phi: orientation, rad.
        pose: reference point (2,) at which Uv and Ul are drawn, m.
    """
    reference = np.asarray(pose, dtype=np.float64)[:2]
    exact = CU(cu.kind, cu.moving, cu.static, cu.edge, cu.vertex, cu.range, cu.nominal, 0.0, 0.0)
    touching = boundary_record(cu.at(phi), f"CUl of {cu.name}", _core(exact, phi))
    if cu.kind is Kind.TYPE_1:
        reach = Reach.of(cu.vertex)
        held = vertex_position(reference, phi, reach, cu.spread, cu.radius)
        there = reference + reach.point(phi)
        point = boundary_record(cu.point_contact(phi, 0.5), f"CUv of {cu.name}", _middle(exact, phi))
        return [boundary_record(held, f"Uv of vertex {cu.moving}", there), point, touching]
    edge = edge_position(reference, phi, cu.edge[0], cu.edge[1], cu.spread, cu.radius)
    ends = edge_position(reference, phi, cu.edge[0], cu.edge[1], 0.0, 0.0)
    name = f"Ul of edge {cu.moving}, case {edge.case.value}"
    return [boundary_record(edge, name, reference + np.array([ends.start, ends.end])), touching]


def _core(exact: CU, phi: float) -> Array:
    """The segment (2, 2) of reference points that make the contact without deviations."""
    at = exact.at(phi)
    if isinstance(at, TurnedEdge):
        return np.asarray(at.pivot + np.array([at.start, at.end]))
    arm = at.h * np.array([math.cos(at.angle), math.sin(at.angle)])
    return np.asarray(np.array([at.start, at.end]) + arm)


def _middle(exact: CU, phi: float) -> Array:
    return np.asarray(_core(exact, phi).mean(axis=0))


def surface_record(cu: CU, count: int = 25) -> dict[str, Any]:
    """CU over its range of φ, in slices, with the nominal C-surface (a segment a slice) where there is one."""
    turns = 2.0 * math.pi * round((cu.range.low + cu.range.high) / (4.0 * math.pi))
    low, high = cu.range.low - turns, min(cu.range.high, cu.range.low + 2.0 * math.pi) - turns
    slices = []
    for phi in np.linspace(low, high, count).tolist():
        inside = cu.nominal is not None and bool(cu.nominal.contains(phi))
        exact = CU(cu.kind, cu.moving, cu.static, cu.edge, cu.vertex, cu.range, cu.nominal, 0.0, 0.0)
        nominal = _core(exact, phi) if inside else ()
        slices.append({"phi": phi, **boundary_record(cu.at(phi), "CUl", nominal)})
    return {"contact": cu.name, "kind": str(cu.kind), "slices": slices}
