"""The diagrams of a T-C mapping as plain data: regions as polylines, and the uncertain line L where it matters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fmopt.nominal.intervals import FreedomInterval
from fmopt.nominal.mapping import Mapping, PlaneDiagrams
from fmopt.nominal.trajectory import NominalTrajectory
from fmopt.nominal.uncertainty_zone import Zone
from fmopt.plane.region import Region
from fmopt.se3 import exp
from fmopt.values import Array


def diagnostics(mapping: Mapping, length: float) -> dict[str, Any]:
    """What a plan tells of the T-C mapping on the planes: the diagrams, and S(t) as the planes show it.

    Args:
        mapping: the finished mapping.
        length: of the line L, m.
    """
    seen = [{"t0": one.start, "t1": one.end, "s": list(one.s)} for one in mapping.freedoms]
    return {"diagrams": records(mapping, length), "freedom_on_planes": seen}


def records(mapping: Mapping, length: float) -> list[dict[str, Any]]:
    """The diagrams as plain data for figures, curves as polylines within 1e-4 of the size of their loops.

    Args:
        mapping: the finished mapping.
        length: of the line L, m.
    """
    return [_record(plane, mapping.path, mapping.freedoms, length) for plane in mapping.planes]


def _record(
    diagrams: PlaneDiagrams, path: NominalTrajectory, freedoms: Sequence[FreedomInterval], length: float
) -> dict[str, Any]:
    zone, plane = diagrams.zone, diagrams.zone.plane
    upright = plane.v == 2
    times = {"start": 0.0, "goal": path.duration}
    engaged = next((one.start for one in freedoms if one.start > 0.0 and any(one.s)), None)
    if engaged is not None:
        times = {"start": 0.0, "first contact": engaged, "goal": path.duration}
    poses = []
    for name, t in times.items():
        P = path.at(t)
        along = exp(P[3:])[:, 2][[plane.u, plane.v]]
        reach = length * float(np.linalg.norm(along)) if upright else 0.0
        angle = float(np.arctan2(along[1], along[0])) if upright else 0.5 * np.pi
        poses.append(_pose(name, t, zone, P[[plane.u, plane.v]], angle, reach))
    turning = {} if diagrams.turning is None else {"turning": _loops(diagrams.turning)}
    return {
        "plane": plane.name,
        "zone": {"radius": zone.radius, "half_angle": zone.half_angle},
        "fixed": _loops(diagrams.fixed),
        "expanded": _loops(diagrams.expanded),
        **turning,
        "room": _room(diagrams.expanded, path.nodes[-1, [plane.u, plane.v]]),
        "path": path.nodes[:, [plane.u, plane.v]].tolist(),
        "poses": poses,
    }


def _pose(name: str, t: float, zone: Zone, centre: Array, angle: float, length: float) -> dict[str, Any]:
    trapezoid = zone.trapezoid(centre, angle, length)
    rays = [trapezoid.line(centre, angle + side * zone.half_angle) for side in (-1.0, 1.0)]
    return {
        "name": name,
        "time": t,
        "centre": centre.tolist(),
        "line": trapezoid.line(centre, angle).tolist(),
        "ball": trapezoid.ball.corners.tolist(),
        "cone": [ray.tolist() for ray in rays],
        "edges": [edge.tolist() for edge in trapezoid.edges],
        "trapezoid": trapezoid.outline.tolist(),
    }


def _loops(region: Region) -> list[list[list[float]]]:
    found = []
    for loop in region.loops:
        tolerance = 1e-4 * Region((loop,)).size
        found.append(np.vstack([curve.polyline(tolerance)[:-1] for curve in loop]).tolist())
    return found


def _room(expanded: Region, centre: Array) -> float:
    """Distance of the seated nominal centre from the sides of GE, m; 0 without any."""
    return 0.0 if expanded.empty else float(expanded.boundary_distance(centre)[0])
