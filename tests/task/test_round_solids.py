"""Round solids of model files by their sagitta: so near, around what is solid and inside what is taken away."""

import math
from pathlib import Path

import numpy as np
import pytest

from fmopt.spatial.values import Array
from fmopt.task.problem import load
from fmopt.task.round_solids import sides_within
from tests import ROOT

SAGITTA = 0.0525e-3
# A second hole beside the first, around a truncated cone that is left standing in it.
WELL = """
[solids.well]
shape = "difference"
of = "bore"
minus = ["core"]
at = [12, 0, 0]

[solids.bore]
shape = "cylinder"
radius = 5
height = "thickness + proud"
sagitta = "clearance"

[solids.core]
shape = "cone"
radius_bottom = 3
radius_top = 2
height = "thickness"
sagitta = "clearance"

[features.hole]"""


@pytest.mark.parametrize(("radius", "sagitta"), [(5e-3, 1.25e-6), (2e-3, 2.6e-6), (1e-3, 1e-4), (1e-3, 0.5e-3)])
def test_no_fewer_sides_would_do(radius: float, sagitta: float) -> None:
    def off(sides: int) -> float:
        return radius / math.cos(math.pi / sides) - radius

    sides = sides_within(radius, sagitta)
    assert sides % 4 == 0
    assert off(sides) <= sagitta
    assert sides == 4 or off(sides - 4) > sagitta


def corners(vertices: Array, around: tuple[float, float], height: float) -> Array:
    """How far the corners (n, 3) of a part at a height are from an upright axis (n,), m, the nearest ones first."""
    level = vertices[np.abs(vertices[:, 2] - height) < 1e-9, :2]
    return np.sort(np.linalg.norm(level - around, axis=1))


def test_material_keeps_off_the_round_surface_on_the_safe_side(tmp_path: Path) -> None:
    for folder in ("problems", "models"):
        (tmp_path / folder).mkdir()
        for path in (ROOT / folder).glob("factory_round_*"):
            text = path.read_text().replace("clearance / 20", "clearance").replace("\n[features.hole]", WELL)
            (tmp_path / folder / path.name).write_text(text.replace('minus = ["hole"]', 'minus = ["hole", "well"]'))
    path = tmp_path / "problems" / "factory_round_8mm_tight.toml"
    problem = load(path)

    def off(radius: float) -> float:
        sides = sides_within(radius, SAGITTA)
        return radius / math.cos(math.pi / sides) - radius

    peg = corners(problem.moving.polyhedron.vertices, (0.0, 0.0), 0.0)
    assert peg == pytest.approx(np.full(len(peg), 3.9975e-3 + off(3.9975e-3)), abs=1e-12)
    block = problem.fixed.polyhedron.vertices
    mouth, floor = (corners(block, (0.012, 0.0), z) for z in (0.0, -8.9916e-3))
    assert mouth[:4] == pytest.approx(np.full(4, 2e-3 + off(3e-3) * 2.0 / 3.0), abs=1e-12)
    assert floor[:4] == pytest.approx(np.full(4, 3e-3 + off(3e-3)), abs=1e-12)
    for ring in (mouth, floor):  # the corners of a hole lie on the true circle
        assert (np.abs(ring - 5e-3) < 1e-12).sum() == sides_within(5e-3, SAGITTA)
    assert (np.abs(corners(block, (0.0, 0.0), 0.0) - 4.05e-3) < 1e-12).sum() == sides_within(4.05e-3, SAGITTA)
    assert problem.fixed.notes == (
        "[solids.hole] is seen as 20 sides inside its round surface, within 52.5 µm of it",
        "[solids.bore] is seen as 24 sides inside its round surface, within 52.5 µm of it",
        "[solids.core] is seen as 20 sides around its round surface, within 52.5 µm of it",
    )
