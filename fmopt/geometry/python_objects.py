"""Parts from objects of Python: solids of CadQuery, build123d and their kernel, meshes, outlines with a height.

None of these libraries is imported here: whoever has such an object has imported its library already.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from shapely import Polygon, is_valid_reason

from fmopt.errors import GeometryError
from fmopt.geometry.mesh.mesh_import import Imported, Unit, mesh_polyhedron
from fmopt.geometry.mesh.round_planes import chord_error
from fmopt.geometry.polyhedron import extruded
from fmopt.geometry.section import require_plausible
from fmopt.geometry.step.step_import import load_step
from fmopt.spatial.values import Array

_METRES: dict[str, float] = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
_SPELT: dict[str, Unit] = {  # how trimesh says it
    **dict.fromkeys(("meter", "meters", "metre", "metres"), "m"),
    **dict.fromkeys(("millimeter", "millimeters", "millimetre", "millimetres"), "mm"),
    **dict.fromkeys(("centimeter", "centimeters", "centimetre", "centimetres"), "cm"),
    **dict.fromkeys(("inch", "inches"), "in"),
}
_ADVICE = (
    "give a solid of a CAD library, a mesh of trimesh or manifold3d, or an outline (n, 2) and its height as a pair"
)


def imported_of(thing: object, unit: Unit | None = None) -> Imported:
    """The polyhedron of an object, m.

    Args:
        thing: a Workplane, Shape or Assembly of CadQuery, a Part, Solid or builder of build123d, a shape of OCP, with
            one solid; a Trimesh; a Manifold; or a pair of an outline and a height: corners (n, 2) of a polygon, or
            several such loops, the outer one first, then its holes, in the plane of x and y, the height along z.

    Raises:
        GeometryError: no such object, no unit where one is needed, or no solid.
        SizeError: too large or too small for a part.
        ResourceError: the CAD kernel does not work.
    """
    # By all classes that it derives from, as a user's own may derive from one of a library.
    library = next((found for found in map(_library, type(thing).__mro__) if found in _READERS), "")
    if library in ("cadquery", "build123d", "OCP"):
        return _of_shape(thing, unit or "mm")
    if library == "trimesh":
        return _of_trimesh(thing, unit)
    if library == "manifold3d":
        return _of_manifold(thing, unit)
    if isinstance(thing, tuple) and len(thing) == 2:
        return _of_outline(thing[0], thing[1], _factor(unit, "an outline"))
    raise GeometryError(f"an object of type {type(thing).__module__}.{type(thing).__name__} is no part", _ADVICE)


_READERS = ("cadquery", "build123d", "OCP", "trimesh", "manifold3d")


def _library(kind: type) -> str:
    return kind.__module__.split(".")[0]


def _factor(unit: str | None, what: str) -> float:
    if unit not in _METRES:
        said = "does not say its unit" if unit is None else f"cannot be in {unit!r}"
        raise GeometryError(f"{what} {said}", f"give unit = one of {', '.join(_METRES)}")
    return _METRES[unit]


def _of_shape(thing: object, unit: Unit) -> Imported:
    """A solid by way of a STEP file of it, which its own library's kernel writes."""
    with TemporaryDirectory(prefix="fmopt-") as folder:
        path = Path(folder, f"{type(thing).__name__}.step")
        step_of(thing, path, unit)
        try:
            return load_step(path)
        except GeometryError as error:
            message = error.message.replace(str(path), f"the {type(thing).__name__}")
            advice = "give one of its solids" if "bodies: " in message else error.advice
            # A SizeError stays one, with its size.
            if hasattr(error, "size"):
                error.message = message
                raise
            raise GeometryError(message, advice) from error


def step_of(thing: object, path: Path, unit: str | None = None) -> bool:
    """Writes a solid of a CAD library, in mm if not said, as a STEP file by its own kernel; False for other objects.

    Raises:
        GeometryError: it holds no shape.
    """
    from fmopt.geometry.step.step_file import write

    if not any(_library(kind) in _READERS[:3] for kind in type(thing).__mro__):
        return False
    shapes = list(_wrapped(thing))
    if not shapes:
        raise GeometryError(f"the {type(thing).__name__} holds no shape", "give it once it is built")
    write(path, shapes, _factor(unit or "mm", "a solid") / _METRES["mm"])
    return True


