"""P(t) and S(t) of the shipped tasks: diagrams, nodes, the check in space, S(t) on the planes and in space."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from fmopt.papers.lee_huang.freedom import freedom
from fmopt.papers.lee_huang.mapping import Mapping, Task, plane_diagrams, task_mapping
from fmopt.papers.lee_huang.plane_freedom import freedom_on_planes
from fmopt.papers.lee_huang.swept import meetings
from fmopt.task.object_model.command import Answer, answer
from fmopt.task.problem import Problem, load
from fmopt.task.task_command import task_command
from tests import PROBLEMS

TASKS = ["lee_huang_peg", "lee_huang_figure1", "square_peg", "factory_rect_8mm_tight"]
RHO = 0.014


@cache
def task(name: str) -> tuple[Problem, Answer]:
    problem = load(PROBLEMS / f"{name}.toml")
    return problem, answer(*task_command(problem))


@cache
def mapped(name: str) -> Mapping:
    problem, found = task(name)
    bodies = [("moving", found.moving.whole)], [("fixed", found.fixed.whole)]
    operands = found.moving.solid, found.fixed.solid
    speed = problem.specification.speed
    return task_mapping(Task(*operands, found.P0, found.PT, problem.start_box, speed, RHO, *bodies))


@pytest.mark.benchmark(group="P(t): diagrams and nodes")
@pytest.mark.parametrize("name", TASKS)
def test_diagrams(benchmark: BenchmarkFixture, name: str) -> None:
    problem, found = task(name)
    planes = benchmark.pedantic(
        plane_diagrams, (found.moving.solid, found.fixed.solid, found.P0, found.PT, problem.start_box), rounds=3
    )
    assert len(planes) == 3


@pytest.mark.benchmark(group="P(t): the motion against the solids")
@pytest.mark.parametrize("name", TASKS)
def test_motion_in_space(benchmark: BenchmarkFixture, name: str) -> None:
    _, found = task(name)
    bodies = [("moving", found.moving.whole)], [("fixed", found.fixed.whole)]
    assert benchmark.pedantic(meetings, (*bodies, mapped(name).path), rounds=3) == ()


@pytest.mark.benchmark(group="S(t)")
@pytest.mark.parametrize("name", TASKS)
def test_freedom_on_the_planes(benchmark: BenchmarkFixture, name: str) -> None:
    made = mapped(name)
    views = [view for plane in made.planes for view in plane.views]
    found = benchmark.pedantic(freedom_on_planes, (views, made.path), rounds=3)
    assert found[-1].end == made.path.duration


@pytest.mark.benchmark(group="S(t)")
@pytest.mark.parametrize("name", TASKS)
def test_freedom_in_space(benchmark: BenchmarkFixture, name: str) -> None:
    problem, _ = task(name)
    box = np.asarray(problem.start_box)
    found = benchmark.pedantic(freedom, (problem.moving, problem.fixed, mapped(name).path, box), rounds=1)
    assert found[-1].end == mapped(name).path.duration
