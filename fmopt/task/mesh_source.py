"""The mesh or STEP file that a model file names, read once its unit is known."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fmopt.errors import Fault, GeometryError, InputError, ResourceError, SizeError
from fmopt.geometry.bodies import MAX_MESH_BYTES, kept_of
from fmopt.spatial.values import remembered
from fmopt.task.sizes import implausible
from fmopt.task.toml.model_file import STEP, Mesh
from fmopt.task.toml.source import Source, read_bytes
from fmopt.task.toml.tables import NAME

if TYPE_CHECKING:
    from fmopt.geometry.mesh.mesh_import import Imported, Unit
    from fmopt.geometry.part import Part

OWN_UNIT = (*STEP, ".3mf", ".glb")  # files that say the unit of their numbers
MESHES = (".stl", ".obj", ".ply", *OWN_UNIT)


def says_unit(mesh: Mesh) -> bool:
    """Whether the file that a model names says its unit itself."""
    return Path(mesh.file).suffix.lower() in OWN_UNIT


def takes(mesh: Mesh, name: str) -> bool:
    """Whether the table of a mesh may say its "unit", or which "body" of the file is meant."""
    return name == "body" or not says_unit(mesh)


def mesh_faults(source: Source, mesh: Mesh) -> Iterator[Fault]:
    """A mesh without a unit, with its size in the numbers of its file to choose by; or a file that says it with one."""
    if says_unit(mesh):
        if mesh.unit is not None:
            place = source.place(("mesh", "unit"), of_key=True)
            kind = "STEP" if mesh.is_step else Path(mesh.file).suffix.removeprefix(".").upper()
            yield place.fault("conflict", f"a {kind} file says its unit itself", "remove 'unit'")
        if mesh.is_step and mesh.deviation == 0.0:
            message = "curved faces cannot be cut into facets that lie in them"
            yield source.place(("mesh", "deviation")).fault("zero", message, "give a deviation such as 0.01 mm")
        return
    if mesh.unit is not None:
        return
    advice = "add 'unit' to [mesh]: m, cm, mm, um or in"
    # The file may be damaged besides: both are told at once.
    try:
        from fmopt.geometry.mesh.mesh_import import extents

        size = " x ".join(f"{width:.6g}" for width in extents(_path(source, mesh)))
    except (GeometryError, ResourceError, InputError) as error:
        size, advice = f"not known: {error}", f"{advice}; and mend the file"
    message = f"the unit of the mesh is missing; its size in the file's own numbers is {size}"
    yield source.place(("mesh",), of_key=True).fault("missing-key", message, advice)


@remembered(1)
def imported(source: Source, mesh: Mesh) -> Imported:
    """The mesh of a model file, in m; features, part and tree of one model are made of one reading.

    Raises:
        InputError: it cannot be read, bounds no solid or is of no plausible size; at its place in the model file.
        ResourceError: a STEP file without the extra that reads it.
    """
    place = source.place(("mesh", "file"))
    path = _path(source, mesh)
    body, unit = str(mesh.body or ""), "m" if says_unit(mesh) else mesh.unit or "mm"  # of such files numbers come in m
    try:
        return kept_of(path, (unit, body, mesh.deviation), lambda: _read(path, mesh, body, unit))
    except SizeError as error:
        key = ("mesh", "file" if mesh.unit is None else "unit")
        raise InputError(implausible(source, key, mesh.unit, error)) from error
    except GeometryError as error:
        raise InputError(place.fault("geometry", error.message, error.advice)) from error


def _read(path: Path, mesh: Mesh, body: str, unit: Unit) -> Imported:
    if mesh.is_step:
        from fmopt.geometry.step.step_import import DEVIATION, load_step

        return load_step(path, mesh.deviation or DEVIATION, body)
    from fmopt.geometry.mesh.mesh_import import load_mesh

    return load_mesh(path, unit, body)


def _path(source: Source, mesh: Mesh) -> Path:
    path = source.path.parent / Path(mesh.file)
    # For what it refuses, at this place: those who read meshes read the file themselves.
    read_bytes(path, source.place(("mesh", "file")), MAX_MESH_BYTES)
    return path


def assumed(source: Source, part: Part) -> str:
    """What is to be said of a mesh file for whose numbers nobody says a unit."""
    size = " x ".join(f"{1e3 * width:.6g}" for width in np.ptp(part.polyhedron.vertices, axis=0).tolist())
    name = source.path.name
    return f"warning: {name} has no unit; its numbers are taken for mm, so that the part is {size} mm: state its unit"


def called(said: str) -> str:
    """A part's name from that of its file, or of a body of it."""
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", said).strip("_")[:60].strip("_")
    return name if re.match(NAME, name) else f"part_{name}"[:64].rstrip("_")
