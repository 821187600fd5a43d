"""Keys of model, problem and assembly files beyond the plain insertion, and how they reach the knowledge base."""

import ast
import math
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fmopt
from fmopt.errors import InputError
from fmopt.geometry.convex_pieces import polyhedron
from fmopt.geometry.csg import Cylinder, Moved, Sphere
from fmopt.spatial.se3 import Pose, exp
from fmopt.task.object_model.command import answer
from fmopt.task.object_model.tree import ObjectTree, TreeFeature
from fmopt.task.problem import Problem
from fmopt.task.task_command import is_round, problem_answer, task_command
from fmopt.task.toml import assembly_file, model_file, problem_file, tables
from fmopt.task.toml.tables import Measured
from fmopt.task.toml.units import EXAMPLES, at_most, evaluate
from tests import ROOT
from tests.shared.files import models
from tests.shared.files.shipped import loaded, shipped, swapped
from tests.shared.parts.workcells import close
from tests.shared.solids import contains

NOSED = """
name = "nosed"
part = "nosed"
units = {length = "mm", angle = "deg"}
[parameters]
radius = 10
[solids.nose]
shape = "sphere"
radius = "radius"
at = [0, 0, "radius"]
sides = 32
[solids.shaft]
shape = "cylinder"
radius = "radius"
height = 40
at = [0, 0, "radius"]
[solids.nosed]
shape = "union"
of = ["nose", "shaft"]
[features.peg]
kind = "solid"
at = [0, 0, 0]
length = 50
"""


def tree_of(folder: Path, text: str) -> ObjectTree:
    path = folder / "model.toml"
    path.write_text(text, encoding="utf-8")
    return models.tree_of(path)


def test_a_sphere_is_a_solid_of_a_model_file(tmp_path: Path) -> None:
    tree = tree_of(tmp_path, NOSED)
    peg = tree.feature("peg")
    assert next(leaf.primitive for leaf in peg.instances) == Sphere(0.01, 32)
    assert is_round(peg)
    nose = polyhedron(tree.solid).volume - polyhedron(Cylinder(0.01, 0.04)).volume
    assert nose == pytest.approx(2.0 / 3.0 * math.pi * 0.01**3, rel=0.05)
    assert contains(tree.solid, [[0, 0, 1e-4], [0.009, 0, 1e-3], [0.009, 0, 0.011]]).tolist() == [True, False, True]


