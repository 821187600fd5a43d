"""Mating features that a model file leaves to be found, wholly or in part, on its solids or its mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fmopt.errors import Fault, InputError
from fmopt.se3 import Pose
from fmopt.task.model_file import MatingFeature, ModelFile
from fmopt.task.toml_source import Source
from fmopt.task.tree import bare_part, unstated

if TYPE_CHECKING:
    from fmopt.geometry.mating import Feature
    from fmopt.geometry.part import Part

_SAME = 1e-9  # m
_ORIGIN = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Model:
    """A valid model file with its parameters bound."""

    source: Source
    file: ModelFile


def with_features(source: Source, file: ModelFile) -> ModelFile:
    """The model file with what is found of the features that it does not state; itself where it states them all.

    Raises:
        InputError: no solid comes out, nothing is found, or nothing that goes with what is stated.
        ResourceError: a STEP file without the extra that reads it.
    """
    wanted = unstated(source, file) if file.features else ()
    if file.profile is not None or (file.features and not wanted):
        return file
    found = bare_part(source, file).features
    if not file.features:
        return file.model_copy(update={"features": {feature.name: _table(feature, None) for feature in found}})
    made, faults = dict(file.features), list[Fault]()
    for name in wanted:
        match = _match(source, name, made[name], found)
        if isinstance(match, Fault):
            faults.append(match)
        else:
            made[name] = _table(match, made[name])
    if faults:
        raise InputError(*faults)
    return file.model_copy(update={"features": made})


def _match(source: Source, name: str, stated: MatingFeature, found: Sequence[Feature]) -> Feature | Fault:
    """The feature found that goes with what is stated of one."""
    place, listed = source.place(("features", name), of_key=True), "; ".join(map(_words, found))
    kind = [feature for feature in found if feature.kind == stated.kind]
    if not kind:
        message = f"no {stated.kind} feature was found on the part, only: {listed}"
        return place.fault("not-found", message, "check its kind, or add at, turn and length")
    if stated.at is not None:
        near = [feature for feature in kind if _beside(feature, stated.at) <= _SAME]
        if near:
            point = np.array(stated.at)
            return min(near, key=lambda feature: float(np.linalg.norm(feature.frame.p - point)))
        at = ", ".join(f"{1e3 * x + 0.0:.9g}" for x in stated.at)
        message = f"at = [{at}] mm is in no mouth or leading end that was found: {listed}"
        return source.place(("features", name, "at")).fault("not-found", message, "correct it, drop it, or add length")
    named = [feature for feature in kind if feature.name == name]
    if len(kind) == 1 or named:
        return (named or kind)[0]
    message = f"there is more than one {stated.kind} feature: {listed}"
    return place.fault("ambiguous", message, "say which by its 'at', or call it by its name here")


def _beside(feature: Feature, at: Sequence[float]) -> float:
    """How far a point is off the plane of a feature's mouth or leading end, m."""
    return abs(float(feature.frame.R[:, 2] @ (np.asarray(at) - feature.frame.p)))


def _words(feature: Feature) -> str:
    at = ", ".join(f"{1e3 * x + 0.0:.6g}" for x in feature.frame.p)
    return f"{feature.name}, {feature.kind}, at [{at}] mm, {1e3 * feature.length:.6g} mm long"


def _table(found: Feature, stated: MatingFeature | None) -> MatingFeature:
    """The table of a feature: what is stated, and for the rest what is found."""
    x, y, z, *turn = found.frame.vector().tolist()
    made: dict[str, Any] = {
        "kind": found.kind,
        "at": (x, y, z),
        "turn": tuple(turn),
        "length": found.length,
        "through": found.through,
    }
    if stated is None:
        return MatingFeature.model_construct(None, **made)
    if stated.at is not None:
        del made["turn"]
    if stated.length is not None:
        del made["through"]
    given = {key: getattr(stated, key) for key in stated.model_fields_set if getattr(stated, key) is not None}
    return stated.model_copy(update={**made, **given})


def reaching(models: Mapping[str, Model], names: Mapping[str, str]) -> dict[str, Model]:
    """Two models by side, the length of a peg that was found taken past shoulders that the mouth of the hole takes in.

    A shoulder ends a peg on a part alone; beside a hole that is wider than what follows it is a step of the peg.
    """
    features = {side: models[side].file.features[names[side]] for side in models}
    kinds = {feature.kind: side for side, feature in features.items()}
    if len(kinds) < 2 or any(model.file.profile is not None for model in models.values()):
        return dict(models)
    peg, hole = kinds["solid"], kinds["hollow"]
    length, depth = features[peg].length or 0.0, features[hole].length or 0.0
    stated = models[peg].source.data.get("features", {}).get(names[peg], {})
    if "length" in stated or not length < depth:
        return dict(models)
    from fmopt.geometry.clearance import past_shoulders

    reached = past_shoulders(_seen(models[peg], names[peg]), _seen(models[hole], names[hole]), length, depth)
    table = features[peg].model_copy(update={"length": reached})
    file = models[peg].file
    longer = file.model_copy(update={"features": {**file.features, names[peg]: table}})
    return {**models, peg: replace(models[peg], file=longer)}


def _seen(model: Model, name: str) -> Part:
    """The part of a model in the frame of one of its features."""
    from fmopt.geometry.part import rebased

    table = model.file.features[name]
    return rebased(bare_part(model.source, model.file), Pose.from_vector([*(table.at or _ORIGIN), *table.turn]))
