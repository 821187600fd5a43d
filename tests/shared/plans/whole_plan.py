"""The small plan built by hand with all that a plan may tell besides, for tests of its reader: every key is there."""

from __future__ import annotations

from typing import Any

from tests.shared.plans.table_plan import sealed, table_plan

ZERO = [0.0] * 6


def whole_plan() -> dict[str, Any]:
    """A plan that the reader takes and the check need not pass."""
    plan = table_plan()
    moves = sorted({segment["move"] for segment in plan["segments"]})
    contact = {"kind": "vertex-face", "moving": {"vertices": [0]}, "fixed": {"vertices": [1, 5, 7, 3]}}
    first = {**contact, "factor": 2.0, "axis": "x", "axis_factor": 3.0, "wrench": ZERO, "angle": 0.5, "told": True}
    nowhere = {**first, "axis": "", "axis_factor": None, "angle": None}
    row = dict.fromkeys(("pa_start", "pa_end", "pn_start", "pn_end", "fa", "applied"), ZERO)
    span = {"t0": 0.0, "t1": 1.0, "s": [0, 0, 0, 0, 0, 0]}
    state = {"contacts": [], "freedoms": 0, "cost": None, "margin": 1e-4, "expanded": True}
    told: dict[str, Any] = {
        "nominal": {"nodes": [ZERO, plan["goal"]], "times": [0.0, 1.0], "intervals": [span]},
        "position_force": [{**span, **row, "fa_sign": "reaction", "either_sign": []}],
        "critical_points": [
            {
                "name": "mouth",
                "pose": ZERO,
                "pcs": ["v0-f5"],
                "enumerated": True,
                "states_by_dimension": {"5": 1, "6": 1},
                "states_confirmed": 2,
                "states_by_verdict": {"confirmed": 2, "blocked": 0, "out_of_bounds": 0, "split": 0, "undecided": 0},
            }
        ],
        "search": {
            "objective": "transitions", "cost": 2.0, "lower_bound": 1.0, "gap": 1.0, "states_expanded": 3,
            "moves": ["approach", "-z", "+x"], "heading": 0.0, "way": [0, 1, 2],
            "states": [
                {**state, "from": None, "moves": ["approach"], "cost": 0.0},
                {**state, "from": 0, "moves": ["-z"]},
                {**state, "from": 1, "moves": ["+x"], "contacts": ["v0-f5"], "freedoms": 1},
            ],
        },
        "recovery": {
            "lift": {"direction": [0.0, 0.0, 1.0], "above": -0.05, "clear": 0.1, "turn": 0.5},
            "why": "",
            "retries": [[1e-3, *ZERO[1:]]],
            "covers": plan["uncertainty"]["start_box"],
            "moves": [
                {
                    "move": move, "back_off": True, "room": 0.01, "first": [first, nowhere],
                    "order": {"early": [0], "late": [0]},
                }
                for move in moves
            ],
            "not_covered": ["friction against the lift"],
        },
    }  # fmt: skip
    segments = [dict(segment) for segment in plan["segments"]]
    free = {"push": 1.0, "least_push": 2.0, "angle": 0.1, "planes": [{"towards": "push", "angles": [0.1, 0.2]}]}
    hybrid = {
        **segments[0]["hybrid"],
        "jam_free": {**free, "twists": [ZERO]},
        "impact": {"approach": 0.5, "force": 1.0},
    }
    segments[0] = {**segments[0], "hybrid": hybrid, "leaving": []}
    limits = {"impact_force": 10.0, "apparent_mass": 2.0, "contact_stiffness": 1e5}
    specification = {**plan["specification"], **limits}
    box = plan["uncertainty"]["start_box"]
    uncertainty = {**plan["uncertainty"], "sources": [{"frame": "world", "box": box}]}
    fixed = {**plan["parts"]["fixed"], "exact": [{"vertex": 0, "at": ["-1/20", "-1/20", "-1/50"]}]}
    fixed["found"] = {"side": "fixed", "feature": "hole", "frame": ZERO, "turn": 0.0}
    moving = plan["parts"]["moving"]
    ball = {"vertex": len(moving["vertices"]), "radius": 0.001}
    moving = {**moving, "vertices": [*moving["vertices"], [0.0, 0.0, 0.01]], "balls": [ball]}
    moving["form"] = 1e-6
    told["parts"] = {"moving": moving, "fixed": fixed}
    whole = {"segments": segments, "specification": specification, "uncertainty": uncertainty}
    return sealed({**plan, **told, **whole})
