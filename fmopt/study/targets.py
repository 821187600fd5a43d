"""What a study may vary: every number and choice of a problem, and every parameter of its two models, by path."""

from __future__ import annotations

import copy
import hashlib
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from os.path import normpath
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, get_args, get_origin

from fmopt.errors import Fault
from fmopt.geometry.bodies import MAX_MESH_BYTES
from fmopt.study.running.batch import Assigned
from fmopt.task.mesh_source import MESHES
from fmopt.task.model import parameter_values
from fmopt.task.toml import units
from fmopt.task.toml.problem_file import ProblemFile, spelled_out
from fmopt.task.toml.source import Key, Source, canonical_digest, read, read_bytes
from fmopt.task.toml.tables import Measured, Table
from fmopt.task.toml.units import RATIO, Dimension, Quantity, did_you_mean

SIDES = ("moving", "fixed")
UNIT_NAMES = {
    units.LENGTH: "m",
    units.ANGLE: "rad",
    units.TIME: "s",
    units.SPEED: "m/s",
    units.FORCE: "N",
    units.TORQUE: "N*m",
    units.MASS: "kg",
    units.STIFFNESS: "N/m",
    units.AREA: "m*m",  # what a model may work out for a section
}
_LETTERS = "xyz"  # what the entries of a vector are called
_FIXED = {"title", "units", *SIDES}  # units would change what all other numbers mean; models vary by their parameters


@dataclass(frozen=True)
class Target:
    """A parameter that may vary: its key, and its dimension, None for words, which may be the two truths."""

    key: Key
    dimension: Dimension | None
    truth: bool = False


@dataclass(frozen=True)
class Base:
    """The base problem: its document, those of its models, and all the files that a run needs, by relative path."""

    problem: Source
    models: Mapping[str, Source]
    inputs: Mapping[str, bytes]
    name: str
    content: str
    plan: str = ""

    @staticmethod
    def read(path: Path, plan: Path | None = None) -> Base:
        """The base problem of a file, which loads without fault, and a plan that its runs carry out.

        Raises:
            InputError: a file cannot be read.
        """
        source, _ = spelled_out(read(path))
        # By place, so that a file that is named twice is laid out once.
        files = {Path(normpath(path.absolute())): path}
        models, said = {}, dict[str, Any]()
        for side in SIDES:
            model = Path(normpath(path.parent / source.data[side]["model"]))
            files[Path(normpath(model.absolute()))] = model
            if model.suffix.lower() in MESHES:
                models[side] = Source(model, {}, {}, {})  # a mesh has no parameters to vary
                content = read_bytes(model, source.place((side, "model")), MAX_MESH_BYTES)
                said[side] = hashlib.sha256(content).hexdigest()
                continue
            models[side] = read(model, source.place((side, "model")))
            # The tables and not the bytes: a comment or another layout makes no other runs.
            said[side] = models[side].data
            if "mesh" in models[side].data:
                mesh = model.parent / models[side].data["mesh"]["file"]
                files[Path(normpath(mesh.absolute()))] = mesh
                content = read_bytes(mesh, models[side].place(("mesh", "file")), MAX_MESH_BYTES)
                said[f"{side} mesh"] = hashlib.sha256(content).hexdigest()
        if plan is not None:
            files[Path(normpath(plan.absolute()))] = plan
            said["plan"] = hashlib.sha256(read_bytes(plan, source.place(()), MAX_MESH_BYTES)).hexdigest()
        # Laid out below the folder that they share, files find each other by the relative names that are in them.
        root = os.path.commonpath([file.parent for file in files])
        place = source.place(())
        inputs = {os.path.relpath(f, root): read_bytes(given, place, MAX_MESH_BYTES) for f, given in files.items()}
        name, also = (os.path.relpath(normpath(one.absolute()), root) if one else "" for one in (path, plan))
        return Base(source, MappingProxyType(models), MappingProxyType(inputs), name, canonical_digest(said), also)

    def targets(self) -> dict[str, Target]:
        """What may vary, by path."""
        found = dict(_fields(ProblemFile, (), "", self.problem.data))
        for side, model in self.models.items():
            for name, value in parameter_values(model).items():
                # What has no unit here, as a volume or a length's reciprocal, is worked out from what has one.
                if value.dimension != RATIO and value.dimension not in UNIT_NAMES:
                    continue
                found[f"model.{side}.{name}"] = Target((side, "parameters", name), value.dimension)
        return found


