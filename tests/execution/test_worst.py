"""The search for failures: a corner that is known, plans whose outcomes are made up, and a few real trials."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from fmopt.cli.entry import app
from fmopt.execution.execute import TrialSettings
from fmopt.execution.press_controller import Errors
from fmopt.execution.press_trials import drawn_errors, drawn_shares
from fmopt.execution.trials import Trials
from fmopt.execution.worst import BATCH, UNKNOWNS, cross_entropy, severity, values_at, worst
from fmopt.plan import parsed, write
from fmopt.plan.evidence import TrialOutcome
from fmopt.report.worst import worst_lines
from fmopt.spatial.values import Array
from tests.shared.plans.press_plan import outcomes, press_choosing, press_plan, press_plan_document

FREE, BUDGET = np.arange(len(UNKNOWNS)) != 2, 256
FRICTION, START_Y = UNKNOWNS.index("friction"), UNKNOWNS.index("start y")
GOOD, BAD = outcomes([True, False])


def corner(shares: Array, _: range) -> Array:
    """Trials fail beyond 0.5 of friction and of a start error; those that do not come the nearer to it, the higher."""
    inside = np.minimum(shares[:, FRICTION], shares[:, START_Y]) - 0.5
    return np.where(inside > 0.0, 1.0, 0.5 * np.exp(np.minimum(inside, 0.0)))


@pytest.mark.parametrize("seed", range(4))
def test_a_corner_that_fails_is_found_and_bounded(seed: int) -> None:
    found, again = (cross_entropy(corner, FREE, BUDGET, seed) for _ in range(2))
    assert np.array_equal(found.shares, again.shares)
    assert not np.array_equal(found.shares, cross_entropy(corner, FREE, BUDGET, seed + 9).shares)
    assert np.abs(found.shares).max() <= 1.0
    assert not found.shares[:, 2].any()
    assert [found.failures(kind)[1] for kind in ("uniform", "fitted", "region")] == [32 + 6 * 8, 6 * 24, BATCH]
    # One uniform draw in sixteen fails.
    assert found.failed.sum() > 4 * BUDGET / 16
    assert found.region is not None
    assert {FRICTION, START_Y} <= {*found.region.named[:2]}
    assert min(found.region.low[FRICTION], found.region.low[START_Y]) > 0.5
    assert found.failures("region") == (BATCH, BATCH)
    ends = found.region.placed(np.array([[-1.0] * len(FREE), [1.0] * len(FREE)]))
    assert np.allclose(ends, [found.region.low, found.region.high])


def test_where_hardly_anything_fails_there_is_no_region() -> None:
    found = cross_entropy(lambda shares, numbers: np.where(np.array(numbers) < 2, 1.0, 0.1 * shares[:, 0]), FREE, 96, 0)
    assert (found.region, int(found.failed.sum()), found.failures("region")) == (None, 2, (0, 0))
    # It goes where trials score more all the same.
    assert found.shares[found.kinds == "fitted", 0].mean() > 0.2


def test_a_trial_scores_the_more_the_nearer_to_failing_it_is() -> None:
    plan = press_plan()
    marks = [(GOOD, 0.0), (GOOD, 14.0), (BAD, 0.0)]
    scores = [severity(replace(one, peak_force=force), plan) for one, force in marks]
    assert 0.0 < scores[0] < scores[1] < scores[2] == 1.0


def test_values_are_those_of_the_draws() -> None:
    conditions = press_choosing().conditions
    errors, (shares, _) = drawn_errors(conditions, 3, 5, range(20)), drawn_shares(3, 5, range(20))
    values = values_at(conditions, shares)
    assert np.array_equal(values[:, :6], errors.start)
    assert np.array_equal(values[:, 7], errors.stiffness)
    assert np.array_equal(values[:, 9:], errors.offset)


@pytest.fixture
def carried(monkeypatch: pytest.MonkeyPatch) -> list[Errors]:
    """In place of the engine: trials fail where a held axis is soft and the force is off along x; their errors."""
    seen = list[Errors]()

    def carry_out(_: Any, __: Any, errors: Errors, *___: Any, **____: Any) -> list[TrialOutcome]:
        seen.append(errors)
        return outcomes(((errors.stiffness > 1.0) | (np.abs(errors.offset[:, 0]) < 0.5)).tolist())

    monkeypatch.setattr("fmopt.execution.press_trials.carry_out", carry_out)
    return seen


def test_the_command_tells_the_region_and_what_it_takes(carried: list[Errors], tmp_path: Path) -> None:
    write(press_plan_document(), tmp_path / "plan.json")
    done = CliRunner().invoke(app, ["execute", "plan.json", "--worst", "--seed", "3", "--json"])
    found = json.loads(done.stdout)
    assert (done.exit_code, found) == (0, json.loads((tmp_path / "trials/worst.json").read_text()))
    assert (found["trials"], found["failures"]) == (256, len(found["failed"]))
    assert found["caution"].startswith("tested, not certified")
    rows = {row["name"]: row for row in found["unknowns"]}
    assert rows["stiffness"]["drawn"] == pytest.approx([0.5, 3.0])
    assert 0.5 < rows["stiffness"]["region"][0] < rows["stiffness"]["region"][1] < 1.0
    soft = max(one["stiffness"] for one in found["failed"])
    assert rows["stiffness"]["without_failure"] == pytest.approx([soft, 3.0])
    told = worst_lines(found)
    assert f"no trial of the search fails from {soft:.3g} on" in "\n".join(told)
    assert told[1].startswith(f"{found['failures']} of 256 trials of a search fail")
    assert CliRunner().invoke(app, ["execute", "plan.json", "--worst", "--seed", "3"]).stdout.splitlines() == told
    assert all(np.array_equal(one.start, other.start) for one, other in zip(carried[:8], carried[8:], strict=True))


def test_real_trials_depend_on_no_number_of_threads(tmp_path: Path) -> None:
    plan, asked = parsed(press_plan_document()), Trials(3, seed=1, offset=2e-2, recovery=False)
    one, other = (worst(plan, asked, TrialSettings(tmp_path, workers)) for workers in (1, 2))
    assert one == other
    assert (one["failures"], one["uniform"], one["unknowns"]) == (3, (3, 3), [])
    assert worst_lines(one)[-1].startswith("no region")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "leave out --worst, and sample its errors by --trials and --beyond"),
        (["--beyond", "3"], "none of --beyond"),
        (["--trials", "0"], "give it trials"),
    ],
)
def test_refusals(words: list[str], message: str, square_peg_plan_file: Path) -> None:
    done = CliRunner().invoke(app, ["execute", str(square_peg_plan_file), "--worst", "--out", "there", *words])
    assert (done.exit_code != 0, Path("there").exists()) == (True, False)
    assert message in f"{done.output} {done.exception}".replace("\n", " ")
