"""Problems read a second time: agreement with the planner's reading, everything compared, refusals, no numerics."""

from __future__ import annotations

import contextlib
import copy
import random
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fmopt.geometry.part import Part as PlannersPart
from fmopt.task.problem import Problem as PlannersProblem
from fmopt.task.problem import load
from fmopt.task.sizes import characteristic_length, measured_clearance
from fmopt.task.toml.units import LENGTH as PINT_LENGTH
from fmopt.task.toml.units import evaluate as planners
from fmopt.verify.problem import ProblemError, differences
from fmopt.verify.problem.compare import half_diagonals
from fmopt.verify.problem.problem import Problem, load_problem
from fmopt.verify.problem.quantities import LENGTH, UNITS, NoQuantity, Quantity, evaluate
from fmopt.verify.problem.sources import Boxed, by_frame, total
from fmopt.verify.reading.parse import parse
from tests import ROOT
from tests.shared.same_solid import assert_same_solid, body

SHIPPED = sorted((ROOT / "problems").glob("*.toml"))
PEG = ROOT / "problems" / "square_peg.toml"


def sides(problem: PlannersProblem) -> dict[str, PlannersPart]:
    return {"moving": problem.moving, "fixed": problem.fixed}


def boxes(read: Problem, problem: PlannersProblem) -> list[Boxed]:
    corners = {side: body(part.polyhedron).vertices for side, part in sides(problem).items()}
    return read.start_boxes(corners["moving"], corners["fixed"], {})


def assert_same_errors(read: Problem, problem: PlannersProblem) -> None:
    found = boxes(read, problem)
    assert total(found) == pytest.approx(problem.start_box.tolist(), abs=1e-13)
    framed = zip(("hole", "hand", "world"), problem.framing.parts(problem.start_box), strict=True)
    assert by_frame(found) == {frame: pytest.approx(box.tolist(), abs=1e-13) for frame, box in framed}


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_both_readings_of_a_shipped_problem_agree(path: Path) -> None:
    problem, read = load(path), load_problem(path)
    assert read.sha256 == problem.sha256
    assert_same_errors(read, problem)
    assert read.velocity_error == (problem.velocity_error.translation, problem.velocity_error.rotation)
    assert read.specification == problem.specification.record()
    assert read.declared_clearance == problem.declared_clearance
    assert read.depth is not None
    assert (-read.depth, read.approach) == (problem.goal[2], problem.approach)
    assert read.turn == pytest.approx(problem.task.turn, abs=1e-15)
    assert read.exchanged == problem.task.exchanged
    for side, part in sides(problem).items():
        assert_same_solid(read, side, part)


@pytest.mark.parametrize("name", ["square_peg", "factory_round_8mm_tight", "bilba_chamfered_60", "kite_prism"])
def test_both_readings_weigh_rotation_by_one_length(name: str) -> None:
    problem = load(ROOT / "problems" / f"{name}.toml")
    found = characteristic_length(problem, measured_clearance(problem))
    pieces = [tuple(body(piece) for piece in part.pieces) for part in sides(problem).values()]
    lengths = half_diagonals(pieces[0], pieces[1], -float(problem.goal[2]))
    assert min(lengths) == pytest.approx(found, abs=1e-13)
    assert max(lengths) == pytest.approx(found, abs=1e-13)


Change = Callable[[dict[str, Any]], Any]


def shifted(side: str, piece: int, axis: int, by: float) -> Change:
    """Moves the corners of a piece that lie farthest along an axis."""

    def change(plan: dict[str, Any]) -> None:
        corners = plan["parts"][side]["pieces"][piece]["vertices"]
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


