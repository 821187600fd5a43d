"""Exports: the guarded moves behind them, task frames, URScript by its grammar, tables and YAML read back."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from lark.exceptions import UnexpectedInput
from typer.testing import CliRunner

from fmopt import plan
from fmopt.cli import app
from fmopt.errors import PlanFormatError, UnprovedError
from fmopt.plan import parsed as read
from fmopt.plan.contact_geometry import contacts
from fmopt.plan.export import ros2
from fmopt.plan.export.cautions import base_pose, insertion_words
from fmopt.plan.export.frame import task_frame
from fmopt.plan.export.sampled import csv_text, json_text, samples
from fmopt.plan.export.urscript import ProgramSettings, program
from fmopt.plan.guarded_moves import PlanMove, from_frame, moves, to_frame
from fmopt.spatial.se3 import Pose, exp
from tests.shared.lies.mutations import changed
from tests.shared.urscript.language import Halt, Interpreter, arguments, calls, constant, distance, faults, parsed
from tests.shared.urscript.robot import ForceModeRobot

RHO = 0.014
BASE = Pose.from_vector([0.4, -0.1, 0.2, 0.3, 3.0, -0.2])
SCALE = np.array([1.0, 1.0, 1.0, RHO, RHO, RHO])


def pressing(force_axes: Any, hold: Any, frame: Pose) -> PlanMove:
    """A move that presses along the axes of a frame; what it does else does not matter here."""
    goal = Pose.from_vector([0.001, 0.002, 0.003, 0.1, 0.0, 0.05])
    wrench = from_frame(frame, np.asarray(hold, dtype=np.float64), goal.p)
    return PlanMove(
        *(0, 0, True, goal, goal, 0.0, 1.0, np.zeros(6), frame, np.zeros((0, 6)), force_axes),
        *(wrench, wrench, np.zeros(6), None, (), ()),
    )


def span(rows: Any) -> np.ndarray:
    """Projector onto the space of wrenches, scaled by ρ."""
    basis = np.linalg.svd(np.asarray(rows) / SCALE, full_matrices=False)[2][: len(rows)]
    return basis.T @ basis


# Guarded moves


def test_the_holding_wrench_has_no_power_on_the_free_motions(square_peg_plan: dict[str, Any]) -> None:
    for move in moves(read(square_peg_plan)):
        local = to_frame(move.frame, move.hold, move.goal.p)
        assert np.abs(move.position_axes @ local).max() < 1e-5


def test_gains_read_the_normal_force_of_the_new_contacts_and_little_of_the_held(
    square_peg_plan: dict[str, Any],
) -> None:
    known = contacts(read(square_peg_plan))
    for move, row in zip(moves(read(square_peg_plan)), square_peg_plan["segments"], strict=True):
        end = row["hybrid"]["termination"]
        if move.stop is None:
            assert not end["contacts"]
            continue
        assert move.stop.gain @ np.array(end["wrench"]) == pytest.approx(end["threshold"], rel=1e-9)
        assert end["threshold"] <= move.stop.force < 40.0
        if len(move.state) == 1:
            point = known[move.state[0]].touch(move.goal)[0] - move.goal.p
            through = np.hstack([np.eye(3), np.cross(point, np.eye(3))])
            assert np.abs(through @ move.stop.gain).max() < 0.5


def test_contacts_touch_where_the_plan_holds_them(square_peg_plan: dict[str, Any]) -> None:
    known = contacts(read(square_peg_plan))
    for move, row in zip(moves(read(square_peg_plan)), square_peg_plan["segments"], strict=True):
        pressed = np.zeros(6)
        for entry in row["hybrid"]["normal_forces"]:
            contact = known[entry["contact"]]
            assert abs(contact.touch(move.goal)[2]) < 1e-8
            assert abs(contact.touch(move.start)[2]) < 1e-5
            pressed -= entry["force"] * contact.wrench(move.goal)
        assert np.abs(pressed - move.hold).max() < 1e-6


def test_a_bias_that_presses_nothing_held_is_refused(square_peg_plan: dict[str, Any]) -> None:
    plan = json.loads(json.dumps(square_peg_plan))
    held = next(i for i, row in enumerate(plan["segments"]) if row["state"])
    plan["segments"][held]["hybrid"]["bias_wrench"][5] += 0.1
    with pytest.raises(PlanFormatError, match=rf"segment {held}: [0-9.]+ N of its bias press where"):
        moves(read(plan))


# Task frames


@pytest.mark.parametrize(
    "axes", [(0,), (1, 3), (0, 4, 5), (0, 1, 3, 5), (0, 1, 2), (3, 4, 5), (2, 3, 4), tuple(range(6))]
)
def test_turned_and_shifted_axes_are_found_again(axes: tuple[int, ...]) -> None:
    random = np.random.default_rng(len(axes))
    for _ in range(20):
        frame, hidden = (Pose(0.02 * random.normal(size=3), exp(random.normal(size=3))) for _ in range(2))
        mixed = random.normal(size=(len(axes), len(axes))) @ (np.eye(6)[list(axes)] * SCALE)
        about_b = from_frame(hidden, mixed, np.zeros(3))
        move = pressing(to_frame(frame, about_b, np.zeros(3)), np.zeros(6), frame)
        found = task_frame(move, RHO)
        assert sum(found.selection) == len(axes)
        chosen = from_frame(found.pose, np.eye(6)[np.array(found.selection) == 1] * SCALE, np.zeros(3))
        assert np.abs(span(chosen) - span(about_b)).max() < 1e-4


def test_a_frame_that_fits_is_kept() -> None:
    frame = Pose.from_vector([0.01, 0.0, 0.02, 0.0, 0.2, 0.1])
    found = task_frame(pressing(np.eye(6)[[1, 3]] * SCALE, [0, -5, 0, 0.01, 0, 0], frame), RHO)
    assert np.abs(found.pose.p - frame.p).max() < 1e-15
    assert np.abs(found.pose.R - frame.R).max() < 1e-15
    assert found.selection == (0, 1, 0, 1, 0, 0)
    assert np.abs(found.wrench - [0, -5, 0, 0.01, 0, 0]).max() < 1e-12


@pytest.mark.parametrize(
    "rows",
    [
        [[1, 0, 0, 0.005, 0, 0]],  # a screw
        [[1, 0, 0, 0, 0, 0], [0, 0, 0, RHO, RHO, 0]],  # a torque askew to a force
        [[1, 0, 0, 0, 0, 0], [0, 1, 0, 0.005, 0.004, 0]],  # two lines that do not meet
    ],
)
def test_axes_orthogonal_in_no_frame_are_refused_with_their_segment(rows: list[list[float]]) -> None:
    move = replace(pressing(np.array(rows), np.zeros(6), Pose.identity()), segment=7)
    with pytest.raises(PlanFormatError, match=r"segment 7: its \d force axes are not orthogonal in any one frame"):
        task_frame(move, RHO)


def test_a_bias_on_a_stiff_axis_is_refused() -> None:
    with pytest.raises(PlanFormatError, match="presses on a stiff axis by 2 N"):
        task_frame(pressing(np.eye(6)[[0]], [-3, 2, 0, 0, 0, 0], Pose.identity()), RHO)


# URScript


def test_the_program_is_of_the_language_with_arity_and_units(square_peg_plan: dict[str, Any]) -> None:
    tree = parsed(program(read(square_peg_plan), BASE))
    assert faults(tree) == []
    named = [str(call.children[0]) for call in calls(tree)]
    assert named.count("force_mode") == len(square_peg_plan["segments"])
    assert named.index("zero_ftsensor") < named.index("force_mode")
    assert "\n  # move 1, segments[0], held: nothing\n" in program(read(square_peg_plan), BASE)
    assert named.count("force_mode_set_damping") == named.count("force_mode_set_gain_scaling") == 1


def test_force_modes_say_in_the_base_what_the_plan_says_in_its_frame(square_peg_plan: dict[str, Any]) -> None:
    tree = parsed(program(read(square_peg_plan), BASE))
    modes = [arguments(call) for call in calls(tree) if call.children[0] == "force_mode"]
    for move, mode in zip(moves(read(square_peg_plan)), modes, strict=True):
        pose, selection, wrench, kind, limits = (constant(part) for part in mode)
        frame = BASE.inverse().compose(Pose.from_vector(pose))
        assert kind == 2.0
        assert sum(selection) == len(move.force_axes)
        pressed = from_frame(frame, np.array(wrench), move.start.p)
        assert np.abs((pressed - move.hold_start) / SCALE).max() < 0.03 * np.linalg.norm(move.hold) + 1e-9
        assert all(limit > 0.0 for limit in limits)


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("zero_ftsensor()", "zero_ftsensor(1)", "zero_ftsensor takes 0 arguments, not 1"),
        (", 2, [", ", 1, [", "force_mode: the frame would move"),
        (", 2, [", ", [", "force_mode takes 5 arguments, not 4"),
        ("end_force_mode()", "end_force()", "end_force is no function"),
        ("set_damping(0.1)", "set_damping(1.5)", "force_mode_set_damping: 1.5 is outside 0..1"),
        ("[0, 0, 0, 0, 0, 0]", "[0, 0, 0.5, 0, 0, 0]", "force_mode: selection is not of 0 and 1"),
        ("[0, 0, 0, 0, 0, 0]", "[0, 0, 0]", "force_mode: no list of six for 0|1 0|1 0|1 0|1 0|1 0|1"),
    ],
)
def test_the_check_of_the_language_sees_faults(square_peg_plan: dict[str, Any], old: str, new: str, fault: str) -> None:
    text = program(read(square_peg_plan), BASE)
    assert old in text
    assert fault in faults(parsed(text.replace(old, new)))


def test_numbers_with_exponents_are_not_of_the_language() -> None:
    with pytest.raises(UnexpectedInput):
        parsed("sleep(1e-3)")


class Robot:
    """A robot in free air."""

    def __init__(self, start: list[float]) -> None:
        self.start, self.time, self.forced, self.log = start, 0.0, False, list[str]()

    def built_in(self) -> dict[str, Any]:
        quiet = ("force_mode_set_damping", "force_mode_set_gain_scaling", "movel", "sleep", "zero_ftsensor", "stopl")
        return {
            **{name: lambda *_: None for name in quiet},
            "force_mode": lambda *_: setattr(self, "forced", True),
            "end_force_mode": lambda: setattr(self, "forced", False),
            "get_steptime": lambda: 0.002,
            "speedl": self.speedl,
            "get_tcp_force": lambda: [0.0] * 6,
            "get_actual_tcp_speed": lambda: [0.0] * 6,
            "get_actual_tcp_pose": lambda: self.start,
            "point_dist": distance,
            "pose_trans": lambda a, b: list(Pose.from_vector(a).compose(Pose.from_vector(b)).vector()),
            "textmsg": lambda *words: self.log.append("".join(words)),
        }

    def speedl(self, *_: Any) -> None:
        self.time += 0.002

    def run(self, text: str) -> None:
        Interpreter(self.built_in()).run(parsed(text))


def test_a_contact_that_is_not_felt_ends_the_program_and_the_force_mode(square_peg_plan: dict[str, Any]) -> None:
    rows = moves(read(square_peg_plan))
    robot = Robot(list(BASE.compose(rows[0].start).vector()))
    with pytest.raises(Halt):
        robot.run(program(read(square_peg_plan), BASE))
    guarded = next(move for move in rows if move.stop is not None and move.last)
    assert guarded.stop is not None
    assert not robot.forced
    assert robot.log == [f"fmopt: move {guarded.number + 1}: {', '.join(guarded.stop.contacts)} not felt"]
    assert robot.time > sum(move.duration for move in rows[: guarded.segment + 1])


def test_a_part_that_is_elsewhere_is_not_moved(square_peg_plan: dict[str, Any]) -> None:
    robot = Robot([0.0] * 6)
    with pytest.raises(Halt):
        robot.run(program(read(square_peg_plan), BASE))
    assert "bring the part to within 0.02 m" in robot.log[0]
    assert robot.time == 0.0


@pytest.mark.parametrize(("share", "stops"), [(0.9, False), (1.1, True)])
def test_a_free_move_that_pushes_against_something_ends_the_program(
    square_peg_plan: dict[str, Any], share: float, stops: bool
) -> None:
    first = moves(read(square_peg_plan))[0]
    assert first.stop is None
    robot = Robot(list(BASE.compose(first.start).vector()))
    functions = robot.built_in()
    most = share * ProgramSettings().most * square_peg_plan["specification"]["contact_force"]
    reaction = (np.array([1.0, -2.0, 2.0]) / 3.0 * most).tolist()
    functions["get_tcp_force"] = lambda: [*reaction, 0.0, 0.0, 0.0]
    with pytest.raises(Halt):
        Interpreter(functions).run(parsed(program(read(square_peg_plan), BASE)))
    assert not robot.forced
    assert (robot.log == ["fmopt: move 1: pushed against something"]) is stops
    assert (robot.time < first.duration) is stops


def test_pieces_of_a_move_take_together_as_long_as_they_are_to(square_peg_plan: dict[str, Any]) -> None:
    """A piece lasts whole steps of the robot's program; what that is too long by, the next piece lasts less."""
    pieces = 23

    def cut(plan: dict[str, Any]) -> None:
        first = plan["segments"][0]
        start, goal = (np.array(first[key]) for key in ("start", "goal"))
        ends = np.linspace(start, goal, pieces + 1).tolist()
        cuts = [{**first, "start": ends[k], "goal": ends[k + 1]} for k in range(pieces)]
        plan["segments"][:1] = cuts

    plan = changed(square_peg_plan, cut)
    rows = moves(read(plan))
    assert [move.number for move in rows[:pieces]] == [0] * pieces
    robot = Robot(list(BASE.compose(rows[0].start).vector()))
    functions = robot.built_in()
    begun: list[float] = []
    set_mode = functions["force_mode"]

    def force_mode(*arguments: Any) -> Any:
        begun.append(robot.time)
        return set_mode(*arguments)

    functions["force_mode"] = force_mode
    with pytest.raises(Halt):
        Interpreter(functions).run(parsed(program(read(plan), BASE)))
    lasted = begun[pieces] - begun[0]
    step = functions["get_steptime"]()
    assert sum(move.duration for move in rows[:pieces]) % step > 0.0
    assert lasted == pytest.approx(sum(move.duration for move in rows[:pieces]), abs=1.01 * step)


