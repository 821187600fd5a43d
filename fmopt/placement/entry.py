"""Where a motion begins: straight above the mouth, or tilted so that one corner of the leading face enters it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fmopt.geometry.part import Part
from fmopt.placement.explore import entries
from fmopt.se3 import Pose
from fmopt.values import Array

_TILTS = ((0.8, 1.0), (1.0, 0.8))
_TURNS = (0.0, 0.25, -0.25)
# What the errors are multiplied with: how deep the corner goes in, how far from the walls it goes in.
_ROUNDS = ((5.5, 3.0), (4.0, 3.0), (5.5, 4.0), (4.0, 4.0), (7.5, 4.0), (3.0, 2.0))


@dataclass(frozen=True, eq=False)
class Entry:
    """A way to begin: the pose above the mouth, the pose with a corner inside it, and that corner (3,) in the body."""

    start: Pose
    inside: Pose
    corner: Array


def tilted_entries(
    moving: Part, play: tuple[float, float], start_box: Array, approach: float, max_tilt: float
) -> Iterator[tuple[Entry, ...]]:
    """Entries that leave room for the start error, in rounds: a tilted part shows the mouth no more than a corner.

    The corner goes in by several times what its height is uncertain by, at several times its lateral error from the
    two walls next to it; unequally far from the two, so that it cannot meet both at once. Tilts about the two axes
    differ, so that no two edges come down level.

    Args:
        moving: the moving part, tip centre at the origin.
        play: free travel (x, y) of the upright part between the walls, m.
        start_box: half-widths (6,) of the start error, m and rad.
        approach: height of the lowest point above the mouth at the start, m.
        max_tilt: greatest tilt about each axis, rad.
    """
    tip = _tip(moving)
    swing = _swing(tip, start_box)
    slack = 0.5 * np.asarray(play)
    walls = -(np.abs(tip[:, :2]).max(axis=0) + slack)
    for deep, wide in _ROUNDS:
        depth = deep * (float(start_box[2]) + swing) + 0.5 * float(slack.min())
        room = walls + (wide, wide + 1.0) * start_box[:2] + 2.0 * swing
        found = []
        for about_y, about_x in _TILTS:
            tilts = (about_y * max_tilt, about_x * max_tilt)
            corner = _lowest(tip, *tilts)
            turns = [share * math.sqrt(tilts[0] * tilts[1]) * 0.5 for share in _TURNS]
            for inside in entries(corner, (float(room[0]), float(room[1])), [tilts], turns, depth):
                lift = approach - float(inside.apply(tip)[:, 2].min())
                found.append(Entry(inside.moved([0.0, 0.0, lift, 0.0, 0.0, 0.0]), inside, corner))
        yield tuple(found)


def straight_entry(moving: Part, play: tuple[float, float], start_box: Array, approach: float) -> tuple[Entry, ...]:
    """The entry of an upright part on the axis, where the start errors leave room for it in the mouth; none otherwise.

    Args:
        moving: the moving part, tip centre at the origin.
        play: free travel (x, y) of the upright part between the walls, m.
        start_box: half-widths (6,) of the start error, m and rad.
        approach: height of the leading face above the mouth at the start, m.
    """
    slack = 0.5 * min(play)
    if start_spread(moving, start_box) >= slack:
        return ()
    heights = (np.array([0.0, 0.0, approach]), np.array([0.0, 0.0, -slack]))
    start, inside = (Pose(at, np.eye(3)) for at in heights)
    return (Entry(start, inside, _tip(moving)[0]),)


def start_spread(moving: Part, start_box: Array) -> float:
    """How far the start errors displace the tip's corners sideways at most, about: half-widths and swing, m."""
    return float(start_box[:2].max()) + _swing(_tip(moving), start_box)


def _tip(moving: Part) -> Array:
    vertices = moving.polyhedron.vertices
    return np.asarray(vertices[np.abs(vertices[:, 2]) <= 1e-9])


def _swing(tip: Array, start_box: Array) -> float:
    """How far rotation errors move the tip's outermost corner, m."""
    return float(np.linalg.norm(tip[:, :2], axis=1).max()) * float(np.linalg.norm(start_box[3:]))


def _lowest(tip: Array, about_y: float, about_x: float) -> Array:
    """The corner that such tilts make the lowest, of those next to the walls at −x and −y."""
    height = np.sin(about_y) * tip[:, 0] + np.sin(about_x) * tip[:, 1]
    return np.asarray(tip[int(np.argmin(height))])
