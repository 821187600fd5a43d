"""The Python face: problems that vary, plans that say what they are, stages one by one, shipped examples."""

import math
import pickle
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fmopt
from fmopt.plan import sealed
from tests.shared.plans.report_plans import cube_plan

PEG = fmopt.example("square_peg")


@pytest.fixture(scope="module")
def problem() -> fmopt.Problem:
    return fmopt.load(PEG)


@pytest.mark.parametrize("wanted", ["0.05 mm", 0.2, "0.004 in"])
def test_a_clearance_that_is_asked_for_is_the_measured_one(problem: fmopt.Problem, wanted: float | str) -> None:
    other = problem.with_(clearance=wanted)
    side = {"0.05 mm": 5e-5, 0.2: 2e-4, "0.004 in": 1.016e-4}[wanted]
    assert other.measured.per_side == pytest.approx(side, abs=1e-8)
    assert other.declared_clearance == pytest.approx((side, side), rel=1e-12)
    assert other.moving.polyhedron.vertices.tolist() == problem.moving.polyhedron.vertices.tolist()
    assert problem.measured.per_side == pytest.approx(1e-4, rel=1e-9)


def test_a_hole_of_two_widths_gets_both(problem: fmopt.Problem) -> None:
    other = fmopt.load(fmopt.example("factory_rect_8mm_tight")).with_(clearance="0.03 mm")
    assert np.array(other.measured.play) / 2 == pytest.approx([3e-5, 3e-5], abs=1e-8)


