"""Cylinders and cones of model files as polyhedra: with so many sides, or with as many as a sagitta asks for.

A polyhedron by its sagitta is on the safe side of the round surface: around it where the solid is material, inside it
where it is taken away. So a round pin and its hole clear each other by no more than their polyhedra say, and a sagitta
of a twentieth of the clearance a side takes a tenth of that at most.
"""

import math
from collections.abc import Iterator

from fmopt.errors import GeometryError
from fmopt.geometry.csg import Cone, Cylinder
from fmopt.task.toml import model_file as files

_FACTOR = 4  # of the number of sides, so that a part looks the same along x and y, both ways
_MAX_SIDES = 1998  # as `sides` of a model file


def round_solid(table: files.CylinderTable | files.ConeTable, hollow: bool) -> Cylinder | Cone:
    """The polyhedron that stands for a solid of revolution, `hollow` where it is taken away.

    Raises:
        GeometryError: its sagitta asks for more sides than a part may have.
    """
    if isinstance(table, files.CylinderTable):
        factor, sides = _scale(table, table.radius, hollow)
        return Cylinder(factor * table.radius, table.height, sides)
    factor, sides = _scale(table, max(table.radius_bottom, table.radius_top), hollow)
    return Cone(factor * table.radius_bottom, factor * table.radius_top, table.height, sides)


def _scale(table: files.TurnedTable, radius: float, hollow: bool) -> tuple[float, int]:
    """How much farther than the round surface the corners are from the axis, and how many there are around it."""
    if table.sagitta is None:
        return 1.0, table.sides
    sides = sides_within(radius, table.sagitta)
    if sides > _MAX_SIDES:
        raise GeometryError(f"its sagitta asks for {sides} sides", f"give one for which {_MAX_SIDES} sides do")
    return (1.0 if hollow else 1.0 / math.cos(math.pi / sides)), sides


def sides_within(radius: float, sagitta: float) -> int:
    """The least number of sides, a multiple of four, of regular polygons within a sagitta of a circle, m.

    The polygon around it lies off by r / cos(π/n) − r at its corners, the one inside it by less at its sides.
    """
    return _FACTOR * math.ceil(math.pi / math.acos(radius / (radius + sagitta)) / _FACTOR)


def round_notes(file: files.ModelFile, name: str, hollow: bool = False) -> Iterator[str]:
    """How each solid with a sagitta is seen that a named one is made of, in words."""
    match file.solids[name]:
        case files.UnionTable(of=of):
            for target in of:
                yield from round_notes(file, target, hollow)
        case files.DifferenceTable(of=base, minus=minus):
            yield from round_notes(file, base, hollow)
            for target in minus:
                yield from round_notes(file, target, not hollow)
        case files.CylinderTable() | files.ConeTable() as table if table.sagitta is not None:
            yield (
                f"[solids.{name}] is seen as {round_solid(table, hollow).sides} sides "
                f"{'inside' if hollow else 'around'} its round surface, within {1e6 * table.sagitta:.3g} µm of it"
            )
