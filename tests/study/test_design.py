"""Studies as files: every mistake is found before anything starts, with its place; every point lies where it should."""

import math
from collections.abc import Callable
from dataclasses import replace
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fmopt.errors import InputError
from fmopt.study import evaluation
from fmopt.study.design import load_study
from fmopt.study.running.program import program
from fmopt.study.sampling import Normal, Uniform, cube, grid, stepped
from fmopt.study.targets import Base, assigned
from fmopt.task.loading import problem_of
from tests import ROOT

Writer = Callable[..., Path]

HEAD = """\
title = "a study"
problem = "{problem}"
compute = ["clearance"]

[units]
length = "mm"
angle = "deg"

"""
GAP = """\
[[axes]]
name = "gap"
values = [0.1, 0.2]
sets = { "clearance.x" = "gap", "model.fixed.width" = "20 mm + 2 * gap" }
"""


@pytest.fixture
def written(tmp_path: Path) -> Writer:
    def write(text: str, **changes: str) -> Path:
        path = tmp_path / "study.toml"
        head = HEAD.format(problem=ROOT / "problems" / "square_peg.toml")
        for old, new in changes.items():
            head = head.replace(f"{old} = ", f"{old} = {new} # ", 1)
        path.write_text(head + text, encoding="utf-8")
        return path

    return write


def faults(path: Path) -> list[str]:
    with pytest.raises(InputError) as caught:
        load_study(path)
    return [str(fault).removeprefix(f"{path}:") for fault in caught.value.faults]


def test_arithmetic_sets_several_parameters_in_their_units(written: Writer) -> None:
    runs = list(load_study(written(GAP)).runs())
    assert [dict(run.assigned) for run in runs] == [
        {("clearance", "x"): "0.0001 m", ("fixed", "parameters", "width"): "0.0202 m"},
        {("clearance", "x"): "0.0002 m", ("fixed", "parameters", "width"): "0.0204 m"},
    ]


def test_keys_tell_inputs_apart_and_nothing_else(written: Writer) -> None:
    first = [run.key for run in load_study(written(GAP)).runs()]
    assert len(set(first)) == 2
    assert [run.key for run in load_study(written("# nothing\n" + GAP, title='"another title"')).runs()] == first
    changed = load_study(written(GAP.replace("0.2", "0.3"))).runs()
    assert next(changed).key == first[0]
    assert next(changed).key != first[1]
    assert not set(first) & {run.key for run in load_study(written(GAP, compute='["clearance", "bias"]')).runs()}


def test_keys_depend_on_the_problem_the_models_and_the_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "problems").mkdir()
    (tmp_path / "models").mkdir()
    texts = {
        "problems/square_peg.toml": (ROOT / "problems" / "square_peg.toml").read_text(),
        "models/square_peg.toml": (ROOT / "models" / "square_peg.toml").read_text(),
        "models/square_hole_block.toml": (ROOT / "models" / "square_hole_block.toml").read_text(),
        "problems/study.toml": HEAD.format(problem="square_peg.toml") + GAP,
    }

    def key(**changes: tuple[str, str]) -> str:
        for name, text in texts.items():
            old, new = changes.get(Path(name).stem + "_" + name.split("/")[0], ("", ""))
            assert old in text
            (tmp_path / name).write_text(text.replace(old, new, 1) if old else text)
        return next(load_study(tmp_path / "problems" / "study.toml").runs()).key

    plain = key()
    assert key(square_peg_problems=("# fractions", "# shares")) == plain
    others = [
        key(square_peg_problems=("friction = 0.3", "friction = 0.4")),
        key(square_peg_models=("length = 40", "length = 41")),
        key(square_hole_block_models=("depth = 30", "depth = 29")),
    ]
    monkeypatch.setattr("fmopt.study.design.program", lambda: "another")
    assert len({plain, key(), *others}) == 5


