"""The parts of a problem for the check of plans, which does not read every file itself."""

from __future__ import annotations

from fmopt.geometry.part import Part
from fmopt.task.problem import Problem
from fmopt.verify.document import Body
from fmopt.verify.problem import Given


def given(problem: Problem) -> dict[str, Given]:
    """The two parts by side, in their mating frames."""
    return {"moving": _part(problem.moving), "fixed": _part(problem.fixed)}


def _part(part: Part) -> Given:
    shape = part.polyhedron
    faces = tuple(tuple(tuple(loop) for loop in face.loops) for face in shape.faces)
    return Given(Body(tuple(tuple(row) for row in shape.vertices.tolist()), faces), part.chord_error)
