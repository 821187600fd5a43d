"""Tool and obstacles of a problem file: their frames, their short forms, and what is refused at its place."""

from pathlib import Path

import numpy as np
import pytest

import fmopt
from fmopt.errors import InputError
from fmopt.plan.press import ConvexSolid
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array
from fmopt.task.problem import Problem
from tests.shared.files.pair import PAIR, SHORT, START, files

# The peg's model frame is that of the feature; the mouth is 40 mm above that of the block.
CELL = """
[tool]
tcp = { at = [0, 0, "80 mm"], turn = [0, 0, "90 deg"] }
[tool.solids]
gripper = { shape = "box", size = ["40 mm", "20 mm", "30 mm"], at = [0, 0, "50 mm"] }
finger = { model = "peg.toml", at = ["1 mm", 0, "50 mm"], turn = [0, "90 deg", 0] }
[obstacles]
wall = { shape = "box", size = ["10 mm", "60 mm", "20 mm"], at = ["35 mm", 0, "40 mm"] }
"""


def extent(solid: ConvexSolid) -> list[list[float]]:
    """Least and greatest coordinates, mm."""
    corners = 1e3 * np.vstack(solid.pieces)
    return [corners.min(axis=0).round(6).tolist(), corners.max(axis=0).round(6).tolist()]


def moved(solid: ConvexSolid, pose: Array) -> list[list[float]]:
    corners = 1e3 * Pose.from_vector(pose).apply(np.vstack(solid.pieces))
    return [corners.min(axis=0).round(6).tolist(), corners.max(axis=0).round(6).tolist()]


def loaded(folder: Path, more: str, short: str = SHORT) -> Problem:
    found = files(folder, {"problem.toml": f"{short}{START}{more}"})
    assert isinstance(found, Problem)
    return found


def test_solids_are_in_the_frames_of_the_parts_that_they_go_with(tmp_path: Path) -> None:
    problem = loaded(tmp_path, CELL)
    gripper, finger = problem.cell.moving
    (wall,) = problem.cell.fixed
    assert [one.name for one in problem.cell.solids] == ["gripper", "finger", "wall"]
    assert extent(gripper) == [[-20, -10, 50], [20, 10, 80]]
    assert extent(finger) == [[1, -10, 40], [51, 10, 60]]  # 50 mm long, lying along x
    assert extent(wall) == [[30, -30, 0], [40, 30, 20]]
    assert problem.tcp == pytest.approx([0, 0, 0.08, 0, 0, 0.5 * np.pi])
    assert fmopt.load(tmp_path / "problem.toml").sha256 != loaded(tmp_path, CELL.replace("35 mm", "36 mm")).sha256


def test_files_named_alone_count_with_their_contents(tmp_path: Path) -> None:
    text = '[tool.solids]\ngripper = "held.toml"\n'
    (tmp_path / "held.toml").write_text(PAIR["peg.toml"])
    one = loaded(tmp_path, text)
    (tmp_path / "held.toml").write_text(PAIR["peg.toml"].replace("20, 20, 50", "20, 20, 51"))
    other = loaded(tmp_path, text)
    assert [extent(one.cell.moving[0])[1][2], extent(other.cell.moving[0])[1][2]] == [50, 51]
    assert one.sha256 != other.sha256


def test_where_the_hollow_part_is_held_the_tool_goes_with_the_hole(tmp_path: Path) -> None:
    """Seated, all is where it is with the peg in the hand."""
    text = CELL[CELL.index("[tool.solids]") :].replace('"peg.toml", at', '"held.toml", at')
    (tmp_path / "held.toml").write_text(PAIR["peg.toml"])
    problem = loaded(tmp_path, text, 'moving = "block.toml"\nfixed = "peg.toml"\n')
    assert [one.name for one in problem.cell.fixed] == ["gripper", "finger"]
    assert [one.name for one in problem.cell.moving] == ["wall"]
    assert extent(problem.cell.fixed[0]) == [[-20, -10, 10], [20, 10, 40]]  # in the block's frame, whose mouth is at 40
    assert moved(problem.cell.moving[0], problem.goal)[0][2] == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("more", "key", "words"),
    [
        ('[obstacles]\nwall = "wall.stl"\n', "obstacles.wall.model", "does not exist"),
        ('[obstacles]\nwall = { shape = "cube" }\n', "obstacles.wall", "there is no shape 'cube'"),
        ("[obstacles]\nwall = { size = 3 }\n", "obstacles.wall", "the key 'shape' is missing"),
        ('[tool.solids]\ng = { model = "peg.toml", width = 3 }\n', "tool.solids.g.width", "there is no such key"),
        ('[obstacles.w]\nshape = "wedge"\nsize = ["1 mm", "1 mm", "1 mm"]\ntop_x = "9 mm"\n', "obstacles.w", ""),
        ('[settings]\nmax_time = "5 mm"\n', "settings.max_time", "not a time"),
    ],
)
def test_faults_have_their_place(tmp_path: Path, more: str, key: str, words: str) -> None:
    with pytest.raises(InputError) as told:
        loaded(tmp_path, more)
    assert [fault.key for fault in told.value.faults] == [key]
    assert words in told.value.faults[0].message
    assert told.value.faults[0].line > 4
    assert told.value.faults[0].advice
