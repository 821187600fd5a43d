"""Profiles of planar parts: regular polygons, slots, notches, and what they deviate by."""

import math

import numpy as np

from fmopt.papers.basanez_suarez.profile import Profile
from fmopt.papers.basanez_suarez.sources import Deviations


def gon(n: int, radius: float, turn: float = 0.0) -> Profile:
    theta = 2.0 * math.pi * np.arange(n) / n + turn
    return Profile.of(radius * np.stack([np.cos(theta), np.sin(theta)], axis=-1))


def slot(width: float, depth: float, wall: float) -> Profile:
    """A block with a slot open upwards, its mouth at y = 0 and x = ±width / 2."""
    w, x, y = 0.5 * width, 0.5 * width + wall, depth + wall
    return Profile.of([(-x, -y), (x, -y), (x, 0.0), (w, 0.0), (w, -depth), (-w, -depth), (-w, 0.0), (-x, 0.0)])


def notched() -> Profile:
    """A non-convex object with a hole."""
    outer = [(0.0, 0.0), (0.06, 0.0), (0.06, 0.04), (0.035, 0.04), (0.03, 0.02), (0.025, 0.04), (0.0, 0.04)]
    return Profile.of(outer, [(0.01, 0.005), (0.01, 0.015), (0.02, 0.015), (0.02, 0.005)])


def spread(static: Profile, position: float, angle: float, shape: float = 0.0) -> Deviations:
    return Deviations(np.full(len(static.vertices), 0.5 * position), 0.5 * position, angle, shape)
