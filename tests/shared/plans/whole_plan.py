"""The small plan built by hand with all that a plan may tell besides, for tests of its reader: every key is there."""

import copy
from collections.abc import Iterator
from typing import Any

from tests.shared.plans.table_plan import sealed, table_plan

ZERO = [0.0] * 6
WRONG: tuple[Any, ...] = (
    None, True, "", "x", "\u00b2", -1, 0, 7, 2**70, 10**400, 0.5, -0.0, 1e308, -1e-308, float("nan"), float("inf"),
    [], {}, [[]], [0.0] * 6, [{}], {"x": 1}, "\ud800", "a\nb", "\x1b[31m", "\u202e", b"x",
)  # fmt: skip
Place = tuple[Any, ...]


def whole_plan() -> dict[str, Any]:
    """A plan that the reader takes and the check need not pass."""
    plan = table_plan()
    moves = sorted({segment["move"] for segment in plan["segments"]})
    row = dict.fromkeys(("pa_start", "pa_end", "pn_start", "pn_end", "fa"), ZERO)
    span = {"start": 0.0, "end": 1.0, "s": [0, 0, 0, 0, 0, 0]}
    state = {"contacts": [], "freedoms": 0, "margin": 1e-4, "expanded": True}
    told: dict[str, Any] = {
        "description": {
            "nominal": {"nodes": [ZERO, plan["goal"]], "times": [0.0, 1.0], "intervals": [span]},
            "position_force": [{**span, **row}],
            "critical_points": [
                {
                    "name": "mouth",
                    "pose": ZERO,
                    "contacts": ["v0-f5"],
                    "enumerated": True,
                    "states_by_dimension": {"5": 1, "6": 1},
                    "states_by_verdict": {"confirmed": 2, "blocked": 0, "out_of_bounds": 0, "split": 0, "undecided": 0},
                }
            ],
            "places": [0] * len(plan["segments"]),
            "search": {
                "objective": "transitions", "cost": 2.0, "lower_bound": 1.0, "states_expanded": 3,
                "moves": ["approach", "-z", "+x"], "heading": 0.0, "way": [0, 1, 2],
                "states": [
                    {**state, "moves": ["approach"], "cost": 0.0},
                    {**state, "origin": 0, "moves": ["-z"]},
                    {**state, "origin": 1, "moves": ["+x"], "contacts": ["v0-f5"], "freedoms": 1},
                ],
            },
        },
        "recovery": {
            "lift": {"direction": [0.0, 0.0, 1.0], "above": -0.05, "clear": 0.1, "turn": 0.5},
            "why": "",
            "retries": [[1e-3, *ZERO[1:]]],
            "covers": plan["uncertainty"]["start_box"],
            "moves": [
                {"move": move, "back_off": True, "room": 0.01, "order": {"early": [0], "late": [0]}}
                for move in moves
            ],
            "not_covered": ["friction against the lift"],
        },
    }  # fmt: skip
    segments = [dict(segment) for segment in plan["segments"]]
    free = {"push": 1.0, "least_push": 2.0, "angle": 0.1, "planes": [{"towards": "push", "angles": [0.1, 0.2]}]}
    impact = {"approach": 0.5, "force": 1.0}
    hybrid = {**segments[0]["hybrid"], "jam_free": {**free, "twists": [ZERO]}, "impact": impact}
    segments[0] = {**segments[0], "hybrid": hybrid, "leaving": []}
    limits = {"impact_force": 10.0, "apparent_mass": 2.0, "contact_stiffness": 1e5}
    specification = {**plan["specification"], **limits}
    box = plan["uncertainty"]["start_box"]
    uncertainty = {**plan["uncertainty"], "sources": [{"frame": "world", "box": box}]}
    fixed = {**plan["parts"]["fixed"], "exact": [{"vertex": 0, "at": ["-1/20", "-1/20", "-1/50"]}]}
    fixed["found"] = {"side": "fixed", "feature": "hole", "frame": ZERO}
    moving = plan["parts"]["moving"]
    ball = {"vertex": len(moving["vertices"]), "radius": 0.001}
    moving = {**moving, "vertices": [*moving["vertices"], [0.0, 0.0, 0.01]], "balls": [ball]}
    moving["form"] = 1e-6
    told["parts"] = {"moving": moving, "fixed": fixed}
    whole = {"segments": segments, "specification": specification, "uncertainty": uncertainty}
    return sealed({**plan, **told, **whole})


def places(value: Any, place: Place = ()) -> Iterator[tuple[Place, Any]]:
    """Every place of a document with what stands there, of lists the first and the last entry alone."""
    yield place, value
    if isinstance(value, dict):
        for key in value:
            yield from places(value[key], (*place, key))
    elif isinstance(value, list):
        for k in sorted({0, len(value) - 1} if value else ()):
            yield from places(value[k], (*place, k))


def put(document: dict[str, Any], place: Place, value: Any) -> dict[str, Any]:
    """A copy with another value at a place."""
    changed = dict(document)
    at: Any = changed
    for key in place[:-1]:
        at[key] = copy.copy(at[key])
        at = at[key]
    at[place[-1]] = value
    return changed