def test_values_are_set_by_path_or_by_name_and_add_up(problem: fmopt.Problem) -> None:
    one = problem.with_({"uncertainty.start.x": "0.2 mm"}, settings_max_tilt="10 deg")
    two = one.with_(specification_friction=0.25)
    assert (two.start_box[0], two.settings.max_tilt) == (2e-4, pytest.approx(math.radians(10.0)))
    assert two.specification.friction == 0.25
    assert two.sha256 not in (one.sha256, problem.sha256)
    assert {"uncertainty.start.x", "settings.max_tilt", "model.fixed.width"} <= set(problem.targets)


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "unknown": ({"uncertianty_start_x": 1}, "uncertianty_start_x: nothing of this problem has this path; did you mean"),
    "unit": ({"uncertainty_start_x": "1 deg"}, "uncertainty.start.x"),
    "range": ({"settings_max_tilt": "400 deg"}, "settings.max_tilt"),
    "negative": ({"clearance": "-0.1 mm"}, "clearance"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_values_that_a_file_could_not_have_are_refused(problem: fmopt.Problem, name: str) -> None:
    values, words = REFUSED[name]
    with pytest.raises(fmopt.InputError, match=words):
        problem.with_(values)


def test_a_hole_without_dimensions_keeps_its_clearance(tmp_path: Path) -> None:
    fmopt.copy_examples(tmp_path)
    model = tmp_path / "models" / "square_hole_block.toml"
    text = model.read_text(encoding="utf-8").replace("width = 20.2\n", "").replace('"width"', "20.2")
    model.write_text(text, encoding="utf-8")
    fixed = fmopt.load(tmp_path / "problems" / "square_peg.toml")
    with pytest.raises(fmopt.InputError, match=r"no dimensions of 'square_hole_block' give 0\.05 mm on each side"):
        fixed.with_(clearance="0.05 mm")


def test_problems_survive_pickling(problem: fmopt.Problem) -> None:
    again = pickle.loads(pickle.dumps(problem))
    assert again.with_(specification_friction=0.2).title == problem.title
    assert not again.start_box.flags.writeable


def test_plans_say_what_they_are() -> None:
    plan = fmopt.Plan(cube_plan())
    assert (plan.verdict, plan.proved, plan.margin) == ("CERTIFIED", True, 4.2e-5)
    assert str(plan) == "cube to a wall: CERTIFIED, 2 moves, least margin 42.0 µm"
    assert [segment.move for segment in plan.segments] == [1, 2, 2]
    assert (plan.segments[-1].goal_state, plan.segments[0].start.p[2]) == (("v0-f5",), 0.003)


@pytest.mark.parametrize("verdict", ["NOT_PROVED", "REFUTED"])
def test_nothing_unproved_looks_certified(verdict: str) -> None:
    plan = fmopt.Plan(cube_plan(verdict))
    assert not plan.proved
    assert "least margin" not in str(plan)
    assert "Certified" not in plan._repr_html_()
    changed = fmopt.Plan({**cube_plan(), "goal": [0.0] * 6})
    assert "Certified" not in changed._repr_html_()


def test_the_sheet_of_a_segment_says_its_strategy_as_the_report_does() -> None:
    down, near, touch = fmopt.Plan(cube_plan()).segments
    assert "ends after 2\u00a0mm; a fault beyond 1.3\u00a0mm or 3\u00a0s" in down._repr_html_()
    assert "goes on after 500\u00a0µm; a contact felt before ends the move" in near._repr_html_()
    sheet = touch._repr_html_()
    assert "ends when reaction along x reaches 2\u00a0N, nominally after 600\u00a0µm; a fault beyond 1.3" in sheet
    assert "−x at 20\u00a0mm/s" in sheet


def test_a_plan_is_checked_and_held_against_its_problem(square_peg_plan_file: Path, problem: fmopt.Problem) -> None:
    plan = fmopt.read(square_peg_plan_file)
    assert plan.verify(problem).verdict == "CERTIFIED"
    other = plan.verify(problem.with_(specification_friction=0.25))
    assert other.verdict == "NOT_PROVED"
    assert any("belongs to another problem" in str(finding) for finding in other.findings)
    worse = fmopt.Plan(sealed({**plan.document, "goal": [0.0] * 6}))
    assert worse.verify().verdict == "NOT_PROVED"
    with pytest.raises(fmopt.PlanFormatError, match="lacks the key"):
        fmopt.Plan(sealed({"format": "fmopt.plan/2"})).verify()


def test_a_plan_goes_through_a_file(tmp_path: Path) -> None:
    plan = fmopt.Plan(cube_plan())
    assert fmopt.read(plan.save(tmp_path / "a" / "plan.json")).document == plan.document
    assert plan.report(tmp_path / "report.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_segments_as_a_data_frame(square_peg_plan_file: Path) -> None:
    plan = fmopt.read(square_peg_plan_file)
    frame = plan.to_dataframe()
    assert (len(frame), frame["margin"].min()) == (len(plan.segments), plan.margin)
    assert frame["goal_z"][-1] == pytest.approx(-0.03, abs=1e-9)
    assert frame["timeout"].null_count() == 0


def test_exports_are_those_of_the_command_line(square_peg_plan_file: Path, tmp_path: Path) -> None:
    from fmopt.plan.export.write import Form, export

    plan, base = fmopt.read(square_peg_plan_file), (0.4, -0.1, 0.2, 0.0, 3.0, 0.0)
    for to in ("csv", "json", "urscript"):
        (mine,) = plan.export(to, tmp_path / f"mine.{to}", base=base)
        (theirs,) = export(plan.stated, Form(to, base, 100.0), tmp_path / f"theirs.{to}").paths
        assert mine.read_bytes() == theirs.read_bytes()
    with pytest.raises(ValueError, match="'gcode' is no format"):
        plan.export("gcode", tmp_path / "x")


def test_the_stages_one_by_one_see_what_solve_sees(problem: fmopt.Problem, square_peg_plan: dict[str, Any]) -> None:
    nominal = fmopt.stages.nominal(problem)
    described = square_peg_plan["description"]["nominal"]
    assert nominal.path.nodes.tolist() == described["nodes"]
    assert [list(i.s) for i in nominal.freedoms] == [i["s"] for i in described["intervals"]]
    errors = fmopt.stages.start_errors(problem)
    assert errors.support(np.eye(6)) == pytest.approx(problem.start_box, rel=1e-12)
    drawn = fmopt.show(errors)
    assert "x ±0.3 mm" in drawn.alt
    graph = fmopt.show(fmopt.stages.contact_graph(problem, nominal.critical[1].pose))
    assert graph.title == "243 contact states by dimension"


def test_shipped_problems_are_copied_and_never_overwritten(tmp_path: Path) -> None:
    written = fmopt.copy_examples(tmp_path)
    assert {path.stem for path in written} >= {*fmopt.examples(), "square_hole_block", "problem.schema"}
    for name in fmopt.examples():
        copy = tmp_path / "problems" / f"{name}.toml"
        assert copy.read_bytes() == fmopt.example(name).read_bytes()
        data = tomllib.loads(copy.read_text(encoding="utf-8"))
        assert all((copy.parent / data[side]["model"]).is_file() for side in ("moving", "fixed"))
    for name in ("square_peg", "mit_planar_slot"):
        assert fmopt.load(tmp_path / "problems" / f"{name}.toml").sha256 == fmopt.load(fmopt.example(name)).sha256
    with pytest.raises(fmopt.ResourceError, match="is there already"):
        fmopt.copy_examples(tmp_path)
    with pytest.raises(fmopt.ChoiceError, match="choose from"):
        fmopt.example("round_peg")
