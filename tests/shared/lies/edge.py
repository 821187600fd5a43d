"""A plan whose claim needs a face to lie flat that need not, and the lie that says it does."""

import copy
import functools
import json
from random import Random

from fmopt.plan import NOT_COVERED
from tests.shared.lies.lie import CONSTRUCTION, Document, Lie, drawn
from tests.shared.plans.table_plan import Builder, sealed, table_plan, touching_pose


@functools.cache
def _edge_plan() -> str:
    return json.dumps(_on_an_edge())


def edge_plan() -> Document:
    """The plan of `_on_an_edge`, a new copy of it."""
    found: Document = json.loads(_edge_plan())
    return found


def _on_an_edge() -> Document:
    """A cube comes down with one edge, turns until another vertex of it touches, and is laid almost flat.

    What is left unknown is the turn about the edge: the two other corners below may be inside the table.
    """
    plan = table_plan()
    first, make, hold = plan["segments"][0], plan["segments"][1], plan["segments"][3]
    poses = [touching_pose(Builder(), 0.0, 0.0, (0.02, -0.02, 0.0))]
    poses.append(_on_edge(0.02))
    poses.append(_on_edge(0.002))
    above = [*poses[0][:2], poses[0][2] + 0.003, *poses[0][3:]]
    far = [0.001, 0.001, above[2] + 0.002, *above[3:]]
    plan["uncertainty"].update(start_box=[3e-4, 3e-4, 2e-4, 3e-3, 3e-3, 3e-3], velocity_error=[1e-3, 1e-3])
    plan["contacts"] = [
        {"id": f"v{k}-f5", "kind": "vertex-face", "moving": {"vertices": [k]}, "fixed": {"vertices": [1, 5, 7, 3]}}
        for k in (0, 2)
    ]
    plan["segments"] = [
        _as(first, 0, (far, above), [], ""),
        _as(make, 1, (above, poses[0]), [], "v0-f5"),
        _as(make, 2, (poses[0], poses[1]), ["v0-f5"], "v2-f5"),
        _as(hold, 3, (poses[1], poses[2]), ["v0-f5", "v2-f5"], ""),
    ]
    plan["goal"] = poses[2]
    plan["not_covered"] = list(NOT_COVERED)
    return sealed(plan)


def _on_edge(tilt: float) -> list[float]:
    """The cube with its edge x = −10 mm on the table, the others above by its tilt."""
    builder = Builder()
    builder.lowest = 0
    return touching_pose(builder, 0.0, 0.0, (0.0, -tilt, 0.0))


def _as(like: Document, move: int, poses: tuple[list[float], list[float]], state: list[str], made: str) -> Document:
    """A segment of another motion that makes a contact, or none, ""; its numbers are still to be derived."""
    start, goal = poses
    after = [*state, made] if made else state
    like = copy.deepcopy(like)
    basis = [{"contact": name, "direction": [0.0, 0.0, 1.0, 0.0, 0.0, 0.0], "made": False} for name in state]
    if made:
        basis.append({"contact": made, "direction": [0.0, 0.0, -1.0, 0.0, 0.0, 0.0], "made": True})
    end = {**like["hybrid"]["termination"], "contacts": [made] if made else []}
    forces = [{"contact": name, "force": 1.0} for name in state]
    push = 12.0 if made else 0.0
    control = {**like["hybrid"], "termination": end, "normal_forces": forces, "push": push, "frame": [*goal]}
    face = {"kind": "fixed-face", "moving": [], "fixed": [1, 5, 7, 3]}
    return {
        **like, "move": move, "progress": [0.0, 1.0], "start": list(start), "goal": list(goal), "state": list(state),
        "goal_state": list(after), "basis": basis, "hybrid": control,
        "separations": [{"moving_piece": 0, "fixed_piece": j, "witness": dict(face), "margin": 0.0} for j in (0, 1)],
    }  # fmt: skip


def turned_line(plan: Document, rng: Random) -> bool:
    """A vertex next to one that touches, which makes a plane of a line that lies in the table."""
    moving = plan["parts"]["moving"]
    used = rng.random() < 0.5
    along, off = (drawn(rng, -10.0, -9.75), 3e-14) if used else (drawn(rng, -9.6, -9.1), drawn(rng, -12.3, -11.1))
    x, y, z = moving["vertices"][0]
    moving["vertices"].append([x + off, y + along, z])
    if used:
        new = len(moving["vertices"]) - 1
        for face in moving["faces"]:
            loop = face[0]
            for edge in ((0, 2), (2, 0)):
                k = loop.index(edge[0]) if edge[0] in loop else -1
                if k >= 0 and loop[(k + 1) % len(loop)] == edge[1]:
                    loop.insert(k + 1, new)
    return True


def nothing_known(plan: Document, rng: Random) -> bool:
    """The motion as it is: the two corners are not known to stay above the table."""
    return True


LIES = (
    Lie("turned line", CONSTRUCTION, turned_line, base=edge_plan),
    Lie("nothing known", CONSTRUCTION, nothing_known, base=edge_plan),
)
