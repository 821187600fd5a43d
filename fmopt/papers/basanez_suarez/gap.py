"""The distance between a line segment and an arc about the origin: what all planar contact sets are measured with."""

from typing import Any

import numpy as np

from fmopt.spatial.values import Array, Bits


def segment_arc_gap(start: Array, end: Array, h: Any, angle: Any, spread: Any) -> Array:
    """Least distance (…) between segments and the arcs {h (cos θ, sin θ), |θ − angle| ≤ spread}, in m.

    The least distance is zero where they cross; otherwise it belongs to an end of either, or to the foot of the
    perpendicular from the centre. Each of these is a distance that occurs, so their minimum is exact.

    Ends (…, 2), m, are relative to the arc's centre, and equal for a point; the radius h (…) is not negative. `angle`
    is the middle of the arc, and `spread` half of its opening (…), rad; π or more is a full circle.
    """
    e = end - start
    square = np.sum(e * e, axis=-1)
    # An edge of no length is a point: its foot is its start, whatever it is divided by.
    safe = np.where(square > 0.0, square, 1.0)
    # The least distance is at an end of one against the other, at a foot, or 0 at a crossing: all are tried.
    best = np.minimum(point_arc_gap(start, h, angle, spread), point_arc_gap(end, h, angle, spread))
    for side in (-1.0, 1.0):
        end_angle = angle + side * spread
        tip = np.asarray(h)[..., None] * np.stack([np.cos(end_angle), np.sin(end_angle)], axis=-1)
        share = np.clip(np.sum((tip - start) * e, axis=-1) / safe, 0.0, 1.0)
        apart = start + share[..., None] * e - tip
        best = np.minimum(best, np.hypot(apart[..., 0], apart[..., 1]))
    t_foot = -np.sum(start * e, axis=-1) / safe
    foot = start + t_foot[..., None] * e
    d = np.hypot(foot[..., 0], foot[..., 1])
    on_edge = (square > 0.0) & (t_foot >= 0.0) & (t_foot <= 1.0)
    # Seen from the centre of the arc the foot has to be within its opening.
    facing = _within(np.arctan2(foot[..., 1], foot[..., 0]), angle, spread)
    best = np.where(on_edge & facing, np.minimum(best, np.abs(d - h)), best)
    chord = np.sqrt(np.maximum(h * h - d * d, 0.0) / safe)
    for side in (-1.0, 1.0):
        t = t_foot + side * chord
        x = start + t[..., None] * e
        crosses = (square > 0.0) & (d <= h) & (t >= 0.0) & (t <= 1.0)
        crosses &= _within(np.arctan2(x[..., 1], x[..., 0]), angle, spread)
        best = np.where(crosses, 0.0, best)
    return np.asarray(best)


def point_arc_gap(point: Array, h: Any, angle: Any, spread: Any) -> Array:
    """Distance (…) in m from points to the arc {h (cos θ, sin θ), |θ − angle| ≤ spread} about the origin.

    Points are (…, 2), m; `angle` is the arc's middle, `spread` half its opening, rad, as h a number or one for each.
    """
    x, y = point[..., 0], point[..., 1]
    radius = np.hypot(x, y)
    # How far beyond the nearer tip, at most π, so that the law of cosines holds for every point.
    beyond = np.maximum(np.abs(wrapped(np.arctan2(y, x) - angle)) - spread, 0.0)
    return np.asarray(np.hypot(radius - h, 2.0 * np.sqrt(radius * h) * np.sin(0.5 * beyond)))


def wrapped(angle: Any) -> Any:
    """The angle in [−π, π), rad; a scalar or an array."""
    return np.mod(np.asarray(angle) + np.pi, 2.0 * np.pi) - np.pi


def _within(theta: Array, angle: Any, spread: Any) -> Bits:
    return np.asarray(np.abs(wrapped(theta - angle)) <= spread)
