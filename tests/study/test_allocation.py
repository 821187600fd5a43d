"""Tolerance allocation: the convex program against closed forms and CVXPY, the answer against the certificate."""

import json
import math
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from fmopt.cli import app
from fmopt.errors import InfeasibleError, InputError
from fmopt.spatial.values import Array
from fmopt.study.allocation.cheapest import cheapest
from fmopt.study.allocation.tolerances import load_allocation
from fmopt.study.command import report
from tests import ROOT
from tests.shared.studies.problems import straight

ONE, LOW, HIGH = np.ones(3), np.ones(3), np.full(3, 50.0)
SLOPES = np.array([3e-6, 1e-6, 2e-6])


def affine(u: Array) -> Mapping[str, float]:
    return {"a": 100e-6 - float(SLOPES @ u), "b": 80e-6 - 1e-6 * float(u[1])}


def test_one_affine_margin_has_a_closed_form() -> None:
    """min Σ w/u under s·u = m gives u_i proportional to √(w_i/s_i)."""
    weights = np.array([1.0, 4.0, 2.0])
    found = cheapest(affine, weights, LOW, HIGH, 10e-6, 1e-6)
    shape = np.sqrt(weights / SLOPES)
    exact = 90e-6 * shape / float(SLOPES @ shape)
    assert found.u == pytest.approx(exact, rel=1e-3)
    assert found.cost == pytest.approx(float(np.sum(weights / exact)), rel=1e-6)
    assert found.bound is not None
    assert found.bound <= found.cost
    assert found.margin == pytest.approx(10e-6, abs=1e-9)
    assert found.margin >= 10e-6
    assert found.binding == "a"


def test_bent_margins_agree_with_cvxpy() -> None:
    import cvxpy

    rng = np.random.default_rng(7)
    A, Q = rng.uniform(0.5, 3.0, (6, 4)), rng.uniform(0.0, 0.05, (6, 4))
    room, weights = rng.uniform(40.0, 80.0, 6), rng.uniform(0.5, 4.0, 4)

    def bent(u: Array) -> Mapping[str, float]:
        return {str(k): 1e-6 * float(room[k] - A[k] @ u - Q[k] @ u**2) for k in range(6)}

    found = cheapest(bent, weights, np.ones(4), np.full(4, 30.0), 5e-6, 1e-4)
    u = cvxpy.Variable(4)
    problem = cvxpy.Problem(
        cvxpy.Minimize(weights @ cvxpy.inv_pos(u)), [room - A @ u - Q @ cvxpy.square(u) >= 5.0, u >= 1.0, u <= 30.0]
    )
    best = float(problem.solve(solver="CLARABEL"))
    assert best * (1.0 - 1e-6) <= found.cost <= best * (1.0 + 2e-4)
    assert found.bound is not None
    assert found.bound <= best * (1.0 + 1e-3)
    assert min(bent(found.u).values()) >= 5e-6


def test_margins_that_bind_nowhere_give_the_loosest() -> None:
    found = cheapest(affine, ONE, LOW, np.full(3, 2.0), 10e-6, 1e-3)
    assert found.u == pytest.approx(np.full(3, 2.0), rel=1e-6)


def test_points_where_nothing_can_be_computed_are_backed_away_from() -> None:
    def steep(u: Array) -> Mapping[str, float] | str:
        return affine(u) if float(u.sum()) < 20.0 and u[0] < 3.0 else "a contact ends"

    found = cheapest(steep, ONE, LOW, HIGH, 10e-6, 1e-3)
    assert 18.0 < float(found.u.sum()) < 20.0
    assert 2.5 < found.u[0] < 3.0
    assert found.cost < 0.8
    assert found.binding == "a contact ends"


def test_margins_that_bend_upwards_have_no_bound() -> None:
    def bent(u: Array) -> Mapping[str, float]:
        return {"a": 100e-6 - 10e-6 * float(u[0]) + 8e-6 * max(0.0, float(u[0]) - 3.0)}

    found = cheapest(bent, ONE, LOW, np.full(3, 6.0), 60e-6, 1e-3)
    assert found.u == pytest.approx(np.full(3, 6.0), rel=1e-6)
    assert found.bound is None


def test_too_large_a_margin_is_refused_with_its_shortfall() -> None:
    with pytest.raises(InfeasibleError, match="the tightest tolerances leave 79 um, not 100 um") as caught:
        cheapest(lambda u: {"b": affine(u)["b"]}, ONE, LOW, HIGH, 100e-6, 1e-3)
    assert caught.value.shortfall == pytest.approx(21e-6)
    with pytest.raises(InfeasibleError, match="tightest tolerances: a contact ends"):
        cheapest(lambda u: "a contact ends", ONE, LOW, HIGH, 0.0, 1e-3)


