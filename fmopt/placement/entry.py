"""Where a motion begins: tilted entries of one corner of the leading face into the mouth, above it and inside it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fmopt.geometry.part import Part
from fmopt.placement.explore import entries
from fmopt.se3 import Pose
from fmopt.values import Array

_TILTS = ((0.8, 1.0), (1.0, 0.8))
_TURNS = (0.0, 0.25, -0.25)


@dataclass(frozen=True, eq=False)
class Entry:
    """A way to begin: the pose above the mouth, the pose with a corner inside it, and that corner (3,) in the body."""

    start: Pose
    inside: Pose
    corner: Array


def tilted_entries(
    moving: Part, play: tuple[float, float], start_box: Array, approach: float, max_tilt: float
) -> tuple[Entry, ...]:
    """Entries that leave room for the start error: a tilted part shows the mouth no more than a corner.

    The corner goes in by several times what its height is uncertain by, at several times its lateral error from the
    two walls next to it. Tilts about the two axes differ, so that no two edges come down level.

    Args:
        moving: the moving part, tip centre at the origin.
        play: free travel (x, y) of the upright part between the walls, m.
        start_box: half-widths (6,) of the start error, m and rad.
        approach: height of the lowest point above the mouth at the start, m.
        max_tilt: greatest tilt about each axis, rad.
    """
    tip = moving.polyhedron.vertices[np.abs(moving.polyhedron.vertices[:, 2]) <= 1e-9]
    radius = float(np.linalg.norm(tip[:, :2], axis=1).max())
    angle = float(np.linalg.norm(start_box[3:]))
    swing = radius * angle
    depth = 5.5 * (float(start_box[2]) + swing) + 5e-5
    walls = -(np.abs(tip[:, :2]).max(axis=0) + 0.5 * np.asarray(play))
    room = walls + 3.0 * start_box[:2] + 2.0 * swing + (0.0, 0.0003)
    found = []
    for about_y, about_x in _TILTS:
        tilts = (about_y * max_tilt, about_x * max_tilt)
        corner = _lowest(tip, *tilts)
        turns = [share * math.sqrt(tilts[0] * tilts[1]) * 0.5 for share in _TURNS]
        for inside in entries(corner, (float(room[0]), float(room[1])), [tilts], turns, depth):
            lift = approach - float(inside.apply(tip)[:, 2].min())
            found.append(Entry(inside.moved([0.0, 0.0, lift, 0.0, 0.0, 0.0]), inside, corner))
    return tuple(found)


def _lowest(tip: Array, about_y: float, about_x: float) -> Array:
    """The corner that such tilts make the lowest, of those next to the walls at −x and −y."""
    height = np.sin(about_y) * tip[:, 0] + np.sin(about_x) * tip[:, 1]
    return np.asarray(tip[int(np.argmin(height))])
