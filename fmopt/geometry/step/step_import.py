"""STEP files: plane faces exactly, curved ones as facets no further from them than stated.

The CAD kernel reads them in a process of its own: what breaks it down does not break this one.
"""

from contextlib import suppress
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from fmopt.errors import GeometryError, ResourceError, SizeError
from fmopt.geometry.body_names import chosen
from fmopt.geometry.csg import exact_pose
from fmopt.geometry.mesh.mesh_import import Imported, NamedBody, mesh_polyhedron
from fmopt.geometry.mesh.surface import MAX_TRIANGLES
from fmopt.geometry.polyhedron import from_triangles
from fmopt.geometry.section import require_plausible
from fmopt.geometry.step import AGAIN, COARSER, SIMPLER
from fmopt.runtime import confined
from fmopt.spatial.se3 import Pose

DEVIATION = 1e-5  # m: how finely curved faces are cut into facets where nothing else is asked for
_MILLIMETRE = 1e-3
_LATEST: dict[tuple[Path, int, int, float], tuple[NamedBody, ...]] = {}  # all bodies of the file that was read last
_KERNEL = confined.FileReader("the CAD kernel", "fmopt.geometry.step.kernel:read", SIMPLER, AGAIN)


def bodies(path: Path) -> tuple[NamedBody, ...]:
    """All bodies of a STEP file, of an assembly each in its place; lengths in m, the file says its unit itself.

    The pose of one part relative to another, as the file has them, is `one.pose.inverse().compose(other.pose)`.

    Raises:
        ResourceError, SizeError, GeometryError: as of `load_step`; the message names the body at fault.
    """
    version = _version(path, DEVIATION)
    found = _LATEST.get(version) or tuple(filter(None, _read(path, DEVIATION, "*")))
    _LATEST.clear()
    _LATEST[version] = found
    return found


def load_step(path: Path, deviation: float = DEVIATION, body: str = "") -> Imported:
    """One solid of a STEP file, in m; the file says its unit itself.

    Where the file holds several bodies it is in its product's own frame, else in the frame of the file. Corners of
    plane faces are those of the file. Curved faces become facets that lie within `deviation` of them; the distance is
    measured again at the middles of facets and their edges, and the larger of the two is the mesh's `chord_error`, 0
    where all faces are plane.

    Args:
        deviation: how far facets may lie from curved faces, m, positive.
        body: its name or its number, from 1; "" where there is but one.

    Raises:
        ResourceError: there is no such file, or no CAD kernel is installed or works, or no process can be started.
        SizeError: too large or too small for a part.
        GeometryError: unreadable, without a unit, no solid, or several where none is named, or one whose boundary does
            not close; or reading it breaks the CAD kernel down, or takes more time or memory than there is for it.
    """
    if known := _LATEST.get(_version(path, deviation)):
        one, count = known[chosen([each.name for each in known], body, path)], len(known)
    else:
        found = _read(path, deviation, body)
        one, count = next(filter(None, found)), len(found)
    if count > 1 or np.array_equal(one.pose.vector(), np.zeros(6)):
        return one.mesh
    return one.mesh.moved(one.pose)


def _version(path: Path, deviation: float) -> tuple[Path, int, int, float]:
    """The file, its state and the deviation: readings with equal ones are the same.

    Raises:
        ResourceError: there is no such file.
    """
    if not path.is_file():
        raise ResourceError(f"cannot read {path}: there is no such file", "check the path")
    state = path.stat()
    return path.resolve(), state.st_mtime_ns, state.st_size, deviation


def _read(path: Path, deviation: float, body: str) -> list[NamedBody | None]:
    """The bodies of the file as the process finds them there; None for each that is not asked for."""
    if find_spec("OCP") is None:
        raise _no_kernel(path, None)
    answer = confined.read(path, _KERNEL, repr(deviation / _MILLIMETRE), body)
    if "kernel" in answer:
        raise _no_kernel(path, answer["kernel"])
    found: list[dict[str, Any]] = answer["bodies"]
    several = len(found) > 1
    return [_named(path, one, number, several) if "points" in one else None for number, one in enumerate(found, 1)]


def _no_kernel(path: Path, fault: str | None) -> ResourceError:
    """That there is no CAD kernel, or what is wrong with the one there is.

    Where one is listed it is that which other libraries rely on, and its very version is to be installed anew.
    """
    if fault is None:
        message, advice = "STEP files need a CAD kernel, and there is none", "install fmopt[step]"
    else:
        message = f"the installed CAD kernel does not work: {fault}"
        advice = "install the package anew that it comes from"
    advice += ", or export the part as STL"
    for name in ("cadquery-ocp-novtk", "cadquery-ocp"):  # both own the same files, the last has more of them
        with suppress(PackageNotFoundError):
            advice = f"install it anew: pip install --force-reinstall --no-deps {name}=={version(name)}"
    return ResourceError(f"{path}: {message}", advice)


def _named(path: Path, one: dict[str, Any], number: int, several: bool) -> NamedBody:
    """A body of a file, named in messages where the file holds several."""
    called = f", body {one['name'] or number}" if several else ""
    try:
        points, triangles, off = _facets(one)
        require_plausible(points)
        # Facets of its own surfaces are known to close: nothing is to be mended, and no plane to be fitted.
        mesh = Imported(from_triangles(points, triangles), 0.0) if one["own"] else mesh_polyhedron(points, triangles)
    # It is a GeometryError, but would lose its size as one.
    except SizeError:
        raise
    except GeometryError as error:
        raise GeometryError(f"{path}{called}: {error.message}", error.advice) from error
    notes = mesh.notes
    if one["around"] != 0.0:
        size = f"{1e6 * (_MILLIMETRE * one['around']):.3g} µm"
        notes += (f"its fillets are enclosed by facets, which makes it up to {size} larger there and nowhere smaller",)
    place = np.array(one["place"], dtype=np.float64)
    pose = exact_pose(Pose(_MILLIMETRE * place[:, 3], place[:, :3]))
    return NamedBody(one["name"], number, replace(mesh, chord_error=off or 0.0, notes=notes, kind="solid"), pose)


def _facets(answer: dict[str, Any]) -> tuple[Any, Any, float | None]:
    """Points (n, 3) in m, triangles (m, 3), and how far they are from curved faces, m; None if none is."""
    points = _MILLIMETRE * np.array(answer["points"], dtype=np.float64).reshape(-1, 3)
    triangles = np.array(answer["triangles"], dtype=np.int64).reshape(-1, 3)
    if len(triangles) > MAX_TRIANGLES:
        raise GeometryError(f"it becomes {len(triangles)} facets", COARSER)
    if not np.isfinite(points).all() or triangles.min() < 0 or triangles.max() >= len(points):
        raise GeometryError("the CAD kernel makes no surface of it", AGAIN)
    off = answer["off"]
    return points, triangles, None if off is None else _MILLIMETRE * off