def test_the_springs_are_let_go_before_a_touch_is_left(square_peg_plan: dict[str, Any]) -> None:
    """Else a part that a stiff axis takes away begins beside where it is, by what presses it."""

    def leave(plan: dict[str, Any]) -> None:
        last = max(k for k, row in enumerate(plan["segments"]) if row["move"] == 1)
        plan["segments"][last + 1 :] = [{**plan["segments"][0], "move": 2}]

    text = program(read(changed(square_peg_plan, leave)), BASE)
    _, left = text.split("# move 3, ")
    modes = [line for line in left.splitlines() if line.strip().startswith("force_mode(")]
    assert "[1, 1, 1, 1, 1, 1], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]" in modes[0]
    assert "[0, 0, 0, 0, 0, 0]" in modes[1]


def test_contacts_that_are_felt_lead_to_the_end(square_peg_plan: dict[str, Any]) -> None:
    robot = Robot(list(BASE.compose(moves(read(square_peg_plan))[0].start).vector()))
    functions = robot.built_in()
    functions["get_tcp_force"] = lambda: feeling if interpreter.globals["moving"] > 0.1 else [0.0] * 6
    feeling = [0.0] * 6
    text = program(read(square_peg_plan), BASE)
    interpreter = Interpreter(functions)
    called = interpreter.call

    def guarded(node: Any, local: dict[str, Any]) -> Any:
        if node.children[0] == "fmopt_guarded":
            gain, force = (interpreter.value(argument, local) for argument in arguments(node)[2:4])
            feeling[:] = [2.0 * force * g / sum(g * g for g in gain) for g in gain]
        return called(node, local)

    interpreter.call = guarded  # type: ignore[method-assign]
    interpreter.run(parsed(text))
    assert robot.log == ["fmopt: seated"]
    assert not robot.forced