def _wrapped(thing: Any) -> Iterable[Any]:
    """The kernel's shapes of an object of CadQuery or build123d, or a shape of the kernel itself."""
    if _library(type(thing)) == "OCP":
        return (thing,)
    if hasattr(thing, "toCompound"):  # an assembly of CadQuery
        return (thing.toCompound().wrapped,)
    if hasattr(thing, "vals"):  # a workplane of CadQuery
        found = thing.vals()
        return [each.wrapped for each in found if hasattr(each, "wrapped") and _library(type(each.wrapped)) == "OCP"]
    made = getattr(thing, "part", thing)  # a builder of build123d
    shape = getattr(made, "wrapped", None)
    return () if shape is None else (shape,)


def _of_trimesh(thing: Any, unit: Unit | None) -> Imported:
    said = str(getattr(thing, "units", None) or "")
    factor = _factor(unit or _SPELT.get(said, said) or None, "the trimesh")
    if hasattr(thing, "graph") and len(thing.graph.nodes_geometry) == 1:  # a scene, as of files that hold one
        thing = thing.to_mesh()
    if not hasattr(thing, "faces"):
        message = f"a {type(thing).__name__} of trimesh is no mesh"
        raise GeometryError(message, "give one Trimesh, such as one of scene.geometry, or scene.to_mesh()")
    return _of_triangles(factor * np.asarray(thing.vertices, np.float64), np.asarray(thing.faces, np.int64))


def _of_manifold(thing: Any, unit: Unit | None) -> Imported:
    factor = _factor(unit, "a manifold")
    if not hasattr(thing, "to_mesh64"):
        raise GeometryError(f"a {type(thing).__name__} of manifold3d is no solid", "give a Manifold")
    mesh = thing.to_mesh64()
    points = np.asarray(mesh.vert_properties, np.float64)[:, :3]  # behind the position may be others, such as colours
    return _of_triangles(factor * points, np.asarray(mesh.tri_verts).astype(np.int64))


def _of_triangles(points: Array, triangles: Any) -> Imported:
    if not len(triangles):
        raise GeometryError("the mesh holds no triangles", "give a solid")
    require_plausible(points)
    return mesh_polyhedron(points, triangles)


def _of_outline(outline: Any, height: Any, factor: float) -> Imported:
    """The prism over an outline with holes, its corners as given."""
    loops = [np.array(loop, dtype=np.float64) for loop in _loops(outline)]
    if not (np.isfinite(height) and height > 0.0):
        raise GeometryError(f"the height of an outline is {height}", "make it positive")
    outer, *holes = (Polygon(loop) for loop in loops)
    shape = Polygon(loops[0], loops[1:])
    if not shape.is_valid or not all(ring.area > 0.0 for ring in (outer, *holes)):
        advice = "list the corners of loops that do not cross, the outer one first, then its holes"
        raise GeometryError(f"the outline bounds no area: {is_valid_reason(shape)}", advice)
    turned = [
        loop if ring.exterior.is_ccw == (number == 0) else loop[::-1]
        for number, (loop, ring) in enumerate(zip(loops, (outer, *holes), strict=True))
    ]
    body = extruded([factor * loop for loop in turned], 0.0, factor * float(height))
    require_plausible(body.vertices)
    return Imported(body, chord_error(body), kind="solid")


def _loops(outline: Any) -> Sequence[Any]:
    """The loops of an outline, without corners that repeat the first."""
    try:
        single = np.ndim(outline) == 2
    except ValueError:  # loops of different lengths
        single = False
    found = [np.asarray(loop, dtype=np.float64) for loop in ([outline] if single else outline)]
    if not found or any(loop.ndim != 2 or loop.shape[1] != 2 or not np.isfinite(loop).all() for loop in found):
        raise GeometryError("an outline has to be corners (n, 2), or several such loops", _ADVICE)
    return [loop[:-1] if len(loop) > 1 and np.array_equal(loop[0], loop[-1]) else loop for loop in found]
