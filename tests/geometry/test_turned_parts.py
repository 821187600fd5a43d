"""Parts turned about their axis by any angle: no coordinate is a round number, and their plans hold all the same."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from fmopt.geometry.csg import Box, Difference, Moved, Prism
from fmopt.geometry.exact_coordinates import exact_vertices, facing_directions
from fmopt.geometry.part import part_of, rebased, settled
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.planning.pipeline import certified_motion, proved
from fmopt.spatial.se3 import Pose, exp
from fmopt.task.problem import load
from tests.shared.parts import families

SEED = 20261125


def turned_polygon(sides: int, radius: float, angle: float) -> list[list[float]]:
    """The corners (n, 2) of a regular polygon, counter-clockwise."""
    angles = angle + 2.0 * np.pi * np.arange(sides) / sides
    return (radius * np.column_stack([np.cos(angles), np.sin(angles)])).tolist()


@pytest.mark.parametrize("seed", range(2))
def test_plans_of_parts_turned_about_their_axis_pass_the_check(seed: int, tmp_path: Path) -> None:
    problem = load(families.write_toml(families.pair("4-gon", seed), tmp_path, error=(0.3, 0.3)))
    found = certified_motion(problem)
    _, verdict = proved(problem, found)
    assert found.placed.margin > 0.0
    assert str(verdict.verdict) == "CERTIFIED", verdict.findings[:2]


@pytest.mark.parametrize("seed", range(6))
def test_settled_parts_are_where_exact_ones_are(seed: int) -> None:
    rng = np.random.default_rng(SEED + seed)
    corners = tuple(map(tuple, turned_polygon(int(rng.integers(3, 9)), 0.01, float(rng.uniform(0.0, 3.0)))))
    wider = tuple((1.01 * x, 1.01 * y) for x, y in corners)
    hole = Difference(Box((0.06, 0.06, 0.04)), (Moved(Prism(wider, 0.04), Pose(np.array([0, 0, 0.02]), np.eye(3))),))
    about = Pose(np.zeros(3), exp(np.array([0.0, 0.0, float(rng.uniform(0.0, 3.0))])))
    moving, fixed = (
        rebased(part_of(name, solid), about) for name, solid in (("peg", Prism(corners, 0.04)), ("hole", hole))
    )
    assert off(*(part.polyhedron for part in (moving, fixed))) > 1e-17
    moving, fixed = settled(moving, fixed)
    assert off(moving.polyhedron, fixed.polyhedron) <= 4e-18
    for part in (moving, fixed):
        corners_of = {tuple(v) for v in part.polyhedron.vertices.tolist()}
        assert any(tuple(v) in corners_of for piece in part.pieces for v in piece.vertices.tolist())


def off(moving: Polyhedron, fixed: Polyhedron) -> float:
    """How far exact coordinates are from those in floats, m, facing faces parallel."""
    own = exact_vertices(moving)
    facing = facing_directions(moving, own, fixed, range(len(fixed.faces)))
    found = [(moving, own), (fixed, exact_vertices(fixed, facing))]
    pairs = (p for body, exact in found for n, at in exact.items() for p in zip(at, body.vertices[n], strict=True))
    return max((abs(float(x - Fraction(y))) for x, y in pairs), default=0.0)