@pytest.mark.parametrize("tcp", [(0.0,) * 6, (0.02, -0.01, 0.15, 0.3, 0.1, 0.8)])
def test_the_program_seats_the_part_in_the_physics_engine(
    square_peg_plan: dict[str, Any], tcp: tuple[float, ...]
) -> None:
    error = np.random.default_rng(7).uniform(-1.0, 1.0, 6) * square_peg_plan["uncertainty"]["start_box"]
    held = changed(square_peg_plan, lambda plan: plan["description"].update(tcp=tcp))
    robot = ForceModeRobot(read(square_peg_plan), BASE, error, 0, Pose.from_vector(tcp))
    assert robot.run(program(read(held), BASE)), robot.log
    assert robot.log == ["fmopt: seated"]


def test_the_program_notices_that_there_is_no_hole_where_it_thinks(square_peg_plan: dict[str, Any]) -> None:
    robot = ForceModeRobot(read(square_peg_plan), BASE, np.array([0.004, 0.004, 0.0, 0.0, 0.0, 0.0]), 0)
    assert not robot.run(program(read(square_peg_plan), BASE))
    assert robot.log != ["fmopt: seated"]


# Tables


def test_the_csv_reads_back_exactly(square_peg_plan: dict[str, Any]) -> None:
    made = samples(read(square_peg_plan), 250.0)
    text = csv_text(read(square_peg_plan), 250.0)
    rows = [line.split(",") for line in text.splitlines() if line[0] not in "#t"]
    assert {code for row in rows for code in row[1:7]} <= {"-1", "0", "1", "2"}
    assert np.abs(np.array(rows, dtype=np.float64) - made.table).max() <= 1e-12
    rows = square_peg_plan["description"]["position_force"]
    assert (made.t[0], made.t[-1]) == (rows[0]["start"], rows[-1]["end"])
    assert np.all(np.diff(made.t) > 0.0)


