"""About which point of its section a found feature turns, where that can be told beside its counterpart only."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from fmopt.spatial.se3 import Pose
from fmopt.task.pairing import SIDES, Mated, Side, fitting_pairs, operand, paired
from fmopt.task.toml.source import Source

if TYPE_CHECKING:
    from fmopt.geometry.part import Part
    from fmopt.task.model import Model
    from fmopt.task.toml.problem_file import ProblemFile


def mating(
    source: Source, file: ProblemFile, models: Mapping[str, Model], parts: Mapping[str, Part]
) -> tuple[ProblemFile, Mapping[str, Mated], Mapping[str, Model], dict[str, Part]]:
    """What `fmopt.task.pairing.paired` finds, with the models and parts by side as it was found on them.

    Args:
        source: the problem file.
        file: its tables.
        models: by side.
        parts: by side, in the frames of their models.

    Raises:
        InputError: no two features can mate, or several pairs fit alike.
    """
    models, made = _recentred(source, file, models, parts)
    return *paired(source, file, models, made), models, made


def _recentred(
    source: Source, file: ProblemFile, models: Mapping[str, Model], parts: Mapping[str, Part]
) -> tuple[Mapping[str, Model], dict[str, Part]]:
    """The models and their parts, with found features about other centres of their sections where need be.

    A peg and its hole are found each on its own. Where more than one point may be taken for a centre, as in an L, the
    gap around a peg may decide which is. Where none fits another so, others are taken.

    Args:
        source: the problem file.
        file: its tables.
        models: by side.
        parts: by side, in the frames of their models.
    """
    stated: dict[Side, str | None] = {side: operand(file, side).feature for side in SIDES}
    if any(name is not None and name not in models[side].file.features for side, name in stated.items()):
        return models, dict(parts)
    turning = "turn" not in file.goal.model_fields_set
    pairs = list(fitting_pairs(source, file, parts, stated, turning))
    if not pairs or max(pair.fit.gap for pair in pairs) > 0.0:
        return models, dict(parts)
    names = max(pairs, key=lambda pair: pair.fit.gap).names
    choices = [[models[side], *_about_others(models[side], parts[side], names[side])] for side in SIDES]
    for own, other in product(*choices):
        tried: dict[str, Model] = dict(zip(SIDES, (own, other), strict=True))
        moved: dict[str, Part] = {side: _with_frame(parts[side], tried[side], names[side]) for side in SIDES}
        if any(pair.fit.gap > 0.0 for pair in fitting_pairs(source, file, moved, names, turning)):
            return tried, moved
    return models, dict(parts)


def _about_others(model: Model, part: Part, name: str) -> Iterator[Model]:
    """A model with a feature about other centres of its section, if its place was found."""
    from fmopt.geometry.other_frames import other_frames

    table = model.file.features[name]
    if model.is_found(name) and "at" not in model.source.data.get("features", {}).get(name, {}):
        for frame in other_frames(part.pieces, part.feature(name)):
            at = (float(frame.p[0]), float(frame.p[1]), float(frame.p[2]))
            features = {**model.file.features, name: table.model_copy(update={"at": at})}
            yield replace(model, file=model.file.model_copy(update={"features": features}))


def _with_frame(part: Part, model: Model, name: str) -> Part:
    """A part with a feature where its model has it."""
    at = model.file.features[name].at or (0.0, 0.0, 0.0)
    moved = [replace(f, frame=Pose(np.array(at), f.frame.R)) if f.name == name else f for f in part.features]
    return replace(part, features=tuple(moved))
