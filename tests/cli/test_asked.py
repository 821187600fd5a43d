"""Problems of two parts and a start error: in four lines, on the command line, from Python, in all forms of files."""

import json
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fmopt
from fmopt.errors import GeometryError, InputError, InterferenceError
from fmopt.notebook.gallery import gallery
from fmopt.runtime.store import FOLDER
from tests.shared.commands import Outcome
from tests.shared.files.asked import FORMS, Asked, generated, rectangle, write, write_assembly

ERROR = "0.02 mm, 0.02 deg"  # small beside every clearance, so that the way is straight and soon found
Run = Callable[..., Outcome]


@pytest.fixture(autouse=True, scope="module")
def read_once(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Each file is read once by all tests of this module."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FOLDER, str(tmp_path_factory.mktemp("store")))
        yield


def four_lines(paths: tuple[Path, Path], error: str = ERROR) -> Path:
    """The smallest problem file for two parts beside it."""
    file = paths[0].parent / "problem.toml"
    file.write_text(
        f'moving = "{paths[0].name}"\nfixed = "{paths[1].name}"\n[uncertainty]\nstart = "{error}"\n', encoding="utf-8"
    )
    return file


def figures(problem: fmopt.Problem) -> dict[str, Any]:
    """What is found of a problem, in numbers."""
    return {
        "clearance": problem.measured.per_side,
        "play": problem.measured.play,
        "depth": -float(problem.goal[2]),
        "height": problem.approach,
        "box": problem.start_box.tolist(),
        "lengths": (problem.peg.length, problem.hole.length),
        "rho": problem.measured.half_diagonal,
    }


def same(one: dict[str, Any], other: dict[str, Any]) -> None:
    for name, value in one.items():
        assert value == pytest.approx(other[name], rel=1e-6, abs=1e-9), name


@pytest.mark.parametrize("pair", generated(seed=1) + generated(seed=2), ids=lambda pair: pair.name)
def test_every_form_of_file_asks_the_same_in_four_lines(pair: Asked, tmp_path: Path) -> None:
    found = {}
    for form in FORMS:
        problem = fmopt.load(four_lines(write(pair, tmp_path / form, form)))
        found[form] = figures(problem)
        assert problem.declared_clearance is None
        assert (problem.peg.kind, problem.hole.kind) == ("solid", "hollow")
    assert found["toml"]["clearance"] == pytest.approx(1e-3 * pair.clearance, abs=1e-9)
    assert found["toml"]["depth"] == pytest.approx(0.012)
    for form in FORMS[1:]:
        same(found["toml"], found[form])


@pytest.mark.wide
def test_one_verdict_from_files_the_command_line_and_python(tmp_path: Path, command: Run) -> None:
    pair = generated(seed=3)[0]
    margins = []
    for form in FORMS[:2]:
        plan = fmopt.solve(fmopt.load(four_lines(write(pair, tmp_path / form, form))))
        assert plan.verdict == "CERTIFIED"
        margins.append(min(segment.margin for segment in plan.segments))
    peg, plate = write(pair, tmp_path / "step", "step")
    code, out, err = command("solve", peg, plate, "--error", ERROR, "--out", tmp_path / "out", "--json")
    told = json.loads(out)
    assert (code, told["verdict"]) == (0, "CERTIFIED"), err
    margins.append(told["margin"])
    assert command("verify", tmp_path / "out/plan.json", "--problem", tmp_path / "out/problem.toml")[0] == 0
    loops, heights = pair.loops(), pair.heights
    problem = fmopt.problem((loops[0], heights[0]), (loops[1], heights[1]), tuple(ERROR.split(", ")), unit="mm")
    plan = fmopt.solve(problem)
    assert plan.verify(problem).verdict == "CERTIFIED"
    margins.append(min(segment.margin for segment in plan.segments))
    assert margins == pytest.approx([margins[0]] * len(margins), rel=1e-4)


def test_what_is_stated_holds_and_what_disagrees_is_an_error_with_both_values(tmp_path: Path) -> None:
    pair = generated(seed=1)[1]
    file = four_lines(write(pair, tmp_path, "toml"))
    base = file.read_text(encoding="utf-8")
    depth = fmopt.load(file).goal[2]

    def stated(more: str) -> fmopt.Problem:
        file.write_text(f"{base}{more}\n", encoding="utf-8")
        return fmopt.load(file)

    assert stated('[goal]\ndepth = "5 mm"').goal[2] == -0.005
    assert stated('[goal]\ndepth = "full"').goal[2] == depth
    assert stated('[start]\nheight = "3 mm"').approach == 0.003
    with pytest.raises(InputError, match=r"13 mm is deeper than hole and peg allow, 12 mm"):
        stated('[goal]\ndepth = "13 mm"')
    with pytest.raises(InterferenceError, match="does not go into"):
        _ = stated('[goal]\nturn = "90 deg"').measured
    wrong = stated(f'[clearance]\nx = "{20 * pair.clearance} mm"')
    measured, declared = f"{pair.clearance:.6g} mm a side", f"declares {20 * pair.clearance:.6g} mm"
    with pytest.raises(GeometryError, match=rf"{measured}.*{declared}"):
        _ = wrong.measured
    assert stated(f'[clearance]\nx = "{pair.clearance} mm"').measured.per_side == pytest.approx(1e-3 * pair.clearance)
    file.write_text(base.replace('fixed = "plate.toml"', 'fixed = { model = "plate.toml", feature = "hole_3" }'))
    with pytest.raises(InputError, match="has no feature 'hole_3'; leave 'feature' out"):
        fmopt.load(file)


def test_the_pair_that_fits_is_found_among_several_holes(tmp_path: Path) -> None:
    plate = [rectangle(80.0, 40.0)]
    for x, size in ((-25.0, 9.0), (0.0, 10.2), (25.0, 14.0)):
        plate.append(tuple((a + x, b) for a, b in rectangle(size, size)))
    problem = fmopt.problem(([rectangle(10.0, 10.0)], 30.0), (plate, 12.0), ERROR, unit="mm")
    assert problem.measured.per_side == pytest.approx(1e-4, abs=1e-9)
    twins = [plate[0], plate[2], tuple((a + 25.0, b) for a, b in rectangle(10.2, 10.2))]
    alike = fmopt.problem(([rectangle(10.0, 10.0)], 30.0), (twins, 12.0), ERROR, unit="mm")
    assert any(note.endswith("has 2 openings that fit alike, of which one was taken") for note in alike.fixed.notes)
    assert alike.measured.per_side == pytest.approx(1e-4, abs=1e-9)


@pytest.mark.parametrize("text", ["", "1 deg", "1, 1", "1 mm 1 deg", "-1 mm, 1 deg", "1 mm, 90 deg"])
def test_a_start_error_that_is_none_is_refused_with_an_example(text: str, tmp_path: Path, command: Run) -> None:
    peg, plate = write(generated(seed=1)[0], tmp_path, "stl")
    code, _, err = command("solve", peg, plate, "--error", text, "--out", tmp_path / "out")
    assert code == 2
    assert '"1 mm, 1 deg"' in err or "at most" in err or "negative" in err


@pytest.mark.parametrize("text", ["1 mm, 1 deg", "±1 mm, ±1 deg", "1 deg; 1 mm", "0.001 m and 1 deg", "+-1 mm,+-1deg"])
def test_start_errors_may_be_written_as_one_writes_them(text: str, tmp_path: Path) -> None:
    peg, plate = write(generated(seed=1)[0], tmp_path, "toml")
    box = fmopt.problem(peg, plate, text).start_box
    np.testing.assert_allclose(box, [1e-3] * 3 + [math.radians(1.0)] * 3, rtol=1e-12)


def test_wrong_calls_are_answered_by_what_is_wrong(tmp_path: Path, command: Run) -> None:
    peg, plate = write(generated(seed=1)[0], tmp_path, "stl")
    problem = four_lines((peg, plate))
    calls = [
        ((peg, "--error", ERROR), "one-part: this is one part, and an insertion takes two"),
        ((peg, peg, "--error", ERROR), "same-part: this part is named twice"),
        ((peg, plate), "missing-error: how far off the part may start is not stated"),
        ((peg, plate, peg, "--error", ERROR), "too-many: 3 files are named"),
        ((peg, problem, "--error", ERROR), "file-kind: this is no part but a problem or an assembly file"),
        ((problem, "--error", ERROR), "conflict: --error is for parts without a problem file"),
        ((peg, tmp_path / "none.stl", "--error", ERROR), "file-missing"),
        ((peg, plate, "--error", ERROR, "--unit", "furlong"), "'furlong' is no unit of a mesh; write one of m, cm, mm"),
        ((peg, plate, "--error", ERROR, "--unit", "m"), "implausible-size"),
        ((peg, plate, "--error", ERROR, "--moving", "a"), "it has no body 'a'"),
    ]
    for words, said in calls:
        code, out, err = command("solve", *words, "--out", tmp_path / "out")
        assert (code, out) == (2, ""), err
        assert said in err
        assert ";" in err or "advice" in err


@pytest.mark.wide
@pytest.mark.parametrize(
    ("gap", "said"),
    [(0.0, "there is no clearance, which is 0.000000 mm a side"), (-0.05, "it is too thick by 0.050000 mm a side")],
)
def test_a_fit_without_clearance_is_refused_as_such(gap: float, said: str, tmp_path: Path, command: Run) -> None:
    size = 10.0 + 2.0 * gap
    for form in FORMS:
        pair = Asked("none", rectangle(10.0, 10.0), rectangle(size, size), gap, shift=(3.7, -1.3))
        peg, plate = write(pair, tmp_path / form, form)
        code, _, err = command("solve", peg, plate, "--error", ERROR, "--out", tmp_path / "out")
        assert code == 1
        assert said in err
        assert "mm of the hole" in err
        code, _, err = command("check", tmp_path / "out" / "problem.toml")
        assert code == 1
        assert said in err


def test_meshes_without_a_unit_are_taken_for_mm_and_that_is_said(tmp_path: Path, command: Run) -> None:
    peg, plate = write(generated(seed=1)[0], tmp_path, "stl")
    code, out, _ = command("check", four_lines((peg, plate)))
    assert code == 0
    assert out.count("has no unit; its numbers are taken for mm, so that the part is") == 2
    _, out, _ = command("check", peg, "--unit", "cm", "--json")
    assert json.loads(out)["parts"][0]["extent"][2] == pytest.approx(0.3)


@pytest.mark.wide
@pytest.mark.parametrize("form", FORMS)
def test_init_writes_a_problem_that_passes_and_says_what_was_found(form: str, tmp_path: Path, command: Run) -> None:
    pair = generated(seed=2)[3]
    peg, plate = write(pair, tmp_path / "parts", form)
    code, out, err = command("init", peg, plate, "--error", ERROR, "--out", tmp_path / "mine.toml", "--json")
    assert code == 0, err
    assert json.loads(out) == {"written": [str(tmp_path / "mine.toml"), str(tmp_path / "mine.svg")]}
    assert (tmp_path / "mine.svg").read_text().startswith("<?xml")
    text = (tmp_path / "mine.toml").read_text()
    assert f'# x = "{pair.clearance:.9g} mm"' in text
    assert "AN EXAMPLE" not in text
    before = figures(fmopt.load(tmp_path / "mine.toml"))
    same(before, figures(fmopt.load(four_lines((peg, plate)))))
    assert command("check", tmp_path / "mine.toml", "--quiet") == (0, "", "")
    keys = text[: text.index("# What fmopt check says")].split("\n", 1)[1]
    stated = "\n".join(
        line.removeprefix("# ") if " = " in line or "[" in line[:4] else line for line in keys.split("\n")
    )
    (tmp_path / "stated.toml").write_text(stated)
    same(before, figures(fmopt.load(tmp_path / "stated.toml")))
    code, _, err = command("init", peg, plate, "--out", tmp_path / "mine.toml")
    assert code == 2
    assert "is there already" in err


@pytest.mark.wide
@pytest.mark.parametrize("form", FORMS)
def test_one_part_is_checked_and_drawn(form: str, tmp_path: Path, command: Run) -> None:
    _, plate = write(generated(seed=1)[1], tmp_path, form)
    code, out, err = command("check", plate, "--out", tmp_path / "plate.png")
    assert code == 0, err
    assert "40 x 36 x 12 mm" in out or "36 x 40 x 12 mm" in out
    assert "none stated: what goes where is found with the other part of a problem" in out
    assert (tmp_path / "plate.png").read_bytes().startswith(b"\x89PNG")
    _, out, _ = command("check", plate, "--json")
    (told,) = json.loads(out)["parts"]
    assert told["features"] == []
    code, out, _ = command("show", plate, "--list")
    assert code == 0
    assert "part" in out


def test_two_step_files_become_a_plan_a_report_and_a_program_in_three_commands(tmp_path: Path, command: Run) -> None:
    write(generated(seed=2)[1], tmp_path, "step")
    begun = time.process_time()
    asked = ("--error", "0.3 mm, 0.3 deg", "--evidence", "certified")
    code, _, err = command("solve", "peg.step", "plate.step", *asked, "--out", "made", "--report")
    assert code == 0, err
    assert command("show", "made/plan.json", "--what", "cut", "--out", "cut.svg")[0] == 0
    code, out, err = command(
        "export", "made/plan.json", "--to", "urscript", "--base", "0.4", "-0.1", "0.2", "0", "0", "0", "--out", "-"
    )
    assert code == 0, err
    assert "force_mode(" in out
    assert (tmp_path / "made" / "report.html").stat().st_size > 100_000
    assert time.process_time() - begun < 60.0
    assert command("verify", "made/plan.json", "--problem", "made/problem.toml")[0] == 0


@pytest.mark.wide
def test_bodies_of_an_assembly_go_together_as_they_stand_there(tmp_path: Path, command: Run) -> None:
    pair = generated(seed=1)[1]
    write_assembly(tmp_path / "both.step", pair, depth=7.0)
    code, _, err = command("init", "both.step", "--error", ERROR, "--json")
    assert code == 0, err
    shown = gallery(tmp_path / "both.step")
    assert [*shown] == [f"{body}-{name}" for body in ("peg", "plate") for name in ("part", "scene", "found")]
    assert "plate" in shown["plate-found"].title
    problem = fmopt.load(tmp_path / "both.toml")
    assert (problem.moving.name, problem.fixed.name) == ("peg", "plate")
    assert -float(problem.goal[2]) == pytest.approx(0.007, abs=1e-9)
    assert problem.measured.per_side == pytest.approx(1e-3 * pair.clearance, abs=1e-9)
    for words, said in (
        (("--moving", "plate", "--fixed", "peg"), ""),
        (("--moving", "1"), ""),
        (("--moving", "nut"), "it has no body 'nut'; name one that it has, or give its number: 1 'peg', 2 'plate'"),
        (("--moving", "peg", "--fixed", "1"), "is to move and to stand; name two of 1 'peg', 2 'plate'"),
    ):
        code, _, err = command("init", "both.step", "--error", ERROR, *words, "--out", f"{len(err)}{words[1]}.toml")
        assert (code, said in err) == (2 if said else 0, True), err
    write_assembly(tmp_path / "apart.step", pair, depth=-5.0)
    assert command("init", "apart.step", "--error", ERROR)[0] == 0
    apart = fmopt.load(tmp_path / "apart.toml")
    assert -float(apart.goal[2]) == pytest.approx(0.012, abs=1e-9)
    assert apart.measured.per_side == pytest.approx(1e-3 * pair.clearance, abs=1e-9)