def test_samples_split_position_and_force_as_s_says(square_peg_plan: dict[str, Any]) -> None:
    found = samples(read(square_peg_plan), 100.0)
    assert np.all(found.pa[found.s != 0.0] == 0.0)
    assert np.all(found.fa[found.s == 0.0] == 0.0)
    assert np.all(found.fa[found.s == 1.0] < 0.0)
    assert np.any(found.s == 2.0)


def test_intervals_that_last_no_time_are_at_their_ends(square_peg_plan: dict[str, Any]) -> None:
    whole = square_peg_plan["description"]["position_force"]
    still = {**whole[-1], "start": whole[-1]["end"], "pa_start": whole[-1]["pa_end"]}
    described = {**square_peg_plan["description"], "position_force": [*whole, still]}
    found = samples(read({**square_peg_plan, "description": described}), 100.0)
    np.testing.assert_array_equal(found.table, samples(read(square_peg_plan), 100.0).table)


def test_the_json_holds_the_same_samples(square_peg_plan: dict[str, Any]) -> None:
    text = json.loads(json_text(read(square_peg_plan), 50.0))
    found = samples(read(square_peg_plan), 50.0)
    assert [row["t"] for row in text["samples"]] == found.t.tolist()
    assert [row["fa"] for row in text["samples"]] == found.fa.tolist()
    assert text["fa_sign"] == "reaction"


