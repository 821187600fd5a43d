"""A plan small enough to read: a cube comes down beside a wall and slides against it."""

import copy
from typing import Any

from fmopt.plan import FORMAT, FRAMES, NOT_COVERED, UNITS, Plan, parsed, sealed

TUBE = {"theta_max": 1e-3, "offset_box": [2e-4] * 3, "angle_box": [1e-3] * 3}


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> dict[str, Any]:
    """A cuboid as a plan holds it, mm in, m out."""
    vertices = [[0.001 * (low, high)[(i >> k) & 1][k] for k in range(3)] for i in range(8)]
    faces = [[[0, 4, 6, 2]], [[1, 3, 7, 5]], [[0, 1, 5, 4]], [[2, 6, 7, 3]], [[0, 2, 3, 1]], [[4, 5, 7, 6]]]
    return {"vertices": vertices, "faces": faces}


def bracket() -> dict[str, Any]:
    """A floor z = 0 with a wall x = −5.1 mm, 40 mm along y."""
    profile = [(-15, -10), (15, -10), (15, 0), (-5.1, 0), (-5.1, 20), (-15, 20)]
    vertices = [[0.001 * x, 0.001 * y, 0.001 * z] for y in (-20, 20) for x, z in profile]
    sides = [[[(k + 1) % 6, k, k + 6, (k + 1) % 6 + 6]] for k in range(6)]
    pieces = [box((-15, -20, -10), (15, 20, 0)), box((-15, -20, 0), (-5.1, 20, 20))]
    return {"vertices": vertices, "faces": [[[0, 1, 2, 3, 4, 5]], [[11, 10, 9, 8, 7, 6]], *sides], "pieces": pieces}


def segment(move: int, start: list[float], goal: list[float], **more: Any) -> dict[str, Any]:
    return {
        "kind": "guarded_move",
        "move": move,
        "state": [],
        "goal_state": [],
        "progress": [0.0, 1.0],
        "start": start,
        "goal": goal,
        "clearance": 3e-4,
        "margin": 1e-4,
        "binding_contact": "pieces 0/1",
        "basis": [],
        "tube": TUBE,
        "separations": [],
        "contacts": [],
        "hybrid": hybrid(),
        **more,
    }


def hybrid() -> dict[str, Any]:
    return {
        "push": 5.0,
        "stays": "none",
        "normal_forces": [],
        "frame": [0.0] * 6,
        "position_axes": [[0, 1, 0, 0, 0, 0]],
        "force_axes": [[1, 0, 0, 0, 0, 0]],
        "velocity": [-1, 0, 0, 0, 0, 0],
        "speed": 0.02,
        "bias_wrench": [-5, 0, 0, 0, 0.1, 0],
        "termination": {
            "contacts": ["v0-f5"],
            "wrench": [1, 0, 0, 0, 0, 0],
            "threshold": 2.0,
            "max_travel": 0.0013,
            "timeout": 3.0,
        },
    }


def diagnostics(**more: Any) -> dict[str, Any]:
    """What a plan tells of how it was found, nothing of it filled in but the clearance and what is given."""
    empty: dict[str, Any] = {key: [] for key in ("graphs", "sequence", "diagrams", "freedom_on_planes", "budget")}
    return {**empty, "measured_clearance": [1e-4, 1e-4], **more}


def description(diagnostics: dict[str, Any] | None) -> dict[str, Any]:
    """The description of the plan."""
    zero = [0.0] * 6
    found: dict[str, Any] = {
        "nominal": {
            "nodes": [[0, 0, 0.003, 0, 0, 0], zero],
            "times": [0, 1],
            "intervals": [
                {"start": 0, "end": 1, "s": [-1, 0, 1, 2, 0, 0]},
                {"start": 1, "end": 1, "s": [2, 0, -1, 2, 2, 2]},
            ],
        },
        "critical_points": [
            {"name": "mouth", "pose": zero, "contacts": ["v0-f5"], "enumerated": True}
            | {"states_by_dimension": {"6": 1, "5": 2}}
            | {"states_by_verdict": {"confirmed": 1, "blocked": 1, "out_of_bounds": 0, "split": 0, "undecided": 1}}
        ],
        "places": [0, 0, 0],
        "position_force": [
            {"start": 0, "end": 1, "s": [-1, 0, 1, 2, 0, 0], "pa_start": zero, "pa_end": zero}
            | {"pn_start": [0, 0, 0.003, 0, 0, 0], "pn_end": zero, "fa": [5, 0, -5, 0.1, 0, 0]}
        ],
        "search": {"objective": "transitions", "cost": 1.0, "lower_bound": 1.0, "states_expanded": 2}
        | {"moves": ["approach", "-x"], "heading": 0.0},
    }
    return found if diagnostics is None else {**found, "diagnostics": diagnostics}


