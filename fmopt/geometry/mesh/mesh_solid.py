"""The solid of an imported mesh, with the exact half-space pieces of one that is modelled."""

from __future__ import annotations

import numpy as np

from fmopt.errors import GeometryError
from fmopt.geometry.csg import Solid
from fmopt.geometry.facets import place
from fmopt.geometry.inverse_csg import MESH_NOISE, apart
from fmopt.geometry.mesh.mesh_import import Imported
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.spatial.values import Array, remembered

_UNEVEN = 1e-4  # of the diameter: facets this close to one plane are said to be uneven


@remembered(1)
def come_apart(mesh: Imported) -> tuple[Solid, Polyhedron]:
    """The solid of a mesh by way of `inverse_csg.apart`, and its boundary.

    Raises:
        GeometryError: it does not come apart into convex bodies, and where its facets are uneven.
    """
    body = mesh.body
    try:
        return apart(body, MESH_NOISE * body.diameter)
    except GeometryError as error:
        if mesh.kind == "solid":
            raise mesh.fault("the solid does not come apart into convex bodies", error.advice) from error
        uneven, where = _flattest_edge(body)
        if uneven > _UNEVEN * body.diameter:
            # No face is that close to the plane of its neighbour: unevenness is not why.
            raise
        raise GeometryError(
            f"the facets around {place(where)} are {1e6 * uneven:.3g} µm off one plane, and the mesh does not come "
            "apart into convex bodies",
            "make them plane in the program that made the mesh, or write the file with more digits",
        ) from error


def _flattest_edge(body: Polyhedron) -> tuple[float, Array]:
    """The least distance by which the faces at an edge, looking the same way, are off one plane, m, and where."""
    least, where = np.inf, np.zeros(3)
    for edge in body.edges:
        one, other = (body.faces[number] for number in edge.faces)
        beyond = float(np.abs(body.vertices[list(other.vertices)] @ one.normal - one.offset).max())
        if one.normal @ other.normal > 0.0 and beyond < least:
            least, where = beyond, body.vertices[list(edge.vertices)].mean(axis=0)
    return least, where