@pytest.mark.parametrize("rate", [0.0, -1.0, np.inf, np.nan])
def test_rates_that_are_none_are_refused(square_peg_plan: dict[str, Any], rate: float) -> None:
    with pytest.raises(PlanFormatError, match="positive --rate"):
        samples(read(square_peg_plan), rate)


def test_more_samples_than_a_file_should_hold_are_refused(square_peg_plan: dict[str, Any]) -> None:
    with pytest.raises(PlanFormatError, match=r"more than 1e\+06") as caught:
        samples(read(square_peg_plan), 1e15)
    assert "give a --rate of at most" in caught.value.advice


def test_a_plan_is_not_written_over(square_peg_plan_file: Path, tmp_path: Path) -> None:
    own = tmp_path / "plan.json"
    own.write_bytes(square_peg_plan_file.read_bytes())
    for out in (own, tmp_path / "." / "plan.json"):
        done = CliRunner().invoke(app, ["export", str(own), "--to", "csv", "--out", str(out)])
        assert done.exit_code == 2
        assert "the plan itself" in done.stderr
    assert own.read_bytes() == square_peg_plan_file.read_bytes()


def test_a_table_says_that_it_needs_no_base(square_peg_plan_file: Path, tmp_path: Path) -> None:
    line = ["export", str(square_peg_plan_file), "--to", "csv", "--out", str(tmp_path / "a.csv"), "--base"]
    done = CliRunner().invoke(app, [*line, *"100000"])
    assert done.exit_code == 0
    assert "--base is not used" in done.stderr