def test_a_grid_takes_all_combinations_and_linked_axes_go_together(written: Writer) -> None:
    text = GAP + (
        '[[axes]]\nname = "mu"\nlow = 0.1\nhigh = 0.3\nsteps = 3\nsets = ["specification.friction"]\n'
        '[[axes]]\nname = "tilt"\nvalues = [10, 11]\nlinked = "gap"\nsets = ["settings.max_tilt"]\n'
    )
    points = load_study(written(text)).points
    tilts = [math.radians(10.0), math.radians(11.0)]
    expected = [(g, mu, tilts[k]) for k, g in enumerate((1e-4, 2e-4)) for mu in (0.1, 0.2, 0.3)]
    assert len(points) == 6
    for point, wanted in zip(points, expected, strict=True):
        assert point == pytest.approx(wanted, rel=1e-12)


def test_a_list_goes_through_all_axes_at_once_and_words_are_taken_as_they_are(written: Writer) -> None:
    text = GAP + (
        '[[axes]]\nname = "how"\nvalues = ["sound", "dakin1993"]\nsets = ["settings.method"]\n'
        '[sampling]\nmethod = "list"\n'
    )
    assert load_study(written(text)).points == [(1e-4, "sound"), (2e-4, "dakin1993")]


SAMPLED = """\
[[axes]]
name = "a"
low = 0.1
high = "0.3 mm"
sets = ["uncertainty.start.x"]
[[axes]]
name = "b"
mean = 0.2
deviation = 0.05
low = 0.1
sets = ["uncertainty.start.rx"]
[[axes]]
name = "c"
low = 0.01
high = 1
spacing = "log"
linked = "a"
sets = ["specification.friction"]
[sampling]
method = "{method}"
runs = 64
seed = 5
"""


@pytest.mark.parametrize("method", ["random", "latin-hypercube", "sobol", "saltelli"])
def test_sampled_points_keep_to_their_ranges_and_to_their_seed(written: Writer, method: str) -> None:
    points = np.array(load_study(written(SAMPLED.format(method=method))).points)
    assert points.shape == (64 * (4 if method == "saltelli" else 1), 3)
    assert np.array_equal(points, np.array(load_study(written(SAMPLED.format(method=method))).points))
    a, b, c = points.T
    assert (a >= 1e-4).all()
    assert (a <= 3e-4).all()
    assert (b >= math.radians(0.1)).all()
    assert abs(float(np.median(b)) - math.radians(0.2)) < math.radians(0.02)
    share = (a - 1e-4) / 2e-4
    assert np.allclose(np.log(c), np.log(0.01) * (1.0 - share), atol=1e-9)
    other = SAMPLED.format(method=method).replace("seed = 5", "seed = 6")
    assert not np.array_equal(points, np.array(load_study(written(other)).points))


def test_a_latin_hypercube_has_one_point_in_every_slice() -> None:
    for column in cube("latin-hypercube", 3, 50, 1).T:
        assert sorted((50 * column).astype(int).tolist()) == list(range(50))


def test_saltelli_changes_one_column_at_a_time() -> None:
    points = cube("saltelli", 3, 8, 2)
    A, B, mixed = points[:8], points[8:16], points[16:].reshape(3, 8, 3)
    for i in range(3):
        for j in range(3):
            assert np.array_equal(mixed[i][:, j], (B if i == j else A)[:, j])
    assert not np.isclose(A, B).any()


@given(st.floats(0.0, 1.0), st.floats(-5.0, 5.0), st.floats(0.1, 3.0))
@settings(max_examples=200, deadline=None)
def test_quantiles_of_distributions(quantile: float, middle: float, width: float) -> None:
    from scipy import stats

    low, high = middle - width, middle + 2.0 * width
    value = Uniform(low, high).at(quantile)
    assert low <= value <= high
    cut = Normal(middle, width, low, high).at(quantile)
    exact = stats.truncnorm.ppf(quantile, -1.0, 2.0, middle, width)
    assert cut == pytest.approx(float(exact), abs=1e-6 * width)


def test_steps_have_round_numbers_and_exact_ends() -> None:
    assert stepped(Uniform(0.1, 0.5), 5) == [0.1, 0.2, 0.3, 0.4, 0.5]
    assert stepped(Uniform(1e-3, 1e3, True), 7) == [1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0, 1e3]
    assert stepped(Uniform(2.0, 3.0), 1) == [2.0]
    assert grid([2, 3]).tolist() == [[0, 0], [0, 1], [0, 2], [1, 0], [1, 1], [1, 2]]


