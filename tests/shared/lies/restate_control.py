"""Axes and contact lists of a control strategy, as the contacts of an altered plan ask for them."""

from typing import Any

import numpy as np

from fmopt.verify.certificate.chain import Stage
from fmopt.verify.parts.assembly import PartPair
from fmopt.verify.parts.reach import touching, unit_wrench
from fmopt.verify.parts.rows import pose

_RANK = 1e-6


def restated_axes(hybrid: dict[str, Any], assembly: PartPair, stage: Stage, rho: float) -> None:
    """Force axes that span the wrenches of the contacts pressed, position axes that span what these leave free.

    Both are orthonormal in the metric of ρ, in a frame at the part's reference point and along the axes of B.
    """
    goal = pose(stage.segment.goal)
    names = [item["contact"] for item in hybrid["normal_forces"]]
    wrenches = [unit_wrench(touch, goal).wrench for touch in stage.state if touch.id in names]
    scale = np.array([1.0, 1.0, 1.0, rho, rho, rho])
    # np.linalg.svd gives the directions that the contacts stop first, and then what is free.
    rows = np.array(wrenches).reshape(-1, 6) / scale
    _, sizes, axes = np.linalg.svd(rows, full_matrices=True) if len(rows) else (None, np.zeros(0), np.eye(6))
    rank = int((sizes > _RANK).sum())
    hybrid["frame"] = [*stage.segment.goal[:3], 0.0, 0.0, 0.0]
    hybrid["force_axes"] = (axes[:rank] * scale).tolist()
    hybrid["position_axes"] = (axes[rank:] / scale).tolist()
    hybrid.pop("jam_free", None)


def touching_names(hybrid: dict[str, Any], assembly: PartPair, stage: Stage) -> bool:
    """Lists the contacts that touch at the goal, held and made; whether that changes the lists."""
    goal = pose(stage.segment.goal)
    held = [t.id for t in stage.state if touching(assembly, t, goal) >= 0.0]
    new = [t for t in stage.goal_state if t.id not in stage.segment.state]
    made = [t.id for t in new if touching(assembly, t, goal) >= 0.0]
    forces = {item["contact"]: item["force"] for item in hybrid["normal_forces"]}
    pressed = [{"contact": name, "force": forces.get(name, 1.0)} for name in held]
    end = hybrid["termination"]
    if pressed == hybrid["normal_forces"] and made == end["contacts"]:
        return False
    hybrid["normal_forces"], end["contacts"] = pressed, made
    return True