# ROS 2


def test_the_yaml_has_the_keys_of_controller_and_request(square_peg_plan: dict[str, Any], tmp_path: Path) -> None:
    controllers, segments = ros2.export(read(square_peg_plan), BASE, tmp_path)
    parameters = yaml.safe_load(controllers.read_text())[ros2.CONTROLLER]["ros__parameters"]
    assert set(parameters) == {
        *("end_effector_link", "robot_base_link", "ft_sensor_ref_link", "compliance_ref_link", "joints"),
        *("command_interfaces", "hand_frame_control", "stiffness", "solver", "pd_gains"),
    }
    assert list(parameters["stiffness"]) == ["trans_x", "trans_y", "trans_z", "rot_x", "rot_y", "rot_z"]
    listed = yaml.safe_load(segments.read_text())["segments"]
    for entry, move in zip(listed, moves(read(square_peg_plan)), strict=True):
        request = entry["set_force_mode"]
        for key, pose in (("start", move.start), ("goal", move.goal)):
            position, q = (np.array([*entry[key][name].values()]) for name in ("position", "orientation"))
            wanted = BASE.compose(pose)
            np.testing.assert_allclose(position, wanted.p, atol=1e-15)
            np.testing.assert_allclose(exp(2.0 * np.arccos(q[3]) * q[:3] / np.linalg.norm(q[:3])), wanted.R, atol=1e-7)
        # Each segment begins with the wrench that holds there: arms are others than at its end.
        for key, hold in (("wrench_start", move.hold_start), ("wrench_goal", move.hold)):
            force, torque = ([*entry[key][name].values()] for name in ("force", "torque"))
            np.testing.assert_allclose(np.r_[BASE.R.T @ force, BASE.R.T @ torque], hold, atol=1e-12)
        selected = [request.pop(f"selection_vector_{axis}") for axis in ("x", "y", "z", "rx", "ry", "rz")]
        assert set(request) == {
            *("task_frame", "wrench", "type", "speed_limits", "deviation_limits", "damping_factor", "gain_scaling")
        }
        assert sum(selected) == len(move.force_axes)
        assert [value == 0.0 for value in entry["stiffness"].values()] == selected
        assert all(isinstance(value, float) for value in request["deviation_limits"])
        assert request["type"] == 2