def axis(text: str, name: str = "a") -> str:
    return f'[[axes]]\nname = "{name}"\n{text}\n'


def of(path: str, values: str = "1") -> str:
    """An axis of one path."""
    return axis(f'values = [{values}]\nsets = ["{path}"]')


X, Y = (f'sets = ["uncertainty.start.{name}"]' for name in "xy")
RANGE, NORMAL = f"low = 0.1\nhigh = 0.3\n{X}", f"mean = 0.1\ndeviation = 0.3\n{X}"
ONE = axis(f"values = [0.1]\n{X}")
CUBE = '[sampling]\nmethod = "{}"\nruns = {}\nseed = 1\n'
RANDOM = CUBE.format("random", 10)
MISTAKES = {
    "unknown path": (of("uncertainty.start.yx"), "12:9: unknown-path: axes[0].sets[0]: "),
    "near path": (of("specification.frictoin"), "did you mean 'specification.friction'?"),
    "unknown model parameter": (of("model.fixed.widht"), "did you mean 'model.fixed.width'?"),
    "no such table": (of("colour"), "paths here: "),
    "empty axis": (axis(f"values = []\n{X}"), "11:10: empty-axis: axes[0].values: the axis has no values"),
    "empty range": (axis(f"low = 0.3\nhigh = 0.1\nsteps = 3\n{X}"), "empty-axis: axes[0].low: low 0.3 mm is not below"),
    "neither": (axis(X), "neither values nor a range"),
    "both": (axis(f"values = [1]\nsteps = 3\n{X}"), "remove steps, or values"),
    "wrong unit": (axis(f'values = ["0.3 deg"]\n{X}'), "11:11: wrong-unit: axes[0].values[0]: '0.3 deg' is an angle"),
    "unknown unit": (axis(f'values = ["0.3 mmm"]\n{X}'), "11:11: unknown-unit: axes[0].values[0]: "),
    "mixed": (axis('values = [0.1]\nsets = ["uncertainty.start.x", "uncertainty.start.rx"]'), "a length and an angle"),
    "wrong unit in arithmetic": (
        axis('values = [0.1]\nsets = { "clearance.x" = "a", "uncertainty.start.rx" = "2 * a" }'),
        "'2 * a' is a length, not an angle",
    ),
    "unknown name": (axis('values = [0.1]\nsets = { "clearance.x" = "2 * b" }'), "there is no parameter 'b'"),
    "code": (axis('values = [0.1]\nsets = { "clearance.x" = "__import__(os)" }'), "no parameter '__import__'"),
    "out of range": (axis(f"values = [0.1, -0.2]\n{X}"), "negative: axes[0].values: '-0.0002 m' = -0.2 mm is negative"),
    "too large": (of("uncertainty.start.rx", "0.1, 50"), "is too large; keep it at most 28.6478897 deg"),
    "unknown word": (of("settings.method", '"sonud"'), "'sonud' is none of the choices"),
    "number for a word": (of("settings.method"), "1 is no word"),
    "range of words": (axis('low = 1\nhigh = 2\nsets = ["settings.method"]'), "words have no range"),
    "twice": (ONE * 2, "there are two axes 'a'"),
    "set twice": (ONE + ONE.replace('"a"', '"b"'), "is set by axis 'a'"),
    "taken name": (ONE.replace('"a"', '"margin"'), "a column is called 'margin' already"),
    "unknown link": (axis(f'values = [0.1]\nlinked = "z"\n{X}'), "there is no axis 'z' above this one"),
    "lengths": (
        axis(f"values = [0.1, 0.2]\n{X}") + axis(f'values = [0.1]\nlinked = "a"\n{Y}', "b"),
        "1 values go along with 2 of axis 'a'",
    ),
    "a million by accident": (
        axis(f"low = 0.1\nhigh = 0.3\nsteps = 1000\n{X}") + axis(f"low = 0.1\nhigh = 0.3\nsteps = 1000\n{Y}", "b"),
        "these axes make 1 000 000 runs, more than 100 000; use fewer values; if you mean it, say [limits] runs = 1000",
    ),
    "no seed": (axis(RANGE) + '[sampling]\nmethod = "sobol"\nruns = 8\n', "needs 'seed'"),
    "seed of a grid": (ONE + "[sampling]\nseed = 1\n", "a grid has no 'seed'"),
    "power of two": (axis(RANGE) + CUBE.format("sobol", 100), "use 64 or 128"),
    "steps of a sample": (axis(f"low = 0.1\nhigh = 0.3\nsteps = 3\n{X}") + RANDOM, "has no steps"),
    "normal grid": (axis(NORMAL), "a grid or list takes values"),
    "half a normal": (axis(f"mean = 0.1\n{X}") + RANDOM, "mean and deviation"),
    "no deviation": (axis(f"mean = 0.1\ndeviation = 0\n{X}") + RANDOM, "make it positive"),
    "log of nothing": (axis(f'low = 0\nhigh = 1\nsteps = 3\nspacing = "log"\n{X}'), "a logarithm needs a positive"),
    "a value twice": (of("settings.max_tilt", "1, 2, 1"), "11:17: conflict: axes[0].values[2]: this value is there"),
    "a table": (
        of("uncertainty.velocity"),
        "name one of uncertainty.velocity.translation, uncertainty.velocity.rotation",
    ),
    "negative tail": (axis(NORMAL) + RANDOM, "11:8: negative: axes[0].mean: "),
    "a word for a truth": (of("settings.reduce_errors", '"yes"'), "'yes' is no truth; write true"),
    "truth and word": (
        axis('values = [true]\nsets = ["settings.reduce_errors", "settings.method"]'),
        "one value is to be a choice of words and true or false",
    ),
    "unknown key": (
        axis(f"value = [0.1]\n{X}"),
        "11:1: unknown-key: axes[0].value: there is no such key; did you mean",
    ),
}


