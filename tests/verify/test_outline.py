"""What stands beside the segments of a plan has to agree with itself and with them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from fmopt.plan import NOT_COVERED
from fmopt.verify import CERTIFIED, NOT_PROVED, verify
from fmopt.verify.reading.document import NOT_COVERED as KNOWN
from tests.shared.lies.mutations import changed

Plan = dict[str, Any]


def test_what_is_not_covered_is_said_in_the_same_words() -> None:
    assert KNOWN == NOT_COVERED


def _last(values: list[Any], value: Any) -> None:
    values[-1] = value


def _unexpanded(search: dict[str, Any]) -> None:
    """Marks a state on the way as not expanded, and another one in its place."""
    other = next(state for state in reversed(search["states"]) if not state["expanded"])
    search["states"][search["way"][1]]["expanded"], other["expanded"] = False, True


CHANGES: dict[str, Callable[[Plan], Any]] = {
    "nominal ends elsewhere": lambda p: _last(p["nominal"]["nodes"], [0.0, 0.0, -0.029, 0.0, 0.0, 0.0]),
    "nominal times": lambda p: p["nominal"]["times"].__setitem__(0, 1e-3),
    "interval missing": lambda p: p["nominal"]["intervals"].pop(0),
    "interval of no length": lambda p: p["nominal"]["intervals"].insert(0, {**p["nominal"]["intervals"][0], "t1": 0.0}),
    "freedom of an interval": lambda p: p["nominal"]["intervals"][0].update(s=[1, 0, 0, 0, 0, 0]),
    "position row missing": lambda p: p["position_force"].pop(),
    "position row reversed": lambda p: p["position_force"][0].update(pa_start=p["position_force"][0]["pa_end"]),
    "reaction reversed": lambda p: p["position_force"][-1].update(fa=[-x for x in p["position_force"][-1]["fa"]]),
    "reaction on a free axis": lambda p: p["position_force"][0]["fa"].__setitem__(2, 5.0),
    "reaction too large": lambda p: p["position_force"][-1]["fa"].__setitem__(0, 1e3),
    "wrench applied the wrong way": lambda p: p["position_force"][-1].update(applied=p["position_force"][-1]["fa"]),
    "natural constraint elsewhere": lambda p: p["position_force"][-1]["pn_end"].__setitem__(0, 1e-3),
    "move without a name": lambda p: p["search"]["moves"].pop(),
    "move of another name": lambda p: p["search"]["moves"].__setitem__(1, "+x"),
    "another heading": lambda p: p["search"].update(heading=2.0),
    "state expanded that was not": lambda p: p["search"]["states"][-1].update(expanded=True),
    "way from the middle": lambda p: p["search"]["way"].pop(0),
    "way without its last state": lambda p: p["search"]["way"].pop(),
    "state from one that was not expanded": lambda p: _unexpanded(p["search"]),
    "states confirmed": lambda p: p["critical_points"][0].update(states_confirmed=0),
    "verdict of its own": lambda p: p.update(verdict="NOT_PROVED"),
    "start left out": lambda p: p["diagnostics"]["sequence"].pop(0),
    "sequence turned round": lambda p: p["diagnostics"]["sequence"].reverse(),
    "contact made elsewhere": lambda p: p["diagnostics"]["sequence"][1].update(segment=0),
    "contact that is not made": lambda p: p["diagnostics"]["sequence"][1].update(change="passed"),
    "state of another name": lambda p: p["diagnostics"]["sequence"][1]["in"][0].update(state="free"),
    "state of other contacts": lambda p: p["diagnostics"]["sequence"][2]["contacts"].pop(),
    "graph left out": lambda p: p["diagnostics"]["graphs"].pop(),
    "another critical point": lambda p: p["segments"][5].update(critical_point=0),
    "errors tolerated": lambda p: p["diagnostics"]["tolerated"].update(factor=9.0),
    "certified for a share": lambda p: p["diagnostics"].update(
        reduced={"share": 1.0, "stated_start_box": p["uncertainty"]["start_box"], "short": "no time"}
    ),
    "either sign": lambda p: p["position_force"][-1].update(either_sign=[]),
    "critical point that is none": lambda p: p["segments"][0].update(critical_point=99),
    "lower bound above the cost": lambda p: p["search"].update(lower_bound=p["search"]["cost"] + 1.0),
    "gap": lambda p: p["search"].update(gap=p["search"]["gap"] + 0.5),
    "clearance of one part": lambda p: p["parts"]["moving"].update(measured_clearance=1.0),
    "specified force": lambda p: p["specification"].update(contact_force=1.0),
    "specified torque": lambda p: p["specification"].update(torque_limit=1e-3),
    "friction": lambda p: p["specification"].update(friction=0.9),
}


@pytest.mark.parametrize("name", CHANGES)
def test_changes_beside_the_segments_are_noticed(name: str, square_peg_plan: Plan) -> None:
    verdict = verify(changed(square_peg_plan, CHANGES[name]))
    assert verdict.verdict == NOT_PROVED
    assert all("sha256" not in finding.what for finding in verdict.findings)


def test_what_held_contacts_stay_closed_under_is_derived(square_peg_plan: Plan) -> None:
    """Where a held contact opens as the next one is felt, a plan must not say that it stays closed under more."""
    weaker = {"push": "stop", "stop": "none"}
    for k, segment in enumerate(square_peg_plan["segments"]):
        stays = segment["hybrid"]["stays"]
        if stays in weaker and segment["hybrid"]["termination"]["contacts"]:
            claim = changed(square_peg_plan, lambda p, k=k, s=stays: p["segments"][k]["hybrid"].update(stays=weaker[s]))
            assert verify(claim).verdict == CERTIFIED
            break
    refuted = 0
    for k in (k for k, s in enumerate(square_peg_plan["segments"]) if s["hybrid"]["stays"] != "push"):
        more = changed(square_peg_plan, lambda p, k=k: p["segments"][k]["hybrid"].update(stays="push"))
        found = verify(more).findings
        assert [(f.segment, f.what) for f in found] in ([], [(k, "stays")])
        refuted += len(found)
    assert refuted > 3


def test_a_plan_that_does_not_claim_it_is_not_certified(square_peg_plan: Plan) -> None:
    found = verify(changed(square_peg_plan, lambda p: p.update(verdict="NOT_PROVED")))
    assert (found.verdict, found.stated) == (NOT_PROVED, "NOT_PROVED")
    assert [f.what for f in found.findings] == ["verdict"]
    assert any("does not claim to be certified" in line for line in found.lines())


def test_rounding_in_the_wrench_that_ends_a_move_is_no_change(square_peg_plan: Plan) -> None:
    """Entries that cancel are rounding alone, and may be any small number."""
    (wrench, k) = next(
        (wrench, k)
        for segment in square_peg_plan["segments"]
        for wrench in [segment["hybrid"]["termination"]["wrench"]]
        for k in range(3)
        if abs(wrench[k]) < 1e-12 < max(map(abs, wrench))
    )
    number = next(
        n for n, s in enumerate(square_peg_plan["segments"]) if s["hybrid"]["termination"]["wrench"] is wrench
    )

    def moved(by: float) -> Plan:
        def change(plan: Plan) -> None:
            plan["segments"][number]["hybrid"]["termination"]["wrench"][k] += by

        return changed(square_peg_plan, change)

    assert verify(moved(1e-13)).verdict == CERTIFIED
    assert verify(moved(1e-8)).verdict == NOT_PROVED