def cube_plan(
    verdict: str = "CERTIFIED", margin: float = 4.2e-5, diagnostics: dict[str, Any] | None = None, **more: Any
) -> dict[str, Any]:
    """The plan, sealed; `margin` is that of the last piece."""
    still = {**hybrid(), "termination": {**hybrid()["termination"], "contacts": [], "wrench": [0.0] * 6}}
    down = segment(0, [0.001, 0, 0.003, 0, 0, 0], [0.001, 0, 0.001, 0, 0, 0], hybrid=still)
    made = {"goal_state": ["v0-f5"], "basis": [{"contact": "v0-f5", "direction": [-1, 0, 0, 0, 0, 0], "made": True}]}
    near = segment(1, down["goal"], [0.0005, 0, 0.001, 0, 0.002, 0], progress=[0.0, 0.5], **made)
    last = [-0.0001, 0, 0.001, 0, 0.004, 0]
    touch = segment(1, near["goal"], last, progress=[0.5, 1.0], margin=margin, **made)
    clearance = {"declared_clearance": [1e-4, 1e-4], "measured_clearance": 1e-4}
    cube = box((-5, -5, 0), (5, 5, 10))
    plan = {
        "format": FORMAT,
        "fmopt_version": "0.0",
        "problem": {"title": "cube to a wall", "sha256": "0" * 64},
        "units": UNITS,
        "frames": FRAMES,
        "verdict": verdict,
        "parts": {
            "moving": {"name": "cube", **cube, "pieces": [cube], **clearance},
            "fixed": {"name": "bracket", **bracket(), **clearance},
        },
        "contacts": [
            {"id": "v0-f5", "kind": "vertex-face", "moving": {"vertices": [0]}, "fixed": {"vertices": [4, 3, 9, 10]}}
        ],
        "segments": [down, near, touch],
        "description": description(diagnostics),
        "specification": {"speed": 0.02, "contact_force": 5.0, "torque_limit": 1.0, "friction": 0.3}
        | {"termination_force": 2.0},
        "touch_tolerance": 1e-9,
        "uncertainty": {"start_box": [3e-4, 3e-4, 0, 0, 0, 0.005], "velocity_error": [0.01, 0.02], "rho": 0.01},
        "goal": last,
        "not_covered": list(NOT_COVERED),
        **more,
    }
    return sealed(plan)


def bare_plan() -> dict[str, Any]:
    """A plan that tells nothing but its motion."""
    plan = cube_plan("NOT_PROVED")
    del plan["description"]
    return sealed(plan)


def altered(value: Any, /, **changes: Any) -> Any:
    """A copy of a value with other fields, whatever its validation would say of them."""
    found = copy.copy(value)
    for name, change in changes.items():
        object.__setattr__(found, name, change)
    return found


def cube(verdict: str = "CERTIFIED", margin: float = 4.2e-5, **more: Any) -> Plan:
    """The plan as values."""
    return parsed(cube_plan(verdict, margin, **more))


def with_graph() -> dict[str, Any]:
    """The plan with a contact graph of four states."""
    states = [
        {"id": "free", "contacts": [], "dimension": 6},
        {"id": "s1", "contacts": ["v0-f5"], "dimension": 5},
        {"id": "s2", "contacts": ["v0-f4"], "dimension": 5},
        {"id": "s3", "contacts": ["v0-f5", "v0-f4"], "dimension": 4},
    ]
    graph = {"critical_point": "mouth", "states": states, "sons": [[1, 2], [3], [3], []], "chosen": [0, 1]}
    graph["verdicts"] = ["confirmed"] * 4
    budget = [{"source": "robot", "symbol": "", "frame": "hole", "box": [1e-4] * 6}]
    return cube_plan(diagnostics=diagnostics(graphs=[graph], budget=budget))
