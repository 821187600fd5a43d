"""Sizes that no part, way or tolerance has, and most often a wrong unit: refused, with the unit that would be right."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from fmopt.errors import Fault, InputError, SizeError
from fmopt.geometry.extent import LARGEST, SMALLEST, told
from fmopt.geometry.part import Part
from fmopt.task.sources import Contribution, total
from fmopt.task.tables import in_words
from fmopt.task.toml_source import Key, Source, holds
from fmopt.task.units import ANGLE, LENGTH, UNITS
from fmopt.values import Array

_LARGEST_ERROR = 0.5  # m and rad: what the check of a plan takes
_USUAL = 0.05  # m: about how long a part is


def implausible(source: Source, key: Key, unit: str | None, error: SizeError) -> Fault:
    """The fault of a part's size, with the unit for which it would be plausible.

    Args:
        source: the model file.
        key: where its unit stands.
        unit: the unit of its plain numbers; None where that is not for the model file to say.
        error: what is wrong.
    """
    lengths = UNITS["length"][1]
    given = lengths.get(unit or "", 1.0)
    others = {name: error.size * factor / given for name, factor in lengths.items() if name != unit}
    fitting = {name: size for name, size in others.items() if SMALLEST <= size <= LARGEST}
    message, advice = error.message, "check its numbers"
    if unit is None:
        advice = "its file says its unit itself: export it again in the right one"
    elif fitting:
        right = min(fitting, key=lambda name: abs(math.log(fitting[name] / _USUAL)))
        message += f"; in {right} it would be {told(fitting[right])}"
        advice = f'set {key[-1]} = "{right}" if that is meant'
    return source.place(key).fault("implausible-size", message, advice)


def refuse_reaching(source: Source, parts: Mapping[str, Part]) -> None:
    """Refuses parts that reach further from their mating features than a plan can say.

    Args:
        source: the problem file.
        parts: by side, each in the frame of its feature.

    Raises:
        InputError: at the feature.
    """
    faults = []
    for side, part in parts.items():
        far = float(np.abs(part.polyhedron.vertices).max())
        if far > LARGEST:
            message = f"the part reaches {told(far)} from this feature, more than {told(LARGEST)}"
            faults.append(source.place((side, "feature")).fault("out-of-range", message, "check where the feature is"))
    if faults:
        raise InputError(*faults)


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
        InputError: at the component, or at the sources that add up to it; also where a plan cannot say the sum.
    """
    if np.max(box) > _LARGEST_ERROR:
        message = f"the start errors add up to {in_words(float(np.max(box[:3])), LENGTH)}"
        message += f" and {in_words(float(np.max(box[3:])), ANGLE)}"
        advice = f"keep them at most {in_words(_LARGEST_ERROR, LENGTH)} and {in_words(_LARGEST_ERROR, ANGLE)}"
        raise InputError(source.place(("uncertainty",), of_key=True).fault("out-of-range", message, advice))
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
