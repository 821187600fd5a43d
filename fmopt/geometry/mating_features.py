"""Mating features of a part: solid ones (pegs) and hollow ones (holes), each with a frame where it mates."""

import math
from dataclasses import dataclass
from typing import Literal

from fmopt.errors import GeometryError
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Value

FeatureKind = Literal["solid", "hollow"]

FOUND: dict[str, FeatureKind] = {"peg": "solid", "hole": "hollow"}  # what features are called that were found

DESCRIBE = (
    "describe where it mates under [features] of a model file: a hole, or a slot that is open to the side, by kind = "
    '"hollow", at = [x, y, z] in the middle of its mouth, turn = [rx, ry, rz] such that z points out of the mouth, '
    'length = its depth; a peg by kind = "solid", at = [x, y, z] in the middle of its leading end, turn such that z '
    "points from there into the part, length = how long it is"
)


@dataclass(frozen=True, eq=False)
class Feature(Value):
    """A mating feature, a leaf of the tree object, feature class, feature, instances of [LeeHuang1985] section 3.

    Args:
        frame: pose in the part's model frame. Hollow: origin at the centre of the mouth, z out of the mouth.
            Solid: origin at the centre of the leading end face, z from there back into the part.
        length: depth or length along z, m.
        through: whether a hollow feature is open at both ends.

    Raises:
        GeometryError: a length that is not positive, or a solid feature that is through.
    """

    name: str
    kind: FeatureKind
    frame: Pose
    length: float
    through: bool = False

    def __post_init__(self) -> None:
        if not (math.isfinite(self.length) and self.length > 0.0):
            raise GeometryError(f"feature {self.name!r} has length {self.length} m", "make it positive")
        if self.kind == "solid" and self.through:
            raise GeometryError(f"feature {self.name!r} is solid and cannot be through", "drop `through`")