FILE = f"""\
title = "t"
problem = "{ROOT}/problems/lee_huang_peg.toml"
margin = 0.03

[units]
length = "mm"
angle = "deg"

[[tolerances]]
name = "position"
sets = ["uncertainty.start.x", "uncertainty.start.y"]

[[tolerances]]
name = "yaw"
sets = ["uncertainty.start.rz"]
weight = 0.5
high = 0.4
"""
MISTAKES = {
    "path": ('"uncertainty.start.rz"', '"uncertainty.start.rx2"', "did you mean 'uncertainty.start.rx'?"),
    "no tolerance": ('"uncertainty.start.rz"', '"specification.friction"', "is no tolerance"),
    "absent": ('"uncertainty.start.rz"', '"uncertainty.sources.shape"', "the base problem does not state"),
    "unlike": ('"uncertainty.start.rz"', '"uncertainty.start.rz", "uncertainty.start.rx"', "is not the same now"),
    "zero": ('"uncertainty.start.rz"', '"uncertainty.start.z"', "the present value is zero"),
    "unit": ("high = 0.4", 'high = "0.4 mm"', "wrong-unit"),
    "range": ("high = 0.4", "high = 0.1", "not below high"),
    "weight": ("weight = 0.5", "weight = -1", "tolerances[1].weight"),
    "problem": ("lee_huang_peg.toml", "nowhere.toml", "file-missing"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_are_caught_with_their_place(tmp_path: Path, name: str) -> None:
    old, new, words = MISTAKES[name]
    path = tmp_path / "t.toml"
    assert old in FILE
    path.write_text(FILE.replace(old, new))
    with pytest.raises(InputError) as caught:
        load_allocation(path)
    assert any(words in str(fault) for fault in caught.value.faults), caught.value.faults


def test_the_shipped_allocation_is_in_order() -> None:
    question = load_allocation(ROOT / "problems" / "studies" / "factory_rect_8mm_tolerances.toml")
    assert {allowed.name for allowed in question.tolerances} >= {"manufacturing", "fixture_position"}


def small(tmp_path: Path) -> Path:
    straight(tmp_path)
    study = FILE.replace(f"{ROOT}/problems/lee_huang_peg.toml", "base.toml")
    path = tmp_path / "t.toml"
    study = study.replace("margin = 0.03", "margin = 0.004\ngap = 0.02").replace("high = 0.4\n", "high = 2\n")
    path.write_text(study.replace('"uncertainty.start.y"]\n', '"uncertainty.start.y"]\nhigh = 0.5\n'))
    return path


def test_the_answer_is_certified_and_planned_anew(tmp_path: Path) -> None:
    path, folder = small(tmp_path), tmp_path / "out"
    done = CliRunner().invoke(app, ["study", str(path), "--out", str(folder)])
    assert done.exit_code == 0, done.output
    assert "position: 0.01 mm -> " in done.stdout
    plan, answer = (json.loads((folder / name).read_text()) for name in ("plan.json", "allocation.json"))
    assert plan["verdict"] == answer["same_motion"]["verdict"] == answer["planned_anew"]["verdict"] == "CERTIFIED"
    loosest = all(t["after"] > 0.99 * t["high"] for t in answer["tolerances"])
    assert 4e-6 <= answer["same_motion"]["margin"] < (math.inf if loosest else 4.5e-6)
    assert answer["planned_anew"]["margin"] >= 4e-6
    assert answer["cost_after"] < 0.9 * answer["cost_before"]
    if answer["cost_bound"] is not None:  # where the margins of the motion are concave in the errors
        assert answer["cost_bound"] <= answer["cost_after"] < answer["cost_bound"] * 1.03
    assert all(t["now"] <= t["after"] <= t["high"] for t in answer["tolerances"])
    assert plan["uncertainty"]["start_box"][0] == pytest.approx(answer["tolerances"][0]["after"], rel=1e-12)
    (page,) = report(folder)
    assert page.name == "report.html"
    text = page.read_text(encoding="utf-8")
    for words in ("position", "the same motion", "planned anew", "CERTIFIED", "data:image/svg+xml"):
        assert words in text
    assert not re.search(r'(?:src|href)="(?!data:|#)|url\(|@import', re.sub(r'base64,[^"]*', "", text))


def test_a_dry_run_of_an_allocation_lists_the_tolerances(tmp_path: Path) -> None:
    path, folder = small(tmp_path), tmp_path / "out"
    done = CliRunner().invoke(app, ["study", str(path), "--out", str(folder), "--dry-run"])
    assert "yaw: 0.03 deg, may become 0.03 deg to 2 deg, weight 0.5" in done.stdout
    assert not folder.exists()
    assert CliRunner().invoke(app, ["study", str(path), "--limit", "3"]).exit_code == 2