HEADS = {
    "quantity": ({"compute": '["margin"]'}, "3:12: unknown-quantity: compute[0]: there is no quantity 'margin'"),
    "twice": ({"compute": '["plan", "plan"]'}, "'plan' is asked for twice"),
    "a study": ({"problem": f'"{ROOT}/problems/studies/square_peg_bias.toml"'}, "2:11: file-kind: problem: "),
    "no problem": ({"problem": '"nowhere.toml"'}, "2:11: file-missing: problem: "),
    "plan kept": ({"compute": '["clearance"]\nkeep = ["plan"]'}, "plans are to be kept but none is computed"),
}


CASES = [*((text, {}, words) for text, words in MISTAKES.values()), *((GAP, *row) for row in HEADS.values())]
CASES.append(("", {"compute": '["plan"]\naxes = []'}, "empty-axis: axes: there are no axes"))


@pytest.mark.parametrize(("text", "changes", "words"), CASES, ids=[*MISTAKES, *HEADS, "no axes"])
def test_mistakes_are_caught_with_their_place(written: Writer, text: str, changes: dict[str, str], words: str) -> None:
    found = faults(written(text, **changes))
    assert any(words in fault for fault in found), found


def test_executions_without_a_physics_engine_are_refused(written: Writer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evaluation, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"missing-extra: compute\[0\]: 'execution' cannot .*: it needs MuJoCo"):
        load_study(written(GAP, compute='["execution"]'))


def test_a_base_problem_at_fault_is_told_as_itself(written: Writer, tmp_path: Path) -> None:
    text = (ROOT / "problems" / "square_peg.toml").read_text().replace('"../', f'"{ROOT}/')
    (tmp_path / "base.toml").write_text(text.replace("friction = 0.3", "friction = -1"))
    with pytest.raises(InputError, match=r"base\.toml:\d+:\d+: negative: specification\.friction"):
        load_study(written(GAP, problem='"base.toml"'))


def test_a_problem_or_a_model_is_no_study() -> None:
    with pytest.raises(InputError, match="this is a problem file, not a study"):
        load_study(ROOT / "problems" / "square_peg.toml")
    with pytest.raises(InputError, match="missing-key"):
        load_study(ROOT / "models" / "square_peg.toml")


