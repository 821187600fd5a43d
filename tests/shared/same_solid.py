"""Solids that are the same: of one volume."""

import math

import pytest

from fmopt.geometry.polyhedron import Polyhedron


def assert_same_volume(derived: Polyhedron, body: Polyhedron, rel: float) -> None:
    """That a tree's solid has the volume of a part; polyhedra stand for the part's balls there, which add to it."""
    if not body.balls:
        assert derived.volume == pytest.approx(body.volume, rel=rel)
        return
    balls = sum(4.0 / 3.0 * math.pi * radius**3 for _, radius in body.balls)
    assert body.volume < derived.volume < body.volume + balls
