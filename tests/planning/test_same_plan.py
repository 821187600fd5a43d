"""The same plan for the same parts, however their models are written, and for their images in a mirror.

Models may be in metres, shifted, or turned in their files; mirror images have no symmetry that would make them alike.
"""

from pathlib import Path

import pytest

from fmopt.planning.pipeline import synthesise
from fmopt.task.problem import Problem, load
from tests import ROOT
from tests.shared.files.model_text import cuboid, difference, feature, part
from tests.shared.parts.outlines import prism

TURN = "0, 0, {turn}"
UNITS = '[units]\nlength = "{unit}"\nangle = "deg"\n'
WHOLE = feature("peg", "solid", "{x}, {y}, {z}", "{length}", TURN)
PEG = 'name = "peg"\n' + part("peg", UNITS, cuboid("peg", "{width}, {width}, {length}", "{x}, {y}, {z}", TURN), WHOLE)
BLOCK = 'name = "block"\n' + part(
    "drilled",
    UNITS,
    cuboid("block", "{block}, {block}, {height}", "{x}, {y}, {z}", TURN),
    cuboid("hole", "{hole}, {hole}, {cut}", "{x}, {y}, {bottom}", TURN),
    difference("drilled", "block", "hole"),
    feature("hole", "hollow", "{x}, {y}, {top}", "{depth}", TURN),
)
SIZES = {"width": 20, "length": 40, "block": 60, "height": 40, "hole": 20.2, "cut": 31, "depth": 30}


def margins(folder: Path, unit: str = "mm", at: tuple[float, float, float] = (0, 0, 0), turn: float = 0) -> list[float]:
    """The margin of each segment of the square peg at ±1 mm, ±1°, its parts written like this."""
    scale = {"mm": 1.0, "m": 1e-3}[unit]
    x, y, z = at
    heights = {"bottom": z + 10, "top": z + 40}
    numbers = {name: scale * size for name, size in {**SIZES, **heights, "x": x, "y": y, "z": z}.items()}
    for name, model in (("square_peg", PEG), ("square_hole_block", BLOCK)):
        (folder / f"{name}.toml").write_text(model.format(unit=unit, turn=turn, **numbers))
    problem = (ROOT / "problems" / "square_peg_100um.toml").read_text().replace("../models/", "")
    (folder / "problem.toml").write_text(problem)
    return certified(load(folder / "problem.toml"))


def certified(problem: Problem) -> list[float]:
    """The margin of each segment of the plan."""
    document = synthesise(problem).document
    assert document["verdict"] == "CERTIFIED"
    return [segment["margin"] for segment in document["segments"]]


def test_how_the_models_are_written_does_not_matter(tmp_path: Path) -> None:
    plain = margins(tmp_path)
    for written in ({"unit": "m", "at": (100, -50, 30), "turn": 90}, {"turn": 37}):
        assert margins(tmp_path, **written) == pytest.approx(plain, rel=1e-9)  # type: ignore[arg-type]


@pytest.mark.wide
def test_images_in_a_mirror_get_the_same_plan(tmp_path: Path) -> None:
    outline = [(-10.0, -8.0), (10.0, -8.0), (10.0, 4.0), (-10.0, 9.0)]
    images = {  # of which all eight are made
        "plain": outline,
        "mirrored": [(-x, y) for x, y in reversed(outline)],
        "exchanged": [(y, x) for x, y in reversed(outline)],
    }
    found = {}
    for name, corners in images.items():
        (tmp_path / name).mkdir()
        found[name] = certified(prism(tmp_path / name, [list(corner) for corner in corners], (0.1, 0.1)))
    # The same but for what cone programs leave of rounding, step after step.
    assert found["mirrored"] == pytest.approx(found["plain"], rel=1e-3, abs=1e-9)
    assert found["exchanged"] == pytest.approx(found["plain"], rel=1e-3, abs=1e-9)