def test_every_number_and_choice_of_a_problem_may_vary() -> None:
    targets = Base.read(ROOT / "problems" / "square_peg.toml").targets()
    assert {"uncertainty.start.rz", "uncertainty.sources.grasp.height", "settings.method", "goal.depth"} <= set(targets)
    assert {"model.moving.length", "model.fixed.proud", "uncertainty.velocity.rotation"} <= set(targets)
    assert "title" not in targets
    assert targets["settings.placement"].dimension is None


def test_masses_and_stiffnesses_may_vary(written: Writer, tmp_path: Path) -> None:
    limits = '[specification]\nimpact_force = "40 N"\napparent_mass = "2 kg"\ncontact_stiffness = "200 N/mm"\n'
    base = (ROOT / "problems" / "square_peg.toml").read_text().replace("../models", f"{ROOT}/models")
    (tmp_path / "base.toml").write_text(base.replace("[specification]\n", limits))
    heavy = of("specification.apparent_mass", '"0.5 kg", "1 kg"')
    hard = of("specification.contact_stiffness", '"20 N/mm"').replace('"a"', '"b"')
    study = load_study(written(heavy + hard, problem='"base.toml"'))
    found = [problem_of(assigned(study.base.problem, run.assigned)).specification for run in study.runs()]
    assert [one.apparent_mass for one in found] == [0.5, 1.0]
    assert {one.contact_stiffness for one in found} == {20000.0}


def test_entries_of_arrays_and_truths_may_vary(written: Writer, tmp_path: Path) -> None:
    base = (ROOT / "problems" / "lee_huang_peg.toml").read_text().replace("../models", f"{ROOT}/models")
    (tmp_path / "base.toml").write_text(base)
    reduced = of("settings.reduce_errors", "false, true").replace('"a"', '"b"')
    study = load_study(written(of("start.at.x", "10, 14") + reduced, problem='"base.toml"'))
    problems = [problem_of(assigned(study.base.problem, run.assigned)) for run in study.runs()]
    assert [p.settings.reduce_errors for p in problems] == [False, True, False, True]
    entries = [assigned(study.base.problem, run.assigned).data["start"]["at"] for run in study.runs()]
    assert (entries[0], entries[3]) == (["0.01 m", 4, 12], ["0.014 m", 4, 12])
    assert "start.at" not in study.base.targets()
    assert study.base.problem.data["start"]["at"] == [15, 4, 12]


def test_robots_that_handled_a_part_may_vary() -> None:
    data = {"uncertainty": {"sources": {"feeder": {"placed": [{"robot": {"position": n}} for n in (1, 2)]}}}}
    base = Base.read(ROOT / "problems" / "square_peg.toml")
    base = replace(base, problem=replace(base.problem, data={**base.problem.data, **data}))
    path = "uncertainty.sources.feeder.placed.1.robot.position"
    changed = assigned(base.problem, [(base.targets()[path].key, 3)])
    placed = changed.data["uncertainty"]["sources"]["feeder"]["placed"]
    assert placed == [{"robot": {"position": 1}}, {"robot": {"position": 3}}]


def test_the_program_is_its_libraries_too_as_far_as_they_are_there(monkeypatch: pytest.MonkeyPatch) -> None:
    real = metadata.version

    def told(name: str, number: str | None) -> str:
        def version(asked: str) -> str:
            if asked != name:
                return real(asked)
            if number is None:
                raise metadata.PackageNotFoundError(asked)
            return number

        with monkeypatch.context() as patch:
            patch.setattr(metadata, "version", version)
            return program.__wrapped__()

    names = ("casadi", "scipy", "mujoco", "cadquery-ocp-novtk")
    assert len({told(name, number) for name in names for number in ("0.0.1", None)}) == 2 * len(names)


STUDIES = [p for p in sorted((ROOT / "problems" / "studies").glob("*.toml")) if "[[axes]]" in p.read_text()]


@pytest.mark.parametrize("path", STUDIES, ids=lambda path: path.stem)
def test_shipped_studies_are_in_order(path: Path) -> None:
    study = load_study(path)
    assert len({run.key for run in study.runs()}) == len(study.points)
