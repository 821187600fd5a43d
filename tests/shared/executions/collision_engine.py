"""Executions of a plan seen by another collision engine: MuJoCo's distances between the pieces of a plan file."""

from typing import Any

import numpy as np

from fmopt.execution.engines.scene import engine
from tests.shared.executions.geometry import Array, Convex, Poses, Scene
from tests.shared.executions.model import Piece

mujoco = engine()  # with the settings for drawing that the package makes before the library is first imported

TOUCH = 1e-7  # m; what the engine's single precision and its iterations leave
SAME = 1e-9
_SCALE = 1e3  # the engine works in millimetres, its tolerances are absolute
_FAR = 1e6


class Engine:
    """Watches the poses of executions of a plan's document."""

    def __init__(self, plan: dict[str, Any]) -> None:
        self.scene = Scene(plan)
        self.model, self.data = _compiled(self.scene)
        self.pairs = [(i, j) for i in range(len(self.scene.moving)) for j in range(len(self.scene.fixed))]
        self.bearing = {name: self._bearing(name) for name in self.scene.touches}
        self.deepest, self.seen = 0.0, 0  # greatest penetration, m, and number of distances looked at
        self.wrong: set[str] = set()  # what contradicts the plan, in words

    def watch(self, piece: Piece, poses: Poses, last: bool) -> None:
        """Compares the distances at poses of a piece with what the plan says of them; `last` where a move ends."""
        said = piece.said
        held = said["goal_state"] if last else said["state"]
        margins = {(s["moving_piece"], s["fixed_piece"]): s["margin"] for s in said["separations"]}
        listed = {*said["state"], *said["goal_state"], *said.get("leaving", ())}
        touched = {pair for name in listed for pair in self.bearing[name]}
        for p, R in zip(*poses, strict=True):
            distance = self.distances(p, R)
            self.seen += len(distance)
            self.deepest = max(self.deepest, -min(distance.values()))
            for pair, d in distance.items():
                if d < -TOUCH:
                    self.wrong.add(f"segment {piece.number}: pieces {pair} overlap")
                if pair not in touched and d < margins[pair] - TOUCH:
                    self.wrong.add(f"segment {piece.number}: pieces {pair} nearer than their margin")
            for name in held:
                if min(distance[pair] for pair in self.bearing[name]) > TOUCH:
                    self.wrong.add(f"segment {piece.number}: {name} is not touched")

    def distances(self, p: Array, R: Array) -> dict[tuple[int, int], float]:
        """Signed distances of all pairs of pieces at a pose, m."""
        self.data.mocap_pos[0] = _SCALE * p
        mujoco.mju_mat2Quat(self.data.mocap_quat[0], R.ravel())
        mujoco.mj_kinematics(self.model, self.data)
        # The geometries of the world come first.
        count = len(self.scene.fixed)
        apart = mujoco.mj_geomDistance
        return {(i, j): apart(self.model, self.data, count + i, j, _FAR, None) / _SCALE for i, j in self.pairs}

    def _bearing(self, name: str) -> list[tuple[int, int]]:
        """The pairs of pieces that a contact may touch: on planes or lines of the part, its features are theirs."""
        scene = self.scene
        own, other = scene.corners[name]
        moving, fixed = scene.body[own], scene.points[other]
        return [(i, j) for i, j in self.pairs if _carries(scene.moving[i], moving) and _carries(scene.fixed[j], fixed)]


def _carries(piece: Convex, points: Array) -> bool:
    """Whether a vertex, an edge's line or a face's plane of a part is one of a piece."""
    if len(points) == 1:
        return bool((np.linalg.norm(piece.vertices - points[0], axis=1) <= SAME).any())
    if len(points) == 2:
        along = (points[1] - points[0]) / np.linalg.norm(points[1] - points[0])
        off = np.linalg.norm(np.cross(piece.vertices - points[0], along), axis=1)
        return int((off <= SAME).sum()) == 2
    return bool((np.abs(points @ piece.outward[:, :3].T - piece.outward[:, 3]) <= SAME).all(axis=0).any())


def _compiled(scene: Scene) -> tuple[Any, Any]:
    spec = mujoco.MjSpec()
    spec.option.ccd_tolerance, spec.option.ccd_iterations = 1e-10, 200
    body = spec.worldbody.add_body(name="moving", mocap=True)
    for kind, where, pieces in (("fixed", spec.worldbody, scene.fixed), ("moving", body, scene.moving)):
        for k, piece in enumerate(pieces):
            name = f"{kind}{k}"
            spec.add_mesh(name=name).uservert = (_SCALE * piece.vertices).ravel().tolist()
            where.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, contype=0, conaffinity=0)
    model = spec.compile()
    return model, mujoco.MjData(model)
