"""What is the same in every plan file: the format's name, its units and frames, and what no plan covers."""

from __future__ import annotations

FORMAT = "fmopt.plan/1"
UNITS = {"length": "m", "angle": "rad", "force": "N", "torque": "N m", "time": "s"}
FRAMES = {
    "B": "body frame of the fixed hollow feature: origin at the centre of its mouth, z out of the hole",
    "moving": "origin at the centre of the leading face of the moving feature, z back into the part",
    "pose": "(x, y, z, r): origin of the moving frame in B, and the rotation vector r",
    "error": "(e, eps) about a nominal pose (p, R): the real pose is p + e, exp([eps]x) R",
    "wrench": "(force, torque about the moving frame's origin), in axes of B",
}
NOT_COVERED = (
    "friction, jamming and wedging beyond the choice of bias wrenches",
    "compliance and dynamics of the robot: that held contacts stay held under the bias wrench",
    "shape and size deviations of the parts other than those in the stated errors",
    "whether the real errors lie in the stated set, each fixed in the frame that is stated of it, apart from the "
    "velocity error",
)
FIXED_IN = ("hole", "hand", "world")  # of errors, in the order of their generators
VERDICTS = ("CERTIFIED", "NOT_PROVED", "REFUTED")

Numbers = tuple[float, ...]


class PlanError(ValueError):
    """A document that is no plan: says where in it, and what is wrong."""

    def __init__(self, path: str, message: str) -> None:
        super().__init__(f"{path or 'plan'}: {message}")
        self.path = path
        self.message = message

    def __reduce__(self) -> tuple[type[PlanError], tuple[str, str]]:
        return type(self), (self.path, self.message)
