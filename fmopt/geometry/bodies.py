"""The bodies of a file that may hold several: products of a STEP file, objects of a mesh, or what lies apart in it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from fmopt.geometry.mesh.mesh_import import NamedBody, Unit


def bodies_of(path: Path, unit: str | None) -> tuple[NamedBody, ...]:
    """All bodies of a STEP or mesh file, the numbers of the latter in mm if no unit is given.

    Raises:
        ResourceError, SizeError, GeometryError: it cannot be read.
    """
    if path.suffix.lower() in (".step", ".stp"):
        from fmopt.geometry.step.step_import import bodies

        return bodies(path)
    from fmopt.geometry.mesh.mesh_file import OWN_UNIT
    from fmopt.geometry.mesh.mesh_import import mesh_bodies

    return mesh_bodies(path, cast("Unit", "m" if path.suffix.lower()[1:] in OWN_UNIT else unit or "mm"))
