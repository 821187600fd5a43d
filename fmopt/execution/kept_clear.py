"""How near parts and the solids around them come in trials, by distances between convex bodies.

The solids push nothing: a trial in which they come near fails, and the part goes on as if they were not there.
"""

import numpy as np

from fmopt.execution.engines.engine import Bodies
from fmopt.execution.engines.physics import Physics
from fmopt.execution.engines.scene import compiled, engine, scene
from fmopt.execution.press_servo import Ints
from fmopt.plan.evidence import TOUCH
from fmopt.plan.press import Surroundings
from fmopt.spatial.values import Array

_FAR = 1.0  # m, the greatest distance that is measured
_STALE = 0.05  # of a distance, by which a body may move before it is measured anew
_LEAST_STALE = 1e-5  # m, likewise


class KeptClear:
    """Least distances of n bodies from all that they are kept clear of, over the poses (n, 7) that they are seen in.

    Attributes:
        least: (n,), m, bounds from below.
        nearest: the two solids of each body in words.
        reach: of the farthest corner from the reference point, m.
    """

    def __init__(self, bodies: Bodies, cell: Surroundings, poses: Array) -> None:
        library = engine()
        self._model = compiled(scene(bodies, Physics(), 1.0, 1.0, 0.3, cell))
        self._data, self._kinematics = library.MjData(self._model), library.mj_kinematics
        self._measure = library.mj_geomDistance
        names = [self._model.geom(k).name for k in range(self._model.ngeom)]
        self._words = [_solid(name) for name in names]
        own = [k for k in range(len(names)) if self._model.geom_bodyid[k]]
        pairs = [(a, b) for a in own for b in range(len(names)) if b not in own and "_" in names[a] + names[b]]
        self._pairs = np.array(pairs)
        corners = np.vstack([*bodies.moving, *(np.vstack(solid.pieces) for solid in cell.moving)])
        reach = [np.linalg.norm(corners, axis=1).max(), *(np.linalg.norm(at) + r for at, r in bodies.balls)]
        self.reach = float(max(reach))
        count = len(poses)
        self.least, self.nearest = np.full(count, _FAR), [""] * count
        self._at, self._last, self._between = np.full((count, 7), np.inf), np.zeros(count), [""] * count
        self.see(poses, np.arange(count))

    def measured(self, pose: Array) -> tuple[float, str]:
        """The least distance at a pose (7,), m, and between which solids."""
        self._data.qpos[:] = pose
        self._kinematics(self._model, self._data)
        (a, b), at, spheres = self._pairs.T, self._data.geom_xpos, self._model.geom_rbound
        bounds = np.linalg.norm(at[a] - at[b], axis=1) - spheres[a] - spheres[b]
        least, nearest = _FAR, ""
        for k in np.argsort(bounds):
            if bounds[k] >= least:
                break
            distance = self._measure(self._model, self._data, a[k], b[k], least, None)
            if distance < least:
                least, nearest = distance, f"{self._words[a[k]]} and {self._words[b[k]]}"
        return least, nearest

    def see(self, poses: Array, active: Ints) -> None:
        """Bounds the distances of some bodies at their poses, measuring anew where these could be the least so far."""
        now = poses[active]
        turned = np.minimum(*(np.linalg.norm(now[:, 3:] - s * self._at[active, 3:], axis=1) for s in (1.0, -1.0)))
        # No point moves farther: a turn by an angle θ moves quaternions by 2 sin(θ/4).
        moved = np.linalg.norm(now[:, :3] - self._at[active, :3], axis=1) + 2.0 * self.reach * turned
        bound, least = self._last[active] - moved, self.least[active]
        stale = moved > np.maximum(_STALE * self._last[active], _LEAST_STALE)
        near = (bound < least) & (least > TOUCH)
        for k in np.flatnonzero(stale & near).tolist():
            bound[k], self._between[active[k]] = self.measured(now[k])
            self._last[active[k]], self._at[active[k]] = bound[k], now[k]
        for k in np.flatnonzero(near & (bound < least)).tolist():
            self.least[active[k]], self.nearest[active[k]] = bound[k], self._between[active[k]]


def _solid(geom: str) -> str:
    """The solid that a geom of the scene is a piece of."""
    if "_" in geom:
        return geom.partition("_")[2].rpartition("_")[0]
    return "the fixed part" if geom.startswith("fixed") else "the moving part"
