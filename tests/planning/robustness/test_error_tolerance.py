"""How much error a motion tolerates: the factor holds and no more does, and sensitivities are those of the margin."""

import re
from dataclasses import replace

import numpy as np
import pytest

from fmopt.errors import InfeasibleError
from fmopt.plan import parsed
from fmopt.plan.description import Description
from fmopt.planning.pipeline import certified_motion, planned
from fmopt.planning.posed import FINE
from fmopt.planning.robustness.error_tolerance import (
    CertifiedMotion,
    ErrorTolerance,
    WholeMotion,
    error_tolerance,
    largest_factor,
    what_fails,
)
from fmopt.report.recovery_tables import rates, tolerance_chapter, tolerated_words
from fmopt.task.problem import Problem, load
from tests import PROBLEMS

FINENESS = 1.0 / 64.0


@pytest.fixture(scope="module")
def solved() -> tuple[Problem, CertifiedMotion]:
    """A rectangular peg with start errors and a drift that fit into the clearance, so that it goes straight through."""
    problem = load(PROBLEMS / "factory_rect_8mm_tight.toml")
    steady = replace(problem.velocity_error, translation=3e-4, rotation=3e-4)
    problem = replace(problem, start_box=0.01 * problem.start_box, velocity_error=steady)
    done = certified_motion(problem)
    assert done.found.names == ("approach", "-z")
    return problem, done


@pytest.fixture(scope="module")
def motion(solved: tuple[Problem, CertifiedMotion]) -> WholeMotion:
    problem, done = solved
    return WholeMotion(done.assembly, done.placed.moves, problem.start_box, done.tolerance, FINE)


@pytest.fixture(scope="module")
def found(solved: tuple[Problem, CertifiedMotion], motion: WholeMotion) -> ErrorTolerance:
    x, y = (0.5 * play for play in solved[1].clearance.play)
    return error_tolerance(motion, (x, y))


def test_the_check_agrees_with_the_factor(solved: tuple[Problem, CertifiedMotion], found: ErrorTolerance) -> None:
    problem, done = solved
    for share, verdict in ((1.0, "CERTIFIED"), (1.0 + 2.0 * FINENESS, None)):
        wider = replace(problem, start_box=share * np.array(found.start_box))
        motion = WholeMotion(done.assembly, done.placed.moves, wider.start_box, done.tolerance, FINE)
        if verdict is None:
            assert (motion.margin or 0.0) <= 0.0
            continue
        # The same moves, certified for the wider errors, then checked from their plan alone.
        document, judged = planned(wider, replace(done, placed=motion.placed()))
        assert document["uncertainty"]["start_box"] == wider.start_box.tolist()
        assert str(judged.verdict) == verdict, judged.findings


def test_the_factor_is_relative_to_the_errors(motion: WholeMotion, found: ErrorTolerance) -> None:
    half = largest_factor(replace(motion, box=0.5 * motion.box))
    assert half == pytest.approx(2.0 * found.factor, rel=2.0 * FINENESS)
    beyond = largest_factor(replace(motion, box=2.0 * np.array(found.start_box)))
    assert beyond == pytest.approx(0.5, rel=2.0 * FINENESS)


def test_what_ends_the_factor_is_what_fails(motion: WholeMotion, found: ErrorTolerance) -> None:
    end = found.end
    beyond = replace(motion, box=(1.0 + 1.5 * FINENESS) * np.array(found.start_box))
    assert what_fails(beyond) == end
    up_to, before = (replace(beyond, moves=beyond.moves[: end.move + k]) for k in (1, 0))
    if end.reason:
        with pytest.raises(InfeasibleError, match=re.escape(end.reason)):
            up_to.placed()
        assert not before.moves or before.placed()
    else:
        worst = min(up_to.placed().reached.claims, key=lambda claim: claim.margin)
        assert worst.margin <= 0.0
        assert worst.binding == end.binding


def test_sensitivities_are_differences_of_margins(motion: WholeMotion, found: ErrorTolerance) -> None:
    now = motion.margin
    assert now is not None
    by_name = {s.name: s for s in found.sensitivities}
    stated = [name for name, size in zip(("x", "y", "z", "rx", "ry", "rz"), motion.box, strict=True) if size > 0.0]
    assert set(by_name) == {*(f"start.{n}" for n in stated), "velocity.translation", "velocity.rotation", "clearance"}
    for name, one in by_name.items():
        assert one.change is not None
        assert one.step == pytest.approx(0.02 * one.value)
        if name == "clearance":
            assert 0.0 < one.change <= 2.5 * one.step
        else:
            assert one.change <= 1e-12
    then = replace(motion, box=motion.box + np.eye(6)[3] * by_name["start.rx"].step).margin
    assert then is not None
    assert then - now == pytest.approx(by_name["start.rx"].change, abs=1e-12)


def test_a_slimmer_peg_gains_as_the_clearance(solved: tuple[Problem, CertifiedMotion], found: ErrorTolerance) -> None:
    """Planned anew for a peg that is slimmer by 5 µm a side, the margin is no less than the rate foretells."""
    from fmopt.geometry.part import stretched

    problem, done = solved
    gap = 5e-6
    x, y, _ = 0.5 * np.ptp(problem.moving.polyhedron.vertices, axis=0)
    slim = stretched(problem.moving, (1.0 - gap / x, 1.0 - gap / y, 1.0))
    assert slim.polyhedron.volume == pytest.approx(problem.moving.polyhedron.volume * (1 - gap / x) * (1 - gap / y))
    other = certified_motion(replace(problem, moving=slim))
    rate = next(s for s in found.sensitivities if s.name == "clearance")
    assert rate.change is not None
    assert other.clearance.per_side - done.clearance.per_side == pytest.approx(gap, rel=1e-6)
    expected = rate.change / rate.step * gap
    assert other.placed.margin - done.placed.margin >= expected - 0.1 * gap


def test_people_read_it(solved: tuple[Problem, CertifiedMotion], found: ErrorTolerance) -> None:
    plan = parsed(planned(*solved, measured=found)[0])
    words = tolerated_words(plan)
    assert f"up to {found.factor:.3g} times the start errors" in words
    assert "only the stated errors are certified" in words.lower()
    assert {row[0] for row in rates(plan)} >= {"clearance on each side", "error x", "velocity error, rotation"}
    assert all("more: " in row[2] for row in rates(plan))
    assert "What each tolerance costs" in tolerance_chapter(plan)
    assert plan.description.diagnostics.tolerated is not None
    none = replace(plan.description.diagnostics.tolerated, factor=0.0, start_box=(0.0,) * 6)
    described = replace(plan.description, diagnostics=replace(plan.description.diagnostics, tolerated=none))
    words = tolerated_words(replace(plan, description=described))
    assert words.startswith("This motion has no positive margin, however small the start errors. What ends it is move ")
    without = replace(plan, description=Description())
    assert tolerated_words(without) == "" == tolerance_chapter(without)