def without_a_piece(plan: dict[str, Any]) -> None:
    plan["parts"]["fixed"]["pieces"][0] = plan["parts"]["fixed"]["pieces"][1]


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
    "a longer peg": (shifted("moving", 0, 2, 1e-6), "parts.moving.pieces[0]: the plan is for another moving part"),
    "a shorter peg": (shifted("moving", 0, 2, -1e-6), "the model 'square_peg' has material, no piece has"),
    "a skin of 1 nm": (shifted("moving", 0, 0, 1e-9), "parts.moving.pieces[0]: the plan is for another moving part"),
    "a piece less": (without_a_piece, "parts.fixed.pieces: the plan is for another fixed part"),
    "a wider hole": (shifted("fixed", 1, 0, -1e-6), "for another fixed part"),
    "units": (scaled("moving", 1.001), "for another moving part"),
}


@pytest.mark.parametrize("lie", LIES)
def test_everything_that_a_claim_rests_on_is_compared(square_peg_plan: dict[str, Any], lie: str) -> None:
    change, words = LIES[lie]
    changed = copy.deepcopy(square_peg_plan)
    change(changed)
    assert any(words in told for told in differences(parse(changed), PEG)), differences(parse(changed), PEG)


def test_a_true_plan_differs_in_nothing(square_peg_plan: dict[str, Any]) -> None:
    assert differences(parse(square_peg_plan), PEG) == []


@pytest.fixture
def files(tmp_path: Path) -> Path:
    shutil.copytree(ROOT / "problems", tmp_path / "problems")
    shutil.copytree(ROOT / "models", tmp_path / "models")
    return tmp_path


def edited(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))