# The command


@pytest.mark.parametrize("to", ["urscript", "ros2", "csv", "json"])
def test_the_command_writes_each_format(square_peg_plan_file: Path, tmp_path: Path, to: str) -> None:
    base = ["--base", "0.4", "-0.1", "0.2", "0", "3.1", "0"]
    ran = CliRunner().invoke(app, ["export", str(square_peg_plan_file), "--to", to, "--out", str(tmp_path / to), *base])
    assert ran.exit_code == 0, ran.output
    assert all(Path(line).exists() for line in ran.stdout.splitlines())


@pytest.mark.parametrize("to", ["csv", "json", "urscript"])
def test_a_dash_is_standard_output(square_peg_plan_file: Path, tmp_path: Path, to: str) -> None:
    line = ["export", str(square_peg_plan_file), "--to", to, "--base", "0.4", "-0.1", "0.2", "0", "0", "0", "--out"]
    assert CliRunner().invoke(app, [*line, str(tmp_path / "file")]).exit_code == 0
    said = CliRunner().invoke(app, [*line, "-"])
    assert said.stdout_bytes == Path("file").read_bytes()
    assert ("is not used" in said.stderr) == (to != "urscript")
    assert CliRunner().invoke(app, [*line, "-", "--quiet"]).stderr == ""
    assert CliRunner().invoke(app, [*line, "-", "--json"]).exit_code == 2
    assert not Path("-").exists()


def test_a_folder_does_not_go_to_standard_output(square_peg_plan_file: Path) -> None:
    line = ["export", str(square_peg_plan_file), "--to", "ros2", "--base", "0.4", "-0.1", "0.2", "0", "0", "0"]
    done = CliRunner().invoke(app, [*line, "--out", "-"])
    assert (done.exit_code, "--out has to be a folder" in done.output) == (2, True)


@pytest.mark.parametrize(("to", "why"), [("urscript", "base"), ("ros2", "base"), ("krl", "'krl' is no format")])
def test_the_command_says_what_is_missing(square_peg_plan_file: Path, to: str, why: str) -> None:
    done = CliRunner().invoke(app, ["export", str(square_peg_plan_file), "--to", to])
    assert done.exit_code == 2
    assert why in done.output


def test_the_command_says_which_way_is_in(square_peg_plan_file: Path, tmp_path: Path) -> None:
    for turn, way in (("0", "down"), ("3.14159", "up"), ("1.5708", "sideways")):
        out = tmp_path / f"{way}.script"
        line = ["export", str(square_peg_plan_file), "--to", "urscript", "--out", str(out), "--base", "0.4", "-0.1"]
        done = CliRunner().invoke(app, [*line, "0.2", "0", turn, "0"])
        assert f"insertion goes {way} in the base frame" in done.stderr
        assert f"insertion goes {way} in the base frame" in out.read_text()
        quiet = CliRunner().invoke(app, [*line, "0.2", "0", turn, "0", "--quiet"])
        assert quiet.output == ""


def test_the_command_says_how_fast_the_part_turns(square_peg_plan_file: Path, tmp_path: Path) -> None:
    rows = plan.read_document(square_peg_plan_file)["segments"]
    fastest = max(row["hybrid"]["speed"] * np.linalg.norm(row["hybrid"]["velocity"][3:]) for row in rows)
    line = ["export", str(square_peg_plan_file), "--base", "0.4", "-0.1", "0.2", "0", "0", "0"]
    for to, file in (("urscript", tmp_path / "urscript"), ("ros2", tmp_path / "ros2" / "segments.yaml")):
        done = CliRunner().invoke(app, [*line, "--to", to, "--out", str(tmp_path / to)])
        said = float(done.stderr.partition("turns with up to ")[2].partition(" rad/s")[0])
        assert f"turns with up to {said:.3g} rad/s" in file.read_text()
        # A program for guarded moves runs them slower than the plan, and says how fast it runs them.
        twists = re.findall(r"fmopt_(?:guarded|move)\(\[([^\]]+)\]", file.read_text())
        rates = [np.linalg.norm([float(number) for number in twist.split(",")[3:]]) for twist in twists] or [fastest]
        assert said == pytest.approx(max(rates), rel=5e-3)
        assert "nothing is guaranteed" not in done.stderr


