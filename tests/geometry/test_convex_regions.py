"""Convex parts of polygons: inside them, and together all of them."""

import numpy as np
import pytest

from fmopt.geometry.convex_regions import along_edge, convex_regions
from tests.shared.parts.families import PLAIN, pair


def outline(family: str, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Edges (2, n, 3) of a generated hole, m, their inward normals (n, 3), and offsets (n,)."""
    corners = 1e-3 * np.array(pair(family, seed).hole[0].outline)
    points = np.column_stack([corners, np.zeros(len(corners))])
    ends = np.array([points, np.roll(points, -1, axis=0)])
    inward = np.cross([0.0, 0.0, 1.0], ends[1] - ends[0])
    inward /= np.linalg.norm(inward, axis=1)[:, None]
    return ends, inward, np.vecdot(inward, points)


def inside(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Whether a ray from each of some points (k, 2) crosses an outline (n, 2) an odd number of times."""
    odd = np.zeros(len(points), dtype=np.bool_)
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        across = (ay > points[:, 1]) != (by > points[:, 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            at = ax + (points[:, 1] - ay) / (by - ay) * (bx - ax)
        odd ^= across & (points[:, 0] < at)
    return odd


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("family", PLAIN)
def test_regions_are_in_the_outline_and_cover_it(family: str, seed: int) -> None:
    ends, inward, offsets = outline(family, seed)
    corners, rng = ends[0][:, :2], np.random.default_rng(seed)
    points = rng.uniform(corners.min(axis=0), corners.max(axis=0), (2000, 2))
    within = inside(corners, points)
    heights = np.column_stack([points, np.zeros(len(points))]) @ inward.T - offsets
    covered = np.zeros(len(points), dtype=np.bool_)
    for chosen in convex_regions(ends, inward, offsets):
        covered |= (heights[:, list(chosen)] > 0.0).all(axis=1)
    assert (covered == within).all()


def test_an_edge_that_a_region_goes_on_beyond_is_told() -> None:
    ends, inward, offsets = outline("L", 0)
    told = [
        {i for i in chosen if not along_edge(i, chosen, ends, inward, offsets)}
        for chosen in convex_regions(ends, inward, offsets)
    ]
    assert any(told)
    whole, sides, away = outline("6-gon", 0)
    assert all(along_edge(i, range(6), whole, sides, away) for i in range(6))
