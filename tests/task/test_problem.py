"""Problems: the shipped ones, their meaning in SI and mating frames, their hash, their schemas, and start boxes."""

import json
import math
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmopt.errors import GeometryError
from fmopt.spatial.se3 import exp, log
from fmopt.task.explain import explain, facts
from fmopt.task.problem import Problem, load
from fmopt.task.sizes import measured_clearance
from fmopt.task.sources import body_width, budget, configuration_shares, least_altitude, total
from fmopt.task.toml.problem_file import Configuration, DeviationTable, Grasp, Handling, Observed, Sources
from fmopt.task.toml.source import read
from tests import ROOT
from tests.shared.files.shipped import copied

PROBLEMS = sorted((ROOT / "problems").glob("*.toml"))
MODELS = sorted((ROOT / "models").glob("*.toml"))
OTHERS = sorted((ROOT / "problems").glob("*/*.toml"))  # assemblies, studies and allocations


@pytest.fixture(scope="module")
def square() -> Problem:
    return load(ROOT / "problems" / "square_peg.toml")


@pytest.fixture(scope="module")
def rectangular() -> Problem:
    return load(ROOT / "problems" / "factory_rect_8mm_tight.toml")


def test_square_peg_in_numbers(square: Problem) -> None:
    np.testing.assert_array_equal(square.goal, [0, 0, -0.03, 0, 0, 0])
    np.testing.assert_array_equal(square.start, [0, 0, 0.001, 0, 0, 0])
    np.testing.assert_allclose(square.start_box, [3e-4, 3e-4, 0, *[math.radians(0.3)] * 3], rtol=1e-15)
    assert square.declared_clearance == (1e-4, 1e-4)
    assert (square.velocity_error.translation, square.velocity_error.rotation) == (0.01, 0.01)
    assert square.specification.speed == 0.02
    assert square.settings.max_tilt == pytest.approx(math.radians(12))


def test_parts_stand_in_their_mating_frames(square: Problem, rectangular: Problem) -> None:
    for problem, depth in ((square, 0.03), (rectangular, 0.0089916)):
        assert problem.moving.polyhedron.vertices[:, 2].min() == 0.0
        assert (problem.fixed.polyhedron.vertices[:, 2].max(), problem.hole.length) == (0.0, depth)
        for feature in (problem.peg, problem.hole):
            np.testing.assert_array_equal(feature.frame.vector(), np.zeros(6))
    volume = 0.06 * 0.06 * 0.04 - 0.0202**2 * 0.03
    assert square.fixed.polyhedron.volume == pytest.approx(volume, rel=1e-12)
    section = 0.008 * 0.007 - 2 * 0.00025**2
    assert rectangular.moving.polyhedron.volume == pytest.approx(section * 0.05, rel=1e-12)


def test_problems_are_frozen_also_after_pickling(square: Problem) -> None:
    for problem in (square, pickle.loads(pickle.dumps(square))):
        with pytest.raises(ValueError, match="read-only"):
            problem.goal[0] = 1.0
        assert problem.sha256 == square.sha256


def test_hash_is_of_what_the_files_say(tmp_path: Path, square: Problem) -> None:
    path = copied(tmp_path)
    assert load(path).sha256 == square.sha256 == load(str(path)).sha256
    path.write_text("# a comment\n" + path.read_text(encoding="utf-8"), encoding="utf-8")
    assert load(path).sha256 == square.sha256
    model = tmp_path / "models" / "square_peg.toml"
    model.write_text(model.read_text(encoding="utf-8").replace("width = 20", "width = 20.01"), encoding="utf-8")
    assert load(path).sha256 != square.sha256


def test_parameters_can_be_overridden(tmp_path: Path) -> None:
    path = copied(tmp_path)
    problem = path.read_text(encoding="utf-8").replace("[fixed]", '[moving.parameters]\nwidth = "2 cm + 0"\n\n[fixed]')
    for width in ("19", '"1.9 cm"', '"0.019 m"'):
        path.write_text(problem.replace('"2 cm + 0"', width), encoding="utf-8")
        assert np.ptp(load(path).moving.polyhedron.vertices, axis=0) == pytest.approx([0.019, 0.019, 0.04], rel=1e-15)


