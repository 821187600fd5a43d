"""Meshes whose numbers are rounded: facets that were meant to be plane, and are so only to the last digit written."""

from __future__ import annotations

import numpy as np

from fmopt.errors import GeometryError
from fmopt.geometry.csg import Solid
from fmopt.geometry.excess import MESH_NOISE, solid_of
from fmopt.geometry.facets import Indices, place
from fmopt.geometry.mesh import Imported
from fmopt.geometry.pieces import polyhedron
from fmopt.geometry.polyhedron import Polyhedron, from_triangles, triangulated
from fmopt.memory import remembered
from fmopt.values import Array

_REACH = 2.0  # steps of rounding: corners that are half a step off each way leave their plane by less
_UNEVEN = 1e-4  # of the diameter: facets this close to one plane are said to be uneven


@remembered(1)
def come_apart(mesh: Imported) -> tuple[Solid, float]:
    """The solid of a mesh by way of `excess.solid_of`, and how far its faces were moved to make them plane, m.

    Noise of 1e-6 of the diameter is cleaned away. Where the mesh has neighbouring faces that are one plane but for the
    rounding of its numbers, corners within two steps of the rounding of a plane are in it.

    Raises:
        GeometryError: it does not come apart into convex bodies, and where its facets are uneven.
    """
    body, reach = mesh.body, _REACH * mesh.rounding
    uneven, where = _flattest_edge(body)
    try:
        if uneven > reach:
            return solid_of(body, MESH_NOISE * body.diameter), 0.0
        triangles = triangulated(body)
        solid = solid_of(from_triangles(body.vertices, triangles, reach), reach)
    except GeometryError as error:
        if uneven > _UNEVEN * body.diameter:
            raise
        raise GeometryError(
            f"the facets around {place(where)} are {1e6 * uneven:.3g} µm off one plane, and the mesh does not come "
            "apart into convex bodies",
            "make them plane in the program that made the mesh, or write the file with more digits",
        ) from error
    return solid, _shift(body.vertices, triangles, polyhedron(solid))


def _flattest_edge(body: Polyhedron) -> tuple[float, Array]:
    """The least distance by which the faces at an edge, looking the same way, are off one plane, m, and where."""
    least, where = np.inf, np.zeros(3)
    for edge in body.edges:
        one, other = (body.faces[number] for number in edge.faces)
        beyond = float(np.abs(body.vertices[list(other.vertices)] @ one.normal - one.offset).max())
        if one.normal @ other.normal > 0.0 and beyond < least:
            least, where = beyond, body.vertices[list(edge.vertices)].mean(axis=0)
    return least, where


def _shift(points: Array, triangles: Indices, flat: Polyhedron) -> float:
    """How far a triangle is off the face that it became, the nearest that looks its way, m, at most."""
    corners = points[triangles]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    off = np.abs(corners @ flat.normals.T - flat.offsets).max(axis=1)
    return float(np.where(area @ flat.normals.T > 0.0, off, np.inf).min(axis=1).max())
