"""A plan held against its problem: everything that a claim rests on is compared, and a changed file is noticed."""

import copy
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fmopt.plan import parsed, sealed
from fmopt.planning.same_problem import differences
from fmopt.task.problem import load
from fmopt.verify.reading.parse import parse
from tests import ROOT
from tests.shared.files.shipped import copied, edit
from tests.shared.plans.press_plan import press_plan_document, press_problem

PEG = ROOT / "problems" / "square_peg.toml"
Change = Callable[[dict[str, Any]], Any]


def shifted(side: str, axis: int, by: float) -> Change:
    """Moves the corners of a part that lie farthest along an axis."""

    def change(plan: dict[str, Any]) -> None:
        corners = plan["parts"][side]["vertices"]
        most = max(corner[axis] for corner in corners)
        for corner in corners:
            if corner[axis] > most - 1e-9:
                corner[axis] += by

    return change


def scaled(side: str, factor: float) -> Change:
    def change(plan: dict[str, Any]) -> None:
        for shape in (plan["parts"][side], *plan["parts"][side]["pieces"]):
            shape["vertices"] = [[factor * x for x in corner] for corner in shape["vertices"]]

    return change


LIES: dict[str, tuple[Change, str]] = {
    "digest": (lambda p: p["problem"].update(sha256=p["problem"]["sha256"][::-1]), "problem.sha256: the plan belongs"),
    "one start error": (lambda p: p["uncertainty"]["start_box"].__setitem__(1, 2.9e-4), "for other start errors:"),
    "a share of the errors": (
        lambda p: p["uncertainty"].update(start_box=[0.1 * x for x in p["uncertainty"]["start_box"]]),
        "for other start errors, 10% of them:",
    ),
    "another frame": (
        lambda p: p["uncertainty"].update(sources=[{"frame": "hole", "box": p["uncertainty"]["start_box"]}]),
        "takes other errors for fixed in the hole",
    ),
    "velocity error": (lambda p: p["uncertainty"].update(velocity_error=[0.001, 0.001]), "another velocity error"),
    "length that weighs rotation": (
        lambda p: p["uncertainty"].update(rho=1.2 * p["uncertainty"]["rho"]),
        "weighs rotation by another length: 0.0169",
    ),
    "depth": (lambda p: p["goal"].__setitem__(2, -0.029), "ends at another depth: z is -0.029 m"),
    "orientation": (lambda p: p["goal"].__setitem__(5, 0.01), "ends in another orientation"),
    "height": (lambda p: p["segments"][0]["start"].__setitem__(2, 0.05), "lowest point starts"),
    "speed": (lambda p: p["specification"].update(speed=0.021), "specification.speed: the plan is for another"),
    "contact force": (lambda p: p["specification"].update(contact_force=19.0), "specification.contact_force"),
    "torque": (lambda p: p["specification"].update(torque_limit=2.0), "specification.torque_limit"),
    "friction": (lambda p: p["specification"].update(friction=0.0), "specification.friction"),
    "threshold": (lambda p: p["specification"].update(termination_force=1.0), "specification.termination_force"),
    "impact": (
        lambda p: p["specification"].update(impact_force=9.0, apparent_mass=1.0, contact_stiffness=1e4),
        "specification.impact_force: the plan is for another specification: 9.0 stands where the problem gives None",
    ),
    "declared clearance": (
        lambda p: p["parts"]["fixed"].update(declared_clearance=[1.0, 1.0]),
        "another declared clearance",
    ),
    "a longer peg": (shifted("moving", 2, 1e-6), "its corners lie up to 0.001 mm off"),
    "a skin of 1 nm": (shifted("moving", 0, 1e-9), "parts.moving: the plan is for another moving part"),
    "a wider hole": (shifted("fixed", 0, -1e-6), "for another fixed part"),
    "another face": (lambda p: p["parts"]["fixed"]["faces"].pop(), "faces where the file has"),
    "units": (scaled("moving", 1.001), "for another moving part"),
}


