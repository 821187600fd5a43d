"""The check of whole plans: an honest one passes, and nothing can be changed for the worse."""

import copy
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmopt.plan import parsed
from fmopt.verify import CERTIFIED, NOT_PROVED, REFUTED, PlanError, load, verify
from tests.shared.lies.mutations import changed, claims, junk, numbers
from tests.shared.plans.table_plan import sealed, table_plan, table_plan_with_sets

Plan = dict[str, Any]


@pytest.fixture(scope="module")
def plan() -> Plan:
    return table_plan()


def test_the_untouched_plan_is_certified(plan: Plan) -> None:
    verdict = verify(plan, "ab" * 32)
    assert (verdict.verdict, verdict.findings) == (CERTIFIED, ())
    assert verdict.margin == pytest.approx(min(s["margin"] for s in plan["segments"]), rel=1e-9)
    text = "\n".join(verdict.lines())
    for word in ("friction", "compliance", "dynamics", "whether the real error lies in the stated set"):
        assert word in text


def test_error_sets_are_those_of_the_other_derivation() -> None:
    plan, sets = table_plan_with_sets()
    for one, other in zip(parsed(plan).error_sets, sets, strict=True):
        generators = np.array([[float(x) for x in g] for g in (*other.core, *other.thick)])
        np.testing.assert_allclose(one.generators, generators, rtol=1e-10, atol=1e-15)
        for Q, P in ((one.shape, other.shape), (one.slide, other.slide), (one.swing, other.swing)):
            np.testing.assert_allclose(Q, np.array(P.tolist(), dtype=float), rtol=1e-10, atol=1e-18)


def test_every_number_changed_for_the_worse_is_rejected(plan: Plan) -> None:
    tried = 0
    for name, mutant in numbers(plan, 8):
        verdict = verify(mutant)
        assert verdict.verdict == NOT_PROVED, name
        assert verdict.findings, name
        tried += 1
    assert tried > 60


def test_every_changed_claim_is_rejected(plan: Plan) -> None:
    refused = set()
    for name, mutant in claims(plan):
        try:
            assert verify(mutant).verdict == NOT_PROVED, name
        except PlanError:
            refused.add(name)
    assert len(refused) < 5, refused


def test_junk_never_raises_anything_but_its_own_error(plan: Plan) -> None:
    refused = 0
    for mutant in junk(plan, 150, seed=3):
        try:
            verify(mutant)
        except PlanError:
            refused += 1
    assert 40 < refused < 150


def test_the_seal_and_the_problem(plan: Plan) -> None:
    unsealed = {**copy.deepcopy(plan), "goal": [0.0] * 6}
    assert any(f.what == "sha256" for f in verify(unsealed).findings)
    other = verify(plan, "cd" * 32)
    assert other.verdict == NOT_PROVED
    assert any("another problem" in line for line in other.lines())
    assert not any(line.startswith(("least margin", "checked")) for line in other.lines())


def test_a_short_inequality_says_which_and_by_how_much(plan: Plan) -> None:
    verdict = verify(changed(plan, lambda p: p["uncertainty"]["start_box"].__setitem__(2, 2.9e-3)))
    assert verdict.verdict == NOT_PROVED
    short = [f for f in verdict.findings if f.segment == 0 and f.what == "pieces 0/0" and "short by" in f.message]
    assert [f.shortfall for f in short] == [pytest.approx(346.4e-6, abs=0.1e-6)]
    assert "short by 346.365" in short[0].message


def test_a_collision_is_refuted_with_a_pose(plan: Plan) -> None:
    def raise_table(p: Plan) -> None:
        for body in (p["parts"]["fixed"], *p["parts"]["fixed"]["pieces"]):
            for vertex in body["vertices"]:
                vertex[2] += 0.004 if vertex[2] == 0.0 else 0.0

    verdict = verify(changed(plan, raise_table))
    assert verdict.verdict == REFUTED
    assert verdict.witness.segment == 0
    assert verdict.witness.pose == tuple(plan["segments"][0]["goal"])
    assert 1e-5 < verdict.witness.depth < 1e-3
    assert "collision: segment 0" in "\n".join(verdict.lines())


def test_a_corner_of_the_start_box_can_refute(plan: Plan) -> None:
    def widen(p: Plan) -> None:
        p["uncertainty"]["start_box"] = [0.0, 0.0, 0.03, 0.0, 0.0, 0.0]
        p["segments"] = p["segments"][:1]

    verdict = verify(changed(plan, widen))
    assert verdict.verdict == REFUTED
    assert verdict.witness.error[2] == pytest.approx(-0.03)


def _segment(change: Callable[[Any], Any]) -> Callable[[Plan], None]:
    return lambda p: change(p["segments"][0])


