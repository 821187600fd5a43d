"""Where a point of the grasped object lies seen from the reference point: h and γ of [BasanezSuarez] eqs. (8), (9)."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fmopt.spatial.values import Array, frozen


@dataclass(frozen=True)
class Reach:
    """A point of the grasped object in polar form about the reference point of the gripper: h in m, γ at φ = 0 in rad.

    γ is in (−π, π], and 0 when h = 0, where there is no direction.
    """

    h: float
    gamma: float

    @staticmethod
    def of(point: ArrayLike) -> "Reach":
        """The polar form of a point (2,) in the gripper's frame, m."""
        x, y = frozen(point, 2, name="point of the grasped object")
        return Reach(math.hypot(x, y), math.atan2(y, x))

    @staticmethod
    def from_grasp(p_g: float, v: float, angle: float) -> "Reach":
        """The polar form of p_g + v (lengths, m), with γ counted from the direction of p_g; `angle` is φ_m + α, rad.

        h = √(p_g² + v² + 2 p_g v cos(φ_m + α)); γ = atan2(v sin(φ_m + α), p_g + v cos(φ_m + α)), where eq. (9) has an
        arcsin and loses half of the plane.
        """
        return Reach.of((p_g + v * math.cos(angle), v * math.sin(angle)))

    def point(self, phi: float) -> Array:
        """The point (2,) relative to the reference point, at gripper angle φ (rad)."""
        return self.h * np.array([math.cos(phi + self.gamma), math.sin(phi + self.gamma)])
