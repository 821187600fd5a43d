"""One contact state expanded, by how many contacts the parts can make: prisms of n sides in prismatic holes."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.error_set import ErrorSet
from fmopt.certificate.segment_linearisation import Tolerance
from fmopt.contact.primitive import near_contacts
from fmopt.planning.search.best_first import begin
from fmopt.planning.search.entry import start_spread, straight_entry
from fmopt.planning.search.successors import Costs, Node, Task, successors
from fmopt.spatial.se3 import Pose
from fmopt.task.problem import Problem, load
from fmopt.task.sizes import measured_clearance
from tests import ROOT

RADIUS, GAP = 20.0, 0.4  # mm
SMALL = 0.05  # share of the errors of the hexagonal prism that fits into the clearance, whatever the number of sides


def polygon(sides: int, radius: float) -> str:
    """A regular polygon as a model file lists it."""
    angles = [math.pi * (2 * k + 1) / sides for k in range(sides)]
    points = ", ".join(f"[{radius * math.sin(a)!r}, {-radius * math.cos(a)!r}]" for a in angles)
    return f"polygon = [{points}]"


def prism(folder: Path, sides: int) -> Problem:
    """The problem of the hexagonal prism with another number of sides."""
    wide = RADIUS + GAP / math.cos(math.pi / sides)
    for name, radius in (("prism", RADIUS), ("box", wide)):
        text = (ROOT / "models" / f"hexagon_{name}.toml").read_text(encoding="utf-8")
        changed = re.sub("polygon = .*", polygon(sides, radius), text)
        (folder / f"hexagon_{name}.toml").write_text(changed, encoding="utf-8")
    text = (ROOT / "problems" / "hexagon_prism.toml").read_text(encoding="utf-8")
    (folder / "problem.toml").write_text(text.replace("../models/", ""), encoding="utf-8")
    return load(folder / "problem.toml")


@pytest.mark.parametrize("sides", [4, 8, 16, 25, 50, 100, 300])
@pytest.mark.benchmark(group="one state expanded")
def test_one_state_expanded(benchmark: BenchmarkFixture, tmp_path: Path, sides: int) -> None:
    problem = prism(tmp_path, sides)
    box = SMALL * problem.start_box
    clearance = measured_clearance(problem)
    goal = Pose.from_vector(problem.goal)
    low = goal.moved([0.0, 0.0, 0.02, 0.0, 0.0, 0.0])
    contacts = near_contacts(problem.moving.polyhedron, problem.fixed.polyhedron, low, 1e-3, 0.02)
    assert len(contacts) == 4 * sides
    rates = SMALL * problem.velocity_error.translation, SMALL * problem.velocity_error.rotation
    tolerance = Tolerance(rates, clearance.half_diagonal)
    costs = Costs.of(start_spread(problem.moving, box), clearance.per_side)
    (entry,) = straight_entry(problem.moving, clearance.play, box, problem.approach)

    def unused() -> tuple[tuple[Task], dict[str, object]]:
        # Parts of its own each time, so that nothing is remembered of what was worked out before.
        fresh = prism(tmp_path, sides)
        assembly = Assembly(fresh.moving, fresh.fixed)
        return (Task(assembly, goal, ErrorSet.from_box(box), tolerance, costs, 1.3 * problem.settings.max_tilt),), {}

    def expanded(task: Task) -> list[Node]:
        node = begin(task, entry)
        assert node is not None
        return list(successors(task, node))

    assert benchmark.pedantic(expanded, setup=unused, rounds=5 if benchmark.enabled else 1)