@pytest.mark.parametrize(("x", "expected"), [(0.0, True), (1e-6, False)])
def test_a_sphere_is_round_however_it_is_turned(x: float, expected: bool) -> None:
    body = Moved(Sphere(0.01), Pose.from_vector([x, 0, 0.01, 0.5, 0, 0]))
    assert is_round(TreeFeature("nose", "+", Pose.identity(), body, 0.02)) is expected


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('shape = "sphere"', 'shape = "spher"', r"7:9: unknown-choice: solids.nose: .*'sphere'"),
        ('radius = "radius"\nat', "radius = 0\nat", r"9:10: zero: solids.nose.radius"),
        ("sides = 32", "sides = 2", r"11:9: .*solids.nose.sides"),
    ],
)
def test_faults_of_spheres_have_their_place(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in NOSED
    with pytest.raises(InputError, match=words):
        tree_of(tmp_path, NOSED.replace(old, new, 1))


PROBLEM, ROUND = shipped("square_peg"), shipped("lee_huang_peg")


def edited(folder: Path, *edits: tuple[str, str], text: str = PROBLEM) -> Problem:
    for old, new in edits:
        assert old in text
        text = text.replace(old, new, 1)
    return loaded(folder, text)


def test_a_problem_names_pair_grasp_and_angle(tmp_path: Path) -> None:
    goal = 'depth = 25\nturn = 90\nattachment = "revolute"\n\n[grasp]\nat = [0, 0, -60]\nturn = [0, 10, 0]\n'
    problem = edited(tmp_path, ('depth = "full"\n', goal))
    assert (problem.task.attachment, problem.task.exchanged) == ("revolute", False)
    assert problem.task.turn == pytest.approx(math.radians(90))
    np.testing.assert_allclose(problem.task.grasp.vector(), [0, 0, -0.06, 0, math.radians(10), 0], atol=1e-15)
    _, wanted = task_command(problem)
    assert (wanted.goal, wanted.attachment) == ((0.0, 0.0, -0.025, 0.0, 0.0, 0.0), "revolute")
    assert wanted.grasp is problem.task.grasp


@pytest.mark.parametrize(
    ("old", "new", "preset", "stiffness", "offset"),
    [
        ("title =", "title =", "generic", 2e4, 1.0),
        ("title =", 'robot = "ur10e"\ntitle =', "ur10e", 2e4, 5.5),
        ("[moving]", '[robot]\npreset = "franka"\nforce_offset = "0.5 N"\n[moving]', "franka", 3e3, 0.5),
    ],
)
def test_what_a_robot_does_not_state_is_of_its_preset(
    old: str, new: str, preset: str, stiffness: float, offset: float, tmp_path: Path
) -> None:
    robot = edited(tmp_path, (old, new)).robot
    assert (robot.preset, robot.stiffness, robot.force_offset) == (preset, stiffness, offset)


def test_the_manual_has_the_values_of_all_presets() -> None:
    text = (ROOT / "fmopt" / "manual" / "presses.md").read_text("utf-8")
    presets = tomllib.loads((ROOT / "fmopt" / "task" / "toml" / "robots.toml").read_text("utf-8"))
    for key, unit in (("stiffness", 1e3), ("turning", 1.0), ("force_offset", 1.0), ("torque_offset", 1.0)):
        cells = re.search(rf"^\| `{key}` \|(.+)$", text, re.MULTILINE)[1].split("|")  # type: ignore[index]
        assert [unit * float(cell.split()[0]) for cell in cells[:4]] == [one[key] for one in presets.values()]


def test_the_angle_at_the_goal_is_in_the_mating_frame(tmp_path: Path) -> None:
    """A part that is asymmetric about its axis: at the goal its vertices are where the file's angle puts them."""
    rectangular = shipped("factory_rect_8mm_tight")
    flat = edited(tmp_path, text=rectangular)
    turned = edited(tmp_path, ('depth = "full"', 'depth = "full"\nturn = 30'), text=rectangular)
    angle = exp([0.0, 0.0, math.radians(30)])
    np.testing.assert_allclose(turned.moving.polyhedron.vertices, flat.moving.polyhedron.vertices @ angle.T, atol=1e-15)
    cell, wanted = task_command(turned)
    frames = cell.frame(wanted.moving), cell.object(wanted.moving.object).frame
    assert close(frames[0], Pose.from_vector(turned.start))
    body = polyhedron(cell.object(wanted.moving.object).solid).vertices
    own = frames[0].inverse().apply(frames[1].apply(body))
    np.testing.assert_allclose(np.sort(own, axis=0), np.sort(turned.moving.polyhedron.vertices, axis=0), atol=1e-12)


@pytest.mark.parametrize(("text", "expected"), [(PROBLEM, ("prismatic", False)), (ROUND, ("cylindrical", True))])
def test_the_pair_is_chosen_by_the_peg(tmp_path: Path, text: str, expected: tuple[str, bool]) -> None:
    text = text.replace('attachment = "cylindrical"\n', "").replace('turn = "free"', "")
    problem = edited(tmp_path, text=text)
    assert (problem.task.attachment, problem.task.free_turn) == expected
    assert problem.task.free_depth


def test_a_free_angle_is_as_at_the_start(tmp_path: Path) -> None:
    begin = ("at = [15, 4, 12]", "at = [15, 4, 12]\nturn = [0, 0, 30]")
    problem = edited(tmp_path, begin, text=ROUND)
    assert problem.task.turn == pytest.approx(math.radians(30), abs=1e-12)
    np.testing.assert_allclose(problem.start, [0.015, 0.004, 0.012, 0, 0, 0], atol=1e-12)
    found = problem_answer(problem)
    np.testing.assert_allclose(found.P0, problem.start, atol=1e-12)
    np.testing.assert_allclose(found.PT, problem.goal, atol=1e-12)
    kept = edited(tmp_path, begin, ('turn = "free"', "turn = 0"), text=ROUND)
    np.testing.assert_allclose(kept.start, [0.015, 0.004, 0.012, 0, 0, math.radians(30)], atol=1e-12)


def test_the_hollow_part_in_the_hand(tmp_path: Path) -> None:
    plain = edited(tmp_path, text=ROUND)
    begin, turn = ("at = [15, 4, 12]", "at = [-15, -4, -12]"), ('turn = "free"', "turn = 20")
    problem = edited(tmp_path, begin, turn, text=swapped(ROUND))
    assert problem.task.exchanged
    assert (problem.moving_feature, problem.fixed_feature) == ("peg", "hole")
    assert problem.task.turn == pytest.approx(-math.radians(20))
    np.testing.assert_allclose(problem.fixed.polyhedron.vertices, plain.fixed.polyhedron.vertices, atol=0)
    np.testing.assert_allclose(problem.start[:3], [0.015, 0.004, 0.012], atol=1e-15)
    np.testing.assert_allclose(problem.start[3:], [0, 0, math.radians(20)], atol=1e-15)
    cell, wanted = task_command(problem)
    assert str(wanted.moving) == "lee_huang_block.hole"
    found = answer(cell, wanted)
    assert found.exchanged
    np.testing.assert_allclose(found.P0, problem.start, atol=1e-12)
    np.testing.assert_allclose(found.PT, problem.goal, atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('depth = "full"', 'depth = "ful"', r"18:9: .*goal.depth"),
        ('depth = "full"', 'depth = "full"\nattachment = "glued"', r"19:14: unknown-choice: goal.attachment: 'glued'"),
        ('depth = "full"', 'depth = "full"\nattachment = "planar"', r"19:14: no-insertion: .*planar pair is not made"),
        ('depth = "full"', 'depth = "full"\nturn = "fre"', r"19:8: .*goal.turn"),
        ("title =", 'robot = "ur5"\ntitle =', r":9: unknown-choice: robot.preset: 'ur5' is none of the choices"),
        ("[specification]", '[robot]\nmax_force = "5 N"\n[specification]', r"contact_force: .* more than the robot"),
        ("height = 1", "height = 1\nat = [0, 0]", r"26:6: wrong-length: start.at"),
        ("height = 1", "height = 1\n[grasp]\nat = [0, 0, 1, 2]", r"27:6: wrong-length: grasp.at"),
        ("[uncertainty.velocity]", "[uncertainty.trapezoid]\nball = -1\n[uncertainty.velocity]", r"36:8: negative"),
    ],
)
def test_faults_of_these_keys_have_their_place(tmp_path: Path, old: str, new: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        edited(tmp_path, (old, new))


def test_a_start_turned_half_round_leaves_no_free_angle(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"task-rule: goal.turn: the start of .* turned by 180 deg"):
        edited(tmp_path, ("at = [15, 4, 12]", "at = [15, 4, 12]\nturn = [180, 0, 0]"), text=ROUND)


def test_sources_of_errors_are_refused_with_the_hollow_part_in_the_hand(tmp_path: Path) -> None:
    text = swapped(ROUND)
    start = text[text.index("[uncertainty.start]") : text.index("# S(t)")]
    sources = "[uncertainty.sources]\nrobot = { position = 0.01 }\ngrasp = { height = 30 }\n"
    with pytest.raises(InputError, match=r"conflict: uncertainty.sources: with the hollow part in the hand"):
        edited(tmp_path, (start, sources), text=text)


def keys_of(schema: Any) -> set[str]:
    """All keys of all tables of a schema."""
    if isinstance(schema, dict):
        own = set(schema.get("properties", {})) if isinstance(schema.get("properties"), dict) else set()
        return own.union(*map(keys_of, schema.values()))
    return set().union(*map(keys_of, schema)) if isinstance(schema, list) else set()


def test_keys_that_messages_name_exist() -> None:
    known = keys_of(problem_file.ProblemFile.model_json_schema()) | keys_of(model_file.ModelFile.model_json_schema())
    named_key = r"(?<![\w.\[])(settings|specification|goal|start|clearance|uncertainty|mesh|grasp|units)\.([a-z_]+)\b"
    others = {"verify", "same_problem.py"}  # these name keys of plans
    paths = [path for path in Path(fmopt.__file__).parent.rglob("*.py") if not others & set(path.parts)]
    nodes = [node for path in paths for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))]
    texts = [one.value for one in nodes if isinstance(one, ast.Constant) and isinstance(one.value, str)]
    named = [found for text in texts if "\n" not in text for found in re.findall(named_key, text)]
    assert len(named) > 3
    assert [found for found in named if found[1] not in known] == []


def measured() -> Iterator[Measured]:
    """The limits of all numbers of problem, model and assembly files."""
    for module in (tables, problem_file, model_file, assembly_file):
        for kind in vars(module).values():
            yield from (one for one in getattr(kind, "__metadata__", ()) if isinstance(one, Measured))


def test_limits_are_taken_as_they_are_told() -> None:
    limits: set[Any] = set(measured())
    assert len(limits) > 15
    for one in limits:
        for bound in (one.low, one.high):
            assert bound == 0.0 or one.low <= evaluate(at_most(bound, one.dimension)).value <= one.high
        assert one.low <= evaluate(EXAMPLES[one.dimension].strip('"')).value <= one.high
