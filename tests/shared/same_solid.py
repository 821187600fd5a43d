"""Solids that are the same: of one volume, or one set to the planner and to the check that reads the model file."""

from __future__ import annotations

import math

import pytest

from fmopt.geometry.part import Part
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.verify.problem.problem import Problem
from fmopt.verify.problem.solids import Comparison, of_piece, tree_of
from fmopt.verify.reading.document import Body


def body(polyhedron: Polyhedron) -> Body:
    """A polyhedron as a plan holds it."""
    return Body(
        tuple(tuple(row) for row in polyhedron.vertices.tolist()), tuple(face.loops for face in polyhedron.faces)
    )


def assert_same_solid(read: Problem, side: str, part: Part) -> None:
    """That the pieces of a part and the solid of a problem on that side are the same set."""
    solid = read.model(side).solid
    assert solid is not None
    comparison = Comparison(tree_of(solid, read.frame(side)), [of_piece(body(piece)) for piece in part.pieces])
    assert (comparison.outside(), comparison.uncovered()) == (None, None)


def assert_same_volume(derived: Polyhedron, body: Polyhedron, rel: float) -> None:
    """That a tree's solid has the volume of a part; polyhedra stand for the part's balls there, which add to it."""
    if not body.balls:
        assert derived.volume == pytest.approx(body.volume, rel=rel)
        return
    balls = sum(4.0 / 3.0 * math.pi * radius**3 for _, radius in body.balls)
    assert body.volume < derived.volume < body.volume + balls