def test_only_certified_plans_are_exported_unless_one_says_so(square_peg_plan: dict[str, Any], tmp_path: Path) -> None:
    file = tmp_path / "plan.json"
    plan.write(plan.sealed({**square_peg_plan, "verdict": "NOT_PROVED"}), file)
    line = ["export", str(file), "--base", "0.4", "-0.1", "0.2", "0", "0", "0"]
    for to, written in ((to, tmp_path / to) for to in ("urscript", "ros2/segments.yaml", "csv", "json")):
        form = [*line, "--to", to.partition("/")[0], "--out", str(tmp_path / to.partition("/")[0])]
        with pytest.raises(UnprovedError, match="not certified") as caught:
            CliRunner().invoke(app, form, catch_exceptions=False)
        assert caught.value.exit_code == 3
        assert any("NOT_PROVED" in finding for finding in caught.value.findings)
        assert not written.exists()
        done = CliRunner().invoke(app, [*form, "--unverified", "--quiet"])
        assert done.exit_code == 0
        assert all("nothing is guaranteed" in text for text in (done.stderr, written.read_text()))


def test_a_plan_that_is_no_longer_as_it_was_sealed_is_not_exported(
    square_peg_plan: dict[str, Any], tmp_path: Path
) -> None:
    file = tmp_path / "plan.json"
    plan.write({**square_peg_plan, "sha256": "0" * 64}, file)
    for words in (["export", str(file), "--to", "csv"], ["execute", str(file)], ["compare", str(file)]):
        with pytest.raises(UnprovedError) as caught:
            CliRunner().invoke(app, words, catch_exceptions=False)
        assert any("sealed" in finding for finding in caught.value.findings)
    assert [path.name for path in tmp_path.iterdir()] == ["plan.json"]


def test_the_way_in_is_the_way_of_the_nominal_path(square_peg_plan: dict[str, Any]) -> None:
    nodes = square_peg_plan["description"]["nominal"]["nodes"]
    start, goal = (BASE.compose(Pose.from_vector(nodes[k])).p for k in (0, -1))
    said = json.loads(insertion_words(BASE).partition("along ")[2])
    assert said == pytest.approx((goal - start) / np.linalg.norm(goal - start), abs=1e-3)


@pytest.mark.parametrize(
    ("base", "why"),
    [
        ("400 -100 200 0 0 0", "458.258 m away: give metres, not millimetres"),
        ("0.4 -0.1 0.2 0 180 0", "180 rad long: give an axis times its angle in rad, not degrees"),
        ("nan 0 0 0 0 0", "nan m away"),
        ("0 0 0 nan 0 0", "nan rad long"),
    ],
)
def test_bases_in_other_units_are_refused(square_peg_plan_file: Path, tmp_path: Path, base: str, why: str) -> None:
    for to in ("urscript", "ros2"):
        line = ["export", str(square_peg_plan_file), "--to", to, "--out", str(tmp_path / to), "--base", *base.split()]
        done = CliRunner().invoke(app, line)
        assert done.exit_code == 2
        assert why in " ".join(done.output.replace("│", " ").split())
        assert not (tmp_path / to).exists()
    assert base_pose((*(0.0, 6.0, 8.0), *(0.0, 0.0, 6.283))).p.tolist() == [0.0, 6.0, 8.0]
