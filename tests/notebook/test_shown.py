"""Values that show themselves: drawings that hold everything, tables in notebooks, studies and trials from Python."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import fmopt
from tests.shared.plans.report_plans import cube_plan

PEG = fmopt.example("square_peg")


@pytest.fixture(scope="module")
def problem() -> fmopt.Problem:
    return fmopt.load(PEG)


@pytest.mark.wide
def test_trials_are_those_of_the_command_line(square_peg_plan_file: Path, tmp_path: Path) -> None:
    from fmopt.execution.execute import TrialSettings, execute
    from fmopt.execution.trials import Trials
    from fmopt.plan import read

    plan = fmopt.read(square_peg_plan_file)
    mine = plan.execute(trials=1, seed=3, folder=tmp_path / "mine", workers=1)
    theirs = execute(read(square_peg_plan_file), Trials(1, seed=3), TrialSettings(tmp_path / "theirs", 1))
    assert mine.summary == theirs
    whole = plan.execute(fmopt.Trials(1, seed=3), seed=8, folder=tmp_path / "whole", workers=1)
    assert whole.summary == theirs
    for slip in (fmopt.Trials(1, engine="bullet"), fmopt.Trials(1, method="pull")):
        with pytest.raises(ValueError, match=r"'(bullet|pull)' is none of "):
            plan.execute(slip, folder=tmp_path / "none")
    assert [record["trial"] for record in mine.records] == [0]
    assert str(mine).startswith("inside the certified set: ")
    assert "<pre>" in mine._repr_html_()
    assert repr(mine).endswith("1 done>")


def test_each_drawing_is_written_in_each_format_that_it_has(problem: fmopt.Problem, tmp_path: Path) -> None:
    for value, names in ((fmopt.Plan(cube_plan()), ("scene", "margin")), (problem.fixed, ("part", "scene"))):
        for name in names:
            drawing = fmopt.show(value, name)
            page = drawing.save(tmp_path / f"{name}.html").read_text(encoding="utf-8")
            assert "http" not in page.replace("http-equiv", "")
            assert drawing.alt
            if drawing.paint is not None:
                assert drawing.svg() == drawing.svg()
                assert drawing.save(tmp_path / "x.png").read_bytes().startswith(b"\x89PNG")
            else:
                with pytest.raises(fmopt.ChoiceError, match=r"ends with \.html"):
                    drawing.save(tmp_path / "x.svg")
    with pytest.raises(fmopt.ChoiceError, match=r"'\.pdf' is no format"):
        fmopt.show(problem.fixed).save(tmp_path / "x.pdf")


def test_what_has_no_drawing_says_so(problem: fmopt.Problem) -> None:
    with pytest.raises(fmopt.ResourceError, match="a float has no drawing"):
        fmopt.show(1.0)
    with pytest.raises(fmopt.ChoiceError, match="choose from parts, scene, diagrams"):
        fmopt.show(problem, "tube")
    with pytest.raises(fmopt.PlanFormatError, match="lacks the key 'verdict'"):
        fmopt.Plan({"format": "fmopt.plan/2"})


STUDY = """title = "clearances"
problem = "{problem}"
compute = ["clearance"]

[units]
length = "mm"
angle = "deg"
time = "s"

[[axes]]
name = "width"
values = [20.1, 20.2, 20.3]
sets = ["model.fixed.width"]
"""


def test_a_study_from_python(tmp_path: Path) -> None:
    file = tmp_path / "clearances.toml"
    file.write_text(STUDY.format(problem=PEG), encoding="utf-8")
    found = fmopt.study(file, tmp_path / "out", jobs=1)
    assert [line["clearance"] for line in found.lines] == pytest.approx([5e-5, 1e-4, 1.5e-4], abs=1e-9)
    assert len(found.frame()) == 3
    assert "3 of 3 runs done" in repr(found)
    assert found._repr_html_().count("<img") == len(found.figures) == 1
    assert (tmp_path / "out" / "report.html") in found.report()


INSIDE = """
from IPython.core.interactiveshell import InteractiveShell
shell = InteractiveShell.instance()
import fmopt, sys
assert "matplotlib" not in sys.modules and "sympy" not in sys.modules
problem = fmopt.load(fmopt.example("square_peg"))
nominal = fmopt.stages.nominal(problem)
from fmopt.contact.primitive import Kind
from fmopt.contact.c_surface import symbolic_surface
plan = fmopt.read({plan!r})
for value in (problem, plan, plan.segments[3], plan.verify(), plan.segments[3].start, nominal, problem.moving,
              fmopt.stages.start_errors(problem), nominal.planes.planes[0].fixed):
    data, _ = shell.display_formatter.format(value)
    assert data["text/html"].startswith(("<div", "<img", "<iframe")), (type(value), data["text/html"][:80])
data, _ = shell.display_formatter.format(symbolic_surface(Kind.VERTEX_FACE))
assert data["text/latex"].startswith("$\\\\displaystyle f ="), data
"""


@pytest.mark.wide
def test_values_show_themselves_in_a_notebook(square_peg_plan_file: Path, tmp_path: Path) -> None:
    shutil.copy(square_peg_plan_file, tmp_path / "plan.json")
    code = INSIDE.format(plan=str(tmp_path / "plan.json"))
    done = subprocess.run(
        [sys.executable, "-W", "error::UserWarning:fmopt", "-c", code],
        capture_output=True, text=True, timeout=120, cwd=tmp_path, env=None, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


def test_the_tables_of_views_name_types_that_exist() -> None:
    from importlib import import_module

    from fmopt.notebook.display import HTML
    from fmopt.notebook.views import VIEWS

    for name in (*VIEWS, *HTML):
        module, _, kind = name.rpartition(".")
        found = getattr(import_module(module), kind)
        assert f"{found.__module__}.{found.__qualname__}" == name
