"""The frames that a found feature may have as well, where more than one point may be the centre of its section."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from fmopt.geometry.centre import centres
from fmopt.geometry.mating_features import Feature, section_ring
from fmopt.geometry.polyhedron import Polyhedron, plane_basis
from fmopt.spatial.se3 import Pose

_SAME = 1e-9  # of its length: points that are closer are one


def other_frames(pieces: Sequence[Polyhedron], feature: Feature) -> Iterator[Pose]:
    """The frames of a found feature about the other points that may be taken for the centre of its section.

    Args:
        pieces: of its part, in the frame of the model.
        feature: as it was found.
    """
    from shapely.geometry.polygon import orient

    frame, hollow = feature.frame, feature.kind == "hollow"
    z = frame.R[:, 2]
    ring = section_ring(pieces, frame.p, z, (-0.5 if hollow else 0.5) * feature.length, hollow)
    if ring is not None:
        basis, known = plane_basis(z), _SAME * feature.length
        for point in centres(np.array(orient(ring).exterior.coords)[:-1]):
            if float(np.linalg.norm(point)) > known:
                yield Pose(frame.p + basis @ point, frame.R)