@pytest.mark.parametrize(
    ("file", "old", "new", "words"),
    [
        ("models/square_peg.toml", "width = 20", "width = 20.001", "the model 'square_peg' has material, no piece has"),
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
    edited(files / file, old, new)
    told = differences(parse(square_peg_plan), files / "problems" / "square_peg.toml")
    assert any("problem.sha256" in line for line in told)
    assert words is None or any(words in line for line in told), told


@pytest.mark.parametrize(
    ("file", "old", "new", "key"),
    [
        ("problems/square_peg.toml", 'length = "mm"', 'length = "furlong"', "units.length"),
        ("problems/square_peg.toml", "friction = ", "frictoin = ", "specification.frictoin"),
        ("problems/square_peg.toml", "x = 0.3", "x = -0.3", "uncertainty.start.x"),
        ("problems/square_peg.toml", "x = 0.3", "x = nan", "uncertainty.start.x"),
        ("problems/square_peg.toml", "x = 0.3", 'x = "0.3 deg"', "uncertainty.start.x"),
        ("problems/square_peg.toml", 'feature = "peg"', 'feature = "hole"', "moving.feature"),
        ("problems/square_peg.toml", "models/square_peg.toml", "models/nothing.toml", "moving.model"),
        ("models/square_peg.toml", "width = 20", "width = 1979-05-27", "parameters.width"),
        ("models/square_peg.toml", 'shape = "box"', 'shape = "blob"', ".shape"),
    ],
)
def test_a_file_that_cannot_be_read_is_named_with_its_key(
    square_peg_plan: dict[str, Any], files: Path, file: str, old: str, new: str, key: str
) -> None:
    edited(files / file, old, new)
    with pytest.raises(ProblemError) as caught:
        differences(parse(square_peg_plan), files / "problems" / "square_peg.toml")
    assert key in caught.value.key
    assert caught.value.file.endswith(".toml")


def test_solids_that_are_made_of_themselves_and_files_without_end(files: Path) -> None:
    model, problem = files / "models" / "square_peg.toml", files / "problems" / "square_peg.toml"
    begin = model.read_text().split("[solids.")[0]
    end = model.read_text()[model.read_text().index("[features") :]
    loop = f'{begin}[solids.peg]\nshape = "union"\nof = ["peg"]\n{end}'
    model.write_text(loop)
    with pytest.raises(ProblemError, match=r"is made of itself|this key is missing"):
        load_problem(problem)
    model.write_text(f"{begin}x = {'[' * 4000}{']' * 4000}\n{end}")
    with pytest.raises(ProblemError, match=r"nested|no TOML"):
        load_problem(problem)
    model.write_bytes(b"name = 1\n" * 200_000)
    with pytest.raises(ProblemError, match="more than 1000000 bytes"):
        load_problem(problem)


def test_expressions_mean_what_the_planner_takes_them_for() -> None:
    names = {"a": Quantity(0.02, LENGTH), "b": Quantity(0.3, LENGTH)}
    theirs = {name: planners(f"{quantity.value!r} m") for name, quantity in names.items()}
    for text in ("2 * (a + 0.1 mm)", "-a / 3 + b", "1.5e-1 cm - -a", "a*b/(a+b)", "+-+a", "((a))", "0.5 in", ".5 · b"):
        found, known = evaluate(text, names), planners(text, theirs)
        assert found.value == pytest.approx(known.value, rel=1e-15)
        assert found.dimension == (known.dimension.length, known.dimension.mass, known.dimension.time, 0)
    for text in ("a b", "a +", "2 ** a", "__import__", "a.b", "1 / (a - a)", "²", "0x1", "(" * 17 + "a" + ")" * 17, ""):
        with pytest.raises(NoQuantity):
            evaluate(text, names)
    with pytest.raises(NoQuantity, match="two kinds"):
        evaluate("a + 1", names)


def test_units_are_those_that_the_planner_knows() -> None:
    assert planners("1 mm").dimension == PINT_LENGTH
    for name, (factor, dimension) in UNITS.items():
        known = planners(f"1 {name}")
        kind = known.dimension
        assert float(factor) == pytest.approx(known.value, rel=1e-12), name
        assert dimension == (kind.length, kind.mass, kind.time, kind.angle), name


HEAVY = ("numpy", "scipy", "casadi", "pydantic", "manifold3d", "trimesh", "shapely", "pint", "tree_sitter")


def test_the_check_of_a_problem_loads_no_numerics(square_peg_plan_file: Path) -> None:
    code = (
        "import sys\nfrom pathlib import Path\nfrom fmopt import verify\nfrom fmopt.verify.reading.parse import parse\n"
        "from fmopt.verify.problem import differences\n"
        f"document = verify.load({str(square_peg_plan_file)!r})\n"
        f"verdict = verify.verify(document).unless(differences(parse(document), Path({str(PEG)!r})))\n"
        f"print(verdict.verdict, [name for name in {HEAVY!r} if name in sys.modules])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "CERTIFIED []\n"


def test_nor_does_the_command_but_for_what_the_command_line_itself_is_made_of(square_peg_plan_file: Path) -> None:
    arguments = ["fmopt", "verify", str(square_peg_plan_file), "--problem", str(PEG), "--quiet"]
    code = (
        f"import sys\nfrom fmopt.cli import main\nsys.argv = {arguments!r}\n"
        "try:\n    code = main()\nexcept SystemExit as end:\n    code = end.code\n"
        f"print(code, [name for name in {HEAVY!r} if name in sys.modules and name != 'pydantic'])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "0 []\n"


def test_a_bad_problem_file_ends_verify_with_its_place(square_peg_plan_file: Path, files: Path) -> None:
    problem = files / "problems" / "square_peg.toml"
    edited(problem, "x = 0.3", 'x = "0.3 parsec"')
    command = [sys.executable, "-m", "fmopt", "verify", str(square_peg_plan_file), "--problem", str(problem)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "square_peg.toml" in done.stderr
    assert "uncertainty.start.x" in done.stderr


SOURCES = """
[uncertainty.sources]
shape = 0.01
configuration = { known = 0.02 }
feeder = { observed = { points = [[10, 0, 2], [-10, 5, 0], [0, -12, 30]], deviation = 0.03 }, placed = [
  { robot = { position = 0.01, angle = 0.02 }, at = [1, 2, 3] },
  { robot = { position = 0.02 }, slide = { position = 0.001, angle = 0.003 } } ] }
robot = { position = 0.01, angle = 0.01 }
grasp = { position = 0.01, angle = 0.03, height = 20 }
"""
OTHERS = {
    "known": SOURCES,
    "measured": SOURCES.replace("shape = 0.01", "measurement = 0.02"),
    "placed": SOURCES.replace("{ known = 0.02 }", "{ placed = [{ robot = { position = 0.1, angle = 0.1 } }] }"),
    "about": SOURCES.replace("{ known = 0.02 }", "{ position = 0.1, angle = 0.2, about = [30, 2, 1] }"),
    "in the hand": '[uncertainty.start]\nframe = "hand"\nx = 0.3\ny = 0.2\nz = 0.1\nrx = 0.1\nry = 0.2\nrz = 0.3\n',
}


@pytest.mark.parametrize("kind", OTHERS)
def test_every_kind_of_source_comes_to_the_same_errors(files: Path, kind: str) -> None:
    file = files / "problems" / "square_peg.toml"
    text = file.read_text()
    begin, end = text.index("[uncertainty.start]"), text.index("[uncertainty.velocity]")
    file.write_text(text[:begin] + OTHERS[kind] + text[end:])
    assert_same_errors(load_problem(file), load(file))


def test_errors_below_rounding_are_raised_and_an_exchanged_problem_turns_its_frames(files: Path) -> None:
    file = files / "problems" / "square_peg.toml"
    text = file.read_text()
    text = text.replace("translation = 0.01", "translation = 0").replace("rotation = 0.01", "rotation = 0")
    file.write_text(text)
    assert_same_errors(load_problem(file), load(file))
    text = text.replace("models/square_peg", "models/x").replace("models/square_hole_block", "models/square_peg")
    text = text.replace("models/x", "models/square_hole_block").replace('feature = "peg"', 'feature = "x"')
    text = text.replace('feature = "hole"', 'feature = "peg"').replace('feature = "x"', 'feature = "hole"')
    file.write_text(text)
    problem, read = load(file), load_problem(file)
    assert read.exchanged
    assert problem.task.exchanged
    assert_same_errors(read, problem)
    for side, part in sides(problem).items():
        assert_same_solid(read, side, part)


@pytest.mark.parametrize("told", ['turn = "free"', ""])
def test_a_round_peg_is_turned_as_the_start_has_it(files: Path, told: str) -> None:
    problem = files / "problems" / "factory_round_8mm_tight.toml"
    edited(problem, 'turn = "free"', told)
    edited(problem, "[start]", "[start]\nturn = [0.1, 0.2, 30]")
    theirs, read = load(problem), load_problem(problem)
    assert read.turn == pytest.approx(theirs.task.turn, abs=1e-12)
    assert read.turn > 0.5
    assert read.sha256 == theirs.sha256


NONSENSE = (
    *("1e400", "nan", "-inf", '"x"', "[]", "{}", "true", "1979-05-27", "-1", "0", '"1/0"', '"(((((1)))))"', "9" * 40),
    *('"² mm"', '"width*width"', '"1 furlong"', '"free"', "2", "[1, 2, 3]", '"full"'),
)


def test_damaged_files_are_refused_or_compared_and_nothing_else(square_peg_plan: dict[str, Any], files: Path) -> None:
    draw, plan = random.Random(47), parse(square_peg_plan)
    problem = files / "problems" / "square_peg.toml"
    kinds = (problem, files / "models" / "square_peg.toml", files / "models" / "square_hole_block.toml")
    originals = {file: file.read_bytes() for file in kinds}
    for _ in range(150):
        file = draw.choice(kinds)
        damaged, lines = bytearray(originals[file]), originals[file].decode().split("\n")
        if draw.random() < 0.3:
            for _ in range(draw.randint(1, 4)):
                damaged[draw.randrange(len(damaged))] = draw.randrange(256)
            file.write_bytes(damaged)
        else:
            number = draw.choice([i for i, line in enumerate(lines) if "=" in line and not line.startswith("#")])
            lines[number] = f"{lines[number].split('=')[0]}= {draw.choice(NONSENSE)}"
            file.write_text("\n".join(lines))
        with contextlib.suppress(ProblemError):
            assert all(isinstance(line, str) for line in differences(plan, problem))
        file.write_bytes(originals[file])