REFUSED: list[tuple[str, Callable[[Plan], Any], str]] = [
    ("format", lambda p: p.update(format="fmopt.plan/3"), "format: must be one of fmopt.plan/2"),
    ("older format", lambda p: p.update(format="fmopt.plan/1"), "fmopt.plan/1: written by an older fmopt; solve the"),
    ("another kind", _segment(lambda s: s.update(kind="press")), r"segments: mix presses and guarded moves"),
    ("other units", lambda p: p["units"].update(length="mm"), "units.length: must be one of m, not 'mm'"),
    ("other frames", lambda p: p["frames"].update(B="the robot's base"), "frames.B: must be one of"),
    ("unused vertex", lambda p: p["parts"]["fixed"]["vertices"].append([0, 0, 0]), "vertex 8 belongs to no face"),
    ("text that turns", lambda p: p["problem"].update(title="a\u202eb"), r"control character U\+202E"),
    ("version with code", lambda p: p.update(fmopt_version="1\nmovej"), "fmopt_version: must be a version"),
    ("name with code", lambda p: p["contacts"][0].update(id="v0;f5"), r"contacts\[0\].id: must be a name"),
    ("no segments", lambda p: p.update(segments=[]), "segments: must have at least 1"),
    ("text for number", _segment(lambda s: s.update(margin="1")), r"segments\[0\]\.margin: must be a number"),
    ("flag for number", _segment(lambda s: s.update(margin=True)), r"segments\[0\]\.margin: must be a number"),
    ("huge integer", _segment(lambda s: s.update(margin=10**400)), "must be a finite number"),
    ("no number", _segment(lambda s: s.update(margin=float("nan"))), "must be a finite number"),
    ("no finite number", _segment(lambda s: s.update(margin=float("inf"))), "must be a finite number"),
    ("short pose", _segment(lambda s: s["start"].pop()), r"segments\[0\]\.start: must have 6 entries"),
    ("long turn", _segment(lambda s: s.update(start=[0, 0, 0, 7, 3, 0])), "longer than a full turn"),
    ("far away", _segment(lambda s: s.update(start=[100, 0, 0, 0, 0, 0])), "must lie between"),
    ("null", _segment(lambda s: s.update(tube=None)), r"segments\[0\]\.tube: must be an object"),
    ("unknown contact", _segment(lambda s: s.update(state=["v9"])), r"state\[0\]: must be one of"),
    ("witness kind", _segment(lambda s: s["separations"][0]["witness"].update(kind="x")), "must be one of fixed-face"),
    ("index out of range", _segment(lambda s: s["separations"][0].update(fixed_piece=2)), "between 0 and 1"),
    ("negative index", _segment(lambda s: s["separations"][0].update(moving_piece=-1)), "between 0 and 0"),
    ("face index", lambda p: p["parts"]["fixed"]["faces"][0][0].__setitem__(0, 99), "between 0 and 7"),
    ("repeated id", lambda p: p["contacts"].append(p["contacts"][0]), "contacts: repeats an id"),
    ("kind and vertices", lambda p: p["contacts"][0].update(kind="edge-edge"), "other numbers of vertices"),
    ("loose tolerance", lambda p: p.update(touch_tolerance=1e-6), "touch_tolerance: must lie between"),
    ("zero rho", lambda p: p["uncertainty"].update(rho=0.0), "uncertainty.rho: must lie between"),
    ("degenerate face", lambda p: p["parts"]["fixed"]["vertices"].__setitem__(0, [-0.05, 0.05, -0.02]), "length"),
    ("not a list", lambda p: p.update(segments={}), "segments: must be a list"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "message"), [r[1:] for r in REFUSED], ids=[r[0] for r in REFUSED])
def test_what_is_no_plan_is_refused_with_its_place(plan: Plan, change: Callable[[Plan], Any], message: str) -> None:
    mutant = copy.deepcopy(plan)
    change(mutant)
    if message == "length":
        assert verify(mutant).verdict != CERTIFIED
        return
    with pytest.raises(PlanError, match=message):
        verify(mutant)


@pytest.mark.parametrize("document", [None, [], "plan", 3, {}])
def test_other_documents_are_refused(document: Any) -> None:
    with pytest.raises(PlanError):
        verify(document)


def test_deep_nesting_is_refused(plan: Plan) -> None:
    deep: Any = 0
    for _ in range(100_000):
        deep = [deep]
    with pytest.raises(PlanError, match="nested too deeply"):
        verify({**plan, "description": deep})


def test_files_are_read_as_they_were_written(plan: Plan, tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(plan, indent=1, sort_keys=True))
    assert verify(load(path)).verdict == CERTIFIED
    no_objects = (b'{"a": -Infinity}', "-Infinity"), (b"[1]", "must be a JSON object"), (b"{", "no JSON")
    for content, message in (*no_objects, (b"\xff\xfe", "cannot be read"), (None, "cannot be read")):
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(PlanError, match=message):
            load(path if content is not None else tmp_path / "missing.json")


def test_contacts_must_name_features_of_the_parts(plan: Plan) -> None:
    verdict = verify(changed(plan, lambda p: p["contacts"][0]["fixed"].update(vertices=[1, 3, 7, 5])))
    assert any("names no convex edge or whole face" in f.message for f in verdict.findings)


def test_parts_must_be_their_pieces(plan: Plan) -> None:
    def lose_piece(p: Plan) -> None:
        p["parts"]["fixed"]["pieces"].pop()
        for s in p["segments"]:
            s["separations"].pop()

    verdict = verify(changed(plan, lose_piece))
    assert verdict.verdict == NOT_PROVED
    assert [f.what for f in verdict.findings] == ["parts"]
    assert "uncovered" in verdict.findings[0].message


def test_unsealed_mutants_fail_by_the_seal_alone(plan: Plan) -> None:
    mutant = copy.deepcopy(plan)
    mutant["problem"]["title"] = "another title"
    assert [f.what for f in verify(mutant).findings] == ["sha256"]
    assert verify(sealed(mutant)).verdict == CERTIFIED


def test_the_check_loads_no_numerical_library() -> None:
    heavy = "numpy casadi cvxpy clarabel sympy scipy mpmath"
    code = f"import sys, fmopt.verify; sys.exit(str([m for m in '{heavy}'.split() if m in sys.modules] or '') or 0)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