def test_a_given_depth_and_settings_left_out(tmp_path: Path) -> None:
    path = copied(tmp_path)
    written = path.read_text(encoding="utf-8").replace('depth = "full"', 'depth = "1.2 cm"')
    path.write_text(written[: written.index("[settings]")], encoding="utf-8")
    problem = load(path)
    assert (problem.goal[2], problem.settings.max_tilt) == (-0.012, math.radians(25))
    assert problem.settings.time_limit == 600.0
    assert "12 mm below the mouth (40% of full depth)" in explain(problem, measured_clearance(problem))


@pytest.mark.parametrize("path", [*PROBLEMS, *MODELS, *OTHERS], ids=lambda path: str(path.relative_to(ROOT)))
def test_each_file_names_its_schema_and_obeys_it(path: Path) -> None:
    import jsonschema

    first = path.read_text(encoding="utf-8").splitlines()[0]
    schema_path = path.parent / first.removeprefix("#:schema ")
    schema = json.loads(schema_path.read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(read(path).data, schema, jsonschema.Draft202012Validator)


def test_importing_loads_nothing_heavy_and_loading_no_unit_library() -> None:
    heavy = "{'casadi', 'cvxpy', 'manifold3d', 'matplotlib', 'pint', 'pydantic', 'scipy', 'sympy', 'trimesh'}"
    program = f"import sys, fmopt.task.problem as p; print(sorted({heavy} & set(sys.modules)))"
    program += f"\np.load({str(PROBLEMS[-1])!r}); print('pint' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[:2] == ["[]", "False"]


def test_a_problem_in_words(square: Problem, rectangular: Problem) -> None:
    words = explain(square, measured_clearance(square))
    for expected in (
        "moving: square_peg, 20 x 20 x 40 mm, 6 faces, 1 convex piece; mates by peg (solid, length 40 mm)",
        "mates by hole (hollow, blind, depth 30 mm)",
        "leading face 30 mm below the mouth (full depth)",
        "declared on each side: 0.1 mm along x, 0.1 mm along y",
        "measured on the parts: 0.1 mm where it is least; the start error is 3 times that",
        "lowest point 1 mm above the mouth",
        "error as stated: +-0.3, 0.3, 0 mm along x, y, z; +-0.3, 0.3, 0.3 deg about them",
        "velocity off by up to 1 % in translation, 1 % in rotation",
        "about 12 deg about each of x and y",
        square.sha256,
    ):
        assert expected in words
    assert "open at both ends, depth 8.9916 mm" in explain(rectangular, measured_clearance(rectangular))


def test_a_problem_as_data(square: Problem) -> None:
    told = facts(square, measured_clearance(square))
    assert told["measured_clearance"] == pytest.approx(1e-4, abs=1e-12)
    assert (told["play"], told["warnings"]) == (pytest.approx([2e-4, 2e-4], abs=1e-12), [])
    json.dumps(told, allow_nan=False)


def warned(folder: Path, old: str, new: str) -> str:
    """The one warning of the problem with another text in it."""
    path = copied(folder)
    path.write_text(path.read_text(encoding="utf-8").replace(old, new))
    problem = load(path)
    (warning,) = facts(problem, measured_clearance(problem))["warnings"]
    return str(warning)


def test_a_drawing_that_disagrees_with_the_parts_is_told(tmp_path: Path) -> None:
    warning = warned(tmp_path, "y = 0.1", "y = 0.2")
    assert "along y, 0.2 mm a side are declared, 0.1 mm measured" in warning


def test_an_error_as_wide_as_the_part_is_warned_of(tmp_path: Path) -> None:
    warning = warned(tmp_path, "x = 0.3", "x = 15")
    assert "the start error along x, 15 mm, is more than half the width of the moving part, 20 mm" in warning
    assert "check the units" in warning


@pytest.mark.parametrize("wrong", ["y = 1.1", "y = 0.009"])
def test_another_unit_is_no_tolerance(tmp_path: Path, wrong: str) -> None:
    path = copied(tmp_path)
    path.write_text(path.read_text(encoding="utf-8").replace("y = 0.1", wrong))
    with pytest.raises(GeometryError, match=r"along y the parts leave 0\.1 mm a side") as caught:
        measured_clearance(load(path))
    assert "unit" in caught.value.advice


SOURCES = Sources(
    shape=1e-5,
    configuration=Configuration(position=1e-4, angle=0.02),
    feeder=Configuration(position=5e-5, angle=0.01),
    robot=DeviationTable(position=1e-4, angle=0.015),
    grasp=Grasp(position=2e-4, angle=0.03, height=0.04),
)
WIDTHS = (0.02, 0.04)  # of which nothing hangs here


def sampled_error(sources: Sources, start: np.ndarray, axis: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """The start error (6,) when every source deviates fully, each in its own unit direction (n, 3)."""
    turns = iter(directions)
    fixed_turn = exp(sources.configuration.angle * next(turns))
    grasp_turn = np.eye(3)
    for angle in (sources.robot.angle, sources.robot.angle, sources.feeder.angle, sources.grasp.angle):
        grasp_turn = exp(angle * next(turns)) @ grasp_turn
    moved = sum(
        size * next(turns)
        for size in (sources.shape, sources.configuration.position, sources.robot.position, sources.robot.position,
                     sources.feeder.position, sources.grasp.position, sources.shape)
    )  # fmt: skip
    tip = start + sources.grasp.height * axis + moved - sources.grasp.height * (grasp_turn @ axis)
    return np.concatenate([fixed_turn.T @ tip - start, log(fixed_turn.T @ grasp_turn)])


@pytest.mark.parametrize(("aside", "lean"), [(0.0, 0.0), (0.004, 0.3)])
def test_start_box_holds_every_combination_of_sources(aside: float, lean: float) -> None:
    rng = np.random.default_rng(0)
    box = total(budget(SOURCES, WIDTHS, 0.005, aside, lean))
    worst = np.zeros(6)
    for n in range(4000):
        directions = rng.normal(size=(12, 3))
        if n % 2:  # all together along one axis, where the box is attained
            directions = np.tile(np.eye(3)[n // 2 % 3], (12, 1))
            directions[0] *= rng.choice([-1.0, 1.0])
            directions[5:] = np.eye(3)[n // 6 % 3] * rng.choice([-1.0, 1.0])
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        way = rng.uniform(0.0, 2.0 * np.pi, 2)
        start = np.array([aside * np.cos(way[0]), aside * np.sin(way[0]), 0.005])
        axis = np.array([np.sin(lean) * np.cos(way[1]), np.sin(lean) * np.sin(way[1]), np.cos(lean)])
        worst = np.maximum(worst, np.abs(sampled_error(SOURCES, start, axis, directions)))
    assert np.all(worst <= box)
    reached = [0.95, 0.95, 0.3, 0.999, 0.999, 0.999] if lean == 0.0 else [0.8, 0.8, 0.3, 0.999, 0.999, 0.999]
    assert np.all(worst >= reached * box)


def test_a_measured_part_counts_by_its_measurement() -> None:
    measured = total(budget(SOURCES.model_copy(update={"measurement": 3e-5}), WIDTHS, 0.005))
    angle = 2 * 0.015 + 0.03 + 0.01
    position = 3e-5 + 2e-4 + 5e-5 + 2e-4 + 1e-5
    assert measured[0] == pytest.approx(position + 0.04 * math.sin(angle), rel=1e-12)
    assert measured[3] == pytest.approx(angle, rel=1e-12)


def test_sources_in_a_file(tmp_path: Path) -> None:
    path = copied(tmp_path)
    written = path.read_text(encoding="utf-8")
    start, end = written.index("[uncertainty.start]"), written.index("[uncertainty.velocity]")
    sources = """[uncertainty.sources]
shape = 0.01
configuration = { position = 0.1, angle = "20 mrad" }
feeder = { position = 0.05, angle = "10 mrad" }
robot = { position = 0.1, angle = "15 mrad" }
grasp = { position = 0.2, angle = "30 mrad", height = 40 }

"""
    path.write_text(written[:start] + sources + written[end:], encoding="utf-8")
    problem = load(path)
    assert problem.sources == SOURCES
    assert np.all(problem.start_box >= total(budget(SOURCES, WIDTHS, 0.001)))
    np.testing.assert_array_equal(total(problem.budget), problem.start_box)
    words = explain(problem, measured_clearance(problem))
    for share in problem.budget:
        assert f"{share.source} ({share.symbol}): {1e3 * share.box[0]:.6g} mm along x" in words


def moved_points(rng: np.random.Generator, points: np.ndarray, deviation: float, count: int) -> list[tuple[Any, Any]]:
    """Rigid motions x ↦ R x + t that move none of the points (k, 3) by more than the deviation, many to the limit."""
    width, centre, found = least_altitude(points[:3]), points.mean(axis=0), []
    while len(found) < count:
        axis = points[rng.integers(3)] - points[rng.integers(3)] if rng.uniform() < 0.7 else rng.normal(size=3)
        if not axis.any():
            continue
        R = exp(2.2 * deviation / width * rng.uniform() * axis / np.linalg.norm(axis))
        shift = rng.normal(size=3)
        shift *= deviation * rng.uniform() ** (1.0 / 3.0) / np.linalg.norm(shift)
        t = centre + shift - R @ centre
        if rng.uniform() < 0.5:  # the middle of all displacements at zero, which leaves the most room to turn
            off = points @ R.T - points
            t = -0.5 * (off.min(axis=0) + off.max(axis=0))
        if np.linalg.norm(points @ R.T + t - points, axis=1).max() <= deviation:
            found.append((R, t))
    return found


@pytest.mark.parametrize("at", [(0.0, 0.0, 0.0), (0.03, -0.02, 0.05)])
def test_configurations_known_by_points_bound_what_points_allow(at: tuple[float, float, float]) -> None:
    rng, corners = np.random.default_rng(5), np.array([(0.0, 0.0, 0.0), (0.06, 0.0, 0.01), (0.01, 0.04, 0.0)])
    points, width = tuple(map(tuple, corners.tolist())), body_width(corners)
    observed = configuration_shares(Configuration(observed=Observed(points=points, deviation=1e-3)), width, at)
    known = configuration_shares(Configuration(known=1e-3), width, points[1])
    far = turn = 0.0
    for R, t in moved_points(rng, corners, 1e-3, 2000):
        far = max(far, float(np.linalg.norm(R @ at + t - at)))
        turn = max(turn, float(np.linalg.norm(log(R))))
    assert far <= math.fsum(share.position for share in observed)
    assert far >= 0.5 * math.fsum(share.position for share in observed)
    for shares in (observed, known):
        assert 0.8 * math.fsum(share.angle for share in shares) <= turn <= math.fsum(share.angle for share in shares)
    assert math.fsum(share.position for share in known) == 1e-3


def test_handlings_accumulate() -> None:
    rng = np.random.default_rng(6)
    robot, slide = DeviationTable(position=3e-4, angle=0.02), DeviationTable(position=1e-4, angle=0.01)
    grasps = [np.array(at) for at in ((0.0, 0.0, 0.06), (0.0, 0.0, 0.03))]
    handlings = tuple(Handling(robot=robot, slide=slide, at=tuple(at.tolist())) for at in grasps)
    placed = Configuration(position=2e-4, angle=0.015, placed=handlings)
    shares = configuration_shares(placed, 0.0, (0.0, 0.0, 0.0))
    position, angle = (math.fsum(getattr(s, name) for s in shares) for name in ("position", "angle"))
    assert angle == pytest.approx(0.015 + 2 * (2 * 0.02 + 0.01), rel=1e-14)
    far = turn = 0.0
    for n in range(4000):
        axes = rng.normal(size=(20, 3)) if n % 2 else np.tile(np.eye(3)[n // 2 % 3], (20, 1)) * rng.choice([-1, 1])
        d = iter(axes / np.linalg.norm(axes, axis=1)[:, None])
        # x ↦ R x + t, stated about the first grasping point, then turned about each as the robot has it.
        R = exp(0.015 * next(d))
        t = grasps[0] + 2e-4 * next(d) - R @ grasps[0]
        for at in grasps:
            now = R @ at + t
            S = exp(0.02 * next(d)) @ exp(0.02 * next(d)) @ exp(0.01 * next(d))
            R, t = S @ R, S @ (t - now) + now + 3e-4 * next(d) + 3e-4 * next(d) + 1e-4 * next(d)
        far, turn = max(far, float(np.linalg.norm(t))), max(turn, float(np.linalg.norm(log(R))))
    assert 0.8 * position <= far <= position * (1.0 + 1e-12)
    assert 0.999 * angle <= turn <= angle * (1.0 + 1e-12)
    # Grasped twice at one point, turns make no position.
    same = placed.model_copy(update={"placed": (handlings[0],) * 2})
    there = math.fsum(share.position for share in configuration_shares(same, 0.0, (0.0, 0.0, 0.06)))
    assert there == pytest.approx(2e-4 + 2 * (2 * 3e-4 + 1e-4), rel=1e-14)


def test_all_kinds_of_configuration_in_a_file(tmp_path: Path) -> None:
    path = copied(tmp_path)
    written = path.read_text(encoding="utf-8")
    start, end = written.index("[uncertainty.start]"), written.index("[uncertainty.velocity]")
    rest = "robot = { position = 0.1, angle = 0.1 }\ngrasp = { height = 40 }\n"
    found, shares = {}, {}
    for name, given in {
        "known": "{ known = 0.1 }",
        "observed": "{ position = 0.1, angle = 0.1, about = [10, 0, 0] }",
        "points": "{ observed = { points = [[0, 0, 0], [50, 0, 0], [0, 40, 0]], deviation = 0.05 } }",
        "placed": "{ known = 0.1, placed = [{ robot = { position = 0.1 }, at = [0, 0, -5] }] }",
        "exactly": "{ placed = [{ robot = { position = 0.1 }, slide = { position = 0.02, angle = 1 } }] }",
    }.items():
        sources = f"[uncertainty.sources]\nconfiguration = {given}\n{rest}\n"
        path.write_text(written[:start] + sources + written[end:], encoding="utf-8")
        problem = load(path)
        np.testing.assert_array_equal(total(problem.budget), problem.start_box)
        found[name] = problem.sources.configuration
        assert len(facts(problem, measured_clearance(problem))["budget"]) == len(problem.budget)
        shares[name] = {share.source.removeprefix("fixed part, "): share for share in problem.budget}
    width, block = least_altitude([(0.03, 0.03, 0.0), (-0.03, -0.03, -0.04), (-0.03, 0.03, -0.04)]), problem.fixed
    known = shares["known"]["configuration known a priori"]
    assert known.box[0] >= 1e-4
    assert 0.9 * width <= body_width(block.polyhedron.vertices)
    assert known.box[3] == pytest.approx(2.0 * math.asin(1e-4 / body_width(block.polyhedron.vertices)), rel=1e-12)
    assert found["observed"] == Configuration(position=1e-4, angle=math.radians(0.1), about=(0.01, 0.0, 0.0))
    assert shares["observed"]["turn about the observed point"].box[0] > 0.0
    assert found["points"].observed.points == ((0.0, 0.0, 0.0), (0.05, 0.0, 0.0), (0.0, 0.04, 0.0))
    assert shares["placed"]["handling 1, robot"].box[0] >= 2e-4
    assert shares["exactly"]["handling 1, slide"].box[3] == pytest.approx(math.radians(1.0), rel=1e-12)
