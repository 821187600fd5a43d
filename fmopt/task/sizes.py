"""Start errors of a size that is no tolerance, and most often a wrong unit: refused, with what the parts measure."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fmopt.errors import InputError
from fmopt.geometry.part import Part
from fmopt.task.sources import Contribution, total
from fmopt.task.tables import in_words
from fmopt.task.toml_source import Source, holds
from fmopt.task.units import ANGLE, LENGTH
from fmopt.values import Array


def refuse_wild(source: Source, shares: Sequence[Contribution]) -> None:
    """Refuses errors of orientation that a stated box could not have either.

    Raises:
        InputError: the sources together may turn the parts by more than 45°.
    """
    angle = float(total(shares)[3])
    if angle > 0.25 * math.pi:
        largest = max(shares, key=lambda share: float(share.box[3]))
        message = f"the sources may turn the parts by {in_words(angle, ANGLE)}, most of it by: {largest.source}"
        place = source.place(("uncertainty", "sources"), of_key=True)
        raise InputError(place.fault("out-of-range", message, "keep all together at most 45 deg"))


def refuse_far(source: Source, box: Array, parts: Sequence[Part]) -> None:
    """Refuses errors of position (box (6,), m and rad) larger than both parts: no tolerance, but another unit.

    Raises:
        InputError: at the component, or at the sources that add up to it.
    """
    size = max(float(np.linalg.norm(np.ptp(part.polyhedron.vertices, axis=0))) for part in parts)
    for axis, error in zip("xyz", box[:3].tolist(), strict=True):
        if error > size:
            stated = ("uncertainty", "start", axis)
            key = stated if holds(source.data.get("uncertainty", {}).get("start"), axis) else ("uncertainty",)
            message = (
                f"the parts measure {in_words(float(f'{size:.3g}'), LENGTH)} at most from corner to corner, the start "
                f"error along {axis} is {in_words(error, LENGTH)}"
            )
            advice = 'check [units], or write the unit beside the number, as in "0.4 mm"'
            raise InputError(source.place(key, of_key=len(key) == 1).fault("out-of-range", message, advice))