def target(targets: Mapping[str, Target], path: str) -> Target | str:
    """The target of a path, or advice when there is none; `problem.` in front may be left out."""
    short = path.removeprefix("problem.")
    if short in targets:
        return targets[short]
    within = [name for name in targets if name.startswith(short + ".")]
    if within:
        return f"it is a table or an array; name one of {', '.join(within)}"
    near = did_you_mean(short, targets)
    inside = [name for name in targets if name.startswith(short.split(".")[0] + ".")]
    return near or f"paths here: {', '.join(inside or sorted({name.split('.')[0] + '.…' for name in targets}))}"


def assigned(source: Source, values: Iterable[tuple[Key, Assigned]]) -> Source:
    """A document with values put in, its file left as it is."""
    data = copy.deepcopy(dict(source.data))
    for key, value in values:
        table: Any = data
        for part in key[:-1]:
            # Tables that the base leaves out are made; arrays are there, as paths into them come from its own data.
            table = table[part] if isinstance(part, int) else table.setdefault(part, {})
        table[key[-1]] = value
    return replace(source, data=data)


def in_file(value: Quantity) -> Assigned:
    """A quantity as a file of any units has it: a number with its unit in SI, exactly."""
    return value.value if value.dimension == RATIO else f"{value.value!r} {UNIT_NAMES[value.dimension]}"


def blamed(faults: Iterable[Fault], mine: Mapping[str, Fault]) -> list[Fault]:
    """Faults of a changed problem, those of changed keys told of the study file, by the wordless faults in `mine`."""
    found = []
    for fault in faults:
        place = mine.get(fault.key)
        if place is not None:
            fault = replace(place, code=fault.code, message=fault.message, advice=fault.advice)
        found.append(fault)
    return list(dict.fromkeys(found))


def _fields(table: type[Table], above: Key, path: str, data: object) -> Iterator[tuple[str, Target]]:
    """The targets of a table by path; those in arrays as far as the data have them."""
    for name, field in table.model_fields.items():
        if above or name not in _FIXED:
            value = data.get(name) if isinstance(data, Mapping) else None
            # Pydantic takes what annotates a field as a whole out of its annotation, into its metadata.
            kinds = (*field.metadata, *_parts(field.annotation))
            yield from _targets(kinds, (*above, name), f"{path}.{name}".removeprefix("."), value)


def _targets(kinds: Sequence[Any], key: Key, path: str, data: object) -> Iterator[tuple[str, Target]]:
    inner = next((kind for kind in kinds if isinstance(kind, type) and issubclass(kind, Table)), None)
    array = next((kind for kind in kinds if get_origin(kind) is tuple), None)
    measured = next((kind for kind in kinds if isinstance(kind, Measured)), None)
    if array is not None and measured is None:
        items = get_args(array)
        vector = len(items) == len(_LETTERS) and Ellipsis not in items
        for n, value in enumerate(data if isinstance(data, list) else ()):
            below = f"{path}.{_LETTERS[n]}" if vector and n < len(items) else f"{path}.{n}"
            yield from _targets(tuple(_parts(items[0])), (*key, n), below, value)
    elif inner is not None:
        yield from _fields(inner, key, path, data)
    elif measured is not None:
        yield path, Target(key, measured.dimension)
    elif bool in kinds or any(get_origin(kind) is Literal for kind in kinds):
        yield path, Target(key, None, bool in kinds)


def _parts(annotation: Any) -> Iterator[Any]:
    """An annotation and all that it is made of, but what is in arrays."""
    yield annotation
    if get_origin(annotation) not in (Literal, tuple):
        for part in get_args(annotation):
            yield from _parts(part)
