"""The bodies of a file that may hold several by name: products of a STEP file, objects of an OBJ file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from fmopt.geometry.mesh.mesh_import import NamedBody, Unit


def bodies_of(path: Path, unit: str | None) -> tuple[NamedBody, ...]:
    """All bodies of a STEP or OBJ file, the numbers of the latter in mm if no unit is given.

    Raises:
        ResourceError, SizeError, GeometryError: it cannot be read.
    """
    if path.suffix.lower() != ".obj":
        from fmopt.geometry.step.step_import import bodies

        return bodies(path)
    from fmopt.geometry.mesh.mesh_import import mesh_bodies

    return mesh_bodies(path, cast("Unit", unit or "mm"))
