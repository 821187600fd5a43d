"""SHR_EXP: the moving operand shrinks to its nominal centre while the cut-diagrams of the fixed one expand.

The expansion over the moving operand's instances is the union of the expansions by each ([LeeHuang1985] Assertion 1).
The fixed operand's tree has to be evaluated first: the expansion of a difference is not the difference of expansions,
as what is taken away shrinks where the rest grows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fmopt.plane.boolean import union
from fmopt.plane.convolution import minkowski_sum
from fmopt.plane.region import Region
from fmopt.plane.turning import turn_swept

_RELATIVE = 1e-6


def expanded(G: Region, sections: Sequence[Region], tolerance: float | None = None) -> Region:
    """GE = ∪ G ⊕ (−section): where the nominal centre cannot be without the moving operand overlapping G.

    GE is regularised: a centre on its boundary touches, and a slit or a point that leaves no play is part of GE.
    Segments and circular arcs are exact, and so are the conic arcs of one operand where the other one is a polygon.

    Args:
        G: cut-diagram of the fixed operand.
        sections: cut-diagrams of the moving operand's instances, about the nominal centre as origin. Empty ones add
            nothing; without any other the operand is its centre alone, and G comes back as it is.
        tolerance: in m; by how much GE may be too large where conic arcs meet curves, 1e-6 of the larger size if None.
    """
    solid = [section for section in sections if not section.empty]
    if G.empty or not solid:
        return G
    room = _RELATIVE * max(G.size, *(section.size for section in solid)) if tolerance is None else tolerance
    return union([minkowski_sum(G, section.moved(-np.eye(2), (0.0, 0.0)), room) for section in solid])


def expanded_turning(
    G: Region, sections: Sequence[Region], interval: tuple[float, float], tolerance: float | None = None
) -> Region:
    """GE while the moving operand turns in the plane: ∪ G ⊕ (−R(φ) section) over the orientations φ of an interval.

    As turning and expanding commute with unions, this is the expansion by what the sections sweep about the nominal
    centre: arcs about it and the sections at both ends, exact as in `expanded`.

    Args:
        G: cut-diagram of the fixed operand.
        sections: of the moving operand's instances at φ = 0, about the nominal centre.
        interval: first and last φ in rad; from a full turn on every orientation is taken.
        tolerance: as in `expanded`.
    """
    return expanded(G, [turn_swept(section, *interval) for section in sections], tolerance)