@pytest.mark.parametrize("lie", LIES)
def test_everything_that_a_claim_rests_on_is_compared(square_peg_plan: dict[str, Any], lie: str) -> None:
    change, words = LIES[lie]
    changed = copy.deepcopy(square_peg_plan)
    change(changed)
    assert any(words in told for told in differences(parse(changed), load(PEG))), differences(parse(changed), load(PEG))


PRESS_LIES: dict[str, tuple[Change, str]] = {
    "one piece more": (lambda p: p["parts"]["fixed"]["pieces"].append(p["parts"]["fixed"]["pieces"][0]), "pieces"),
    "beside the goal": (lambda p: p["goal"].__setitem__(0, 0.005), "ends beside the goal"),
    "another seat": (lambda p: p["presses"]["seat"].update(clearance=0.05), "seat: the plan's trials"),
    "a lower rate": (lambda p: p["evidence"].update(min_rate=0.01), "evidence.min_rate"),
    "no friction": (lambda p: p["evidence"]["conditions"].update(friction=[0.0, 0.0]), "evidence.conditions"),
    "a wall": (lambda p: p["presses"].update(cell={"fixed": [{"name": "w", "pieces": [[[0, 0, 1]]]}]}), "presses.cell"),
    "another tool": (lambda p: p["description"].update(tcp=[0.0, 0.0, 0.1, 0.0, 0.0, 0.0]), "description.tcp"),
    "more time": (lambda p: p["evidence"].update(max_time=9.0), "evidence.max_time"),
    "another feature": (
        lambda p: p["parts"]["moving"].update(found={"side": "fixed", "feature": "nonsense"}),
        "parts.moving.found",
    ),
}


@pytest.mark.parametrize("lie", PRESS_LIES)
def test_what_trials_rest_on_is_compared(lie: str) -> None:
    change, words = PRESS_LIES[lie]
    document = copy.deepcopy(press_plan_document())
    assert differences(parsed(sealed(document)), press_problem()) == ()
    change(document)
    told = differences(parsed(sealed(document)), press_problem())
    assert any(words in line for line in told), told


def test_a_true_plan_differs_in_nothing(square_peg_plan: dict[str, Any]) -> None:
    assert differences(parse(square_peg_plan), load(PEG)) == ()


@pytest.fixture
def files(tmp_path: Path) -> Path:
    copied(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("file", "old", "new", "words"),
    [
        ("models/square_peg.toml", "width = 20", "width = 20.001", "another moving part"),
        ("models/square_hole_block.toml", 'kind = "hollow"', 'kind = "hollow"\nturn = [0, 0, 1]', "another fixed part"),
        ("problems/square_peg.toml", 'length = "mm"', 'length = "cm"', "uncertainty.start_box"),
        ("problems/square_peg.toml", "[settings]", "[settings]\ncharacteristic_length = 12", "uncertainty.rho"),
        ("problems/square_peg.toml", "[start]", "[start]\nturn = [0, 0, 0] #", None),
        ("problems/square_peg.toml", "height = 1", "height = 2", "segments[0].start"),
    ],
)
def test_a_problem_that_changed_is_noticed(
    square_peg_plan: dict[str, Any], files: Path, file: str, old: str, new: str, words: str | None
) -> None:
    edit(files / file, old, new)
    told = differences(parse(square_peg_plan), load(files / "problems" / "square_peg.toml"))
    assert any("problem.sha256" in line for line in told)
    assert words is None or any(words in line for line in told), told


def test_a_bad_problem_file_ends_verify_with_its_place(square_peg_plan_file: Path, files: Path) -> None:
    problem = files / "problems" / "square_peg.toml"
    edit(problem, "\nx = 0.3", '\nx = "0.3 parsec"')
    command = [sys.executable, "-m", "fmopt", "verify", str(square_peg_plan_file), "--problem", str(problem)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "square_peg.toml" in done.stderr
    assert "uncertainty.start.x" in done.stderr
