"""The contacts of a plan on its own geometry: where they touch at a pose, which way they press, how far they gape."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fmopt.errors import PlanFormatError
from fmopt.plan import Body, StatedPart
from fmopt.plan import StatedContact as Row
from fmopt.spatial.se3 import Pose, cross
from fmopt.spatial.values import Array, Value

_PARALLEL = 1e-9  # sine between edges that fix no normal
_LEVEL = 1e-3  # sine between edges that run level
_END = 1e-6  # m, by which edges may cross beyond their ends: at a corner rounding decides, and there both are held


@dataclass(frozen=True, eq=False)
class Contact(Value, moving=(None, 3), fixed=(None, 3), moving_normal=(3,), fixed_normal=(3,)):
    """One primitive contact.

    Args:
        kind: vertex-face, face-vertex, edge-edge or ball-face, the moving part's feature first.
        moving, fixed: vertices (n, 3) of the features, in the moving part and in B, m; of a ball its centre.
        moving_normal, fixed_normal: outward normals (3,) of a face, or the sum of those beside an edge; 0 for vertices.
        radius: of a ball, m.
    """

    name: str
    kind: str
    moving: Array
    fixed: Array
    moving_normal: Array
    fixed_normal: Array
    radius: float = 0.0

    def within(self, pose: Pose) -> bool:
        """Whether crossing edges cross between their ends, or at one of them; other contacts are not asked."""
        if self.kind != "edge-edge":
            return True
        p, u, q, v = self._edges(pose)
        at = zip(_nearest(p, u, q, v), (u, v), strict=True)
        return all(max(-share, share - 1.0) * float(np.linalg.norm(edge)) <= _END for share, edge in at)

    def level(self, pose: Pose) -> bool:
        """Whether its edges run level, so that they fix no normal; a face that lies there has others that do."""
        if self.kind != "edge-edge":
            return False
        _, u, _, v = self._edges(pose)
        return float(np.linalg.norm(cross(u, v))) < _LEVEL * float(np.linalg.norm(u) * np.linalg.norm(v))

    def above(self, point: Array) -> float:
        """How far a point (3,) in B is above the fixed face, m."""
        return float(self.fixed_normal @ (point - self.fixed[0]))

    def touch(self, pose: Pose) -> tuple[Array, Array, float]:
        """Point (3,) in B, unit normal (3,) out of the fixed part, and gap, m, negative when overlapping."""
        moving = pose.apply(self.moving)
        if self.kind == "vertex-face":
            return moving[0], self.fixed_normal, self.above(moving[0])
        if self.kind == "ball-face":
            point = moving[0] - self.radius * self.fixed_normal
            return point, self.fixed_normal, self.above(point)
        if self.kind == "face-vertex":
            normal = -pose.R @ self.moving_normal  # out of the moving part is into the fixed one
            return self.fixed[0], normal, float(normal @ (moving[0] - self.fixed[0]))
        return self._crossing(pose)

    def _edges(self, pose: Pose) -> tuple[Array, Array, Array, Array]:
        """An end and the span of the moving edge, and of the fixed one."""
        moving = pose.apply(self.moving)
        return moving[0], moving[1] - moving[0], self.fixed[0], self.fixed[1] - self.fixed[0]

    def _crossing(self, pose: Pose) -> tuple[Array, Array, float]:
        p, u, q, v = self._edges(pose)
        m = cross(u, v)
        size = float(np.linalg.norm(m))
        if size < _PARALLEL * float(np.linalg.norm(u) * np.linalg.norm(v)):
            message = f"the edges of contact {self.name} are parallel: it has no normal"
            raise PlanFormatError(message, "give a plan.json that fmopt solve wrote")
        # u × v may point either way; the sum of the normals beside a convex edge points outside.
        m = m / size if float(m @ self.fixed_normal) > 0.0 else -m / size
        s, t = _nearest(p, u, q, v)
        a, b = p + s * u, q + t * v
        # Both edges are at right angles to m, so that any two of their points give the gap.
        return 0.5 * (a + b), m, float(m @ (p - q))

    def wrench(self, pose: Pose) -> Array:
        """Reaction (6,) on the moving part for a unit normal force, about the moving frame's origin, axes of B."""
        point, normal, _ = self.touch(pose)
        return np.concatenate([normal, cross(point - pose.p, normal)])


def _nearest(p: Array, u: Array, q: Array, v: Array) -> tuple[float, float]:
    """Parameters of the points p + s u and q + t v of two lines that are nearest to each other."""
    # Three equations for two numbers: what they leave is the way between the points, the least there is.
    s, t = np.linalg.lstsq(np.column_stack([u, -v]), q - p, rcond=None)[0]
    return float(s), float(t)


class Parts(Protocol):
    """Two parts and contacts between them, as a plan has them."""

    @property
    def moving(self) -> StatedPart:
        """The moving part."""

    @property
    def fixed(self) -> StatedPart:
        """The fixed part."""

    @property
    def contacts(self) -> tuple[Row, ...]:
        """The contacts."""


def contacts(plan: Parts) -> dict[str, Contact]:
    """The contacts of a plan by their names.

    Raises:
        PlanFormatError: a face of a part has no normal.
    """
    sides = {"moving": _Side(plan.moving.body), "fixed": _Side(plan.fixed.body)}
    try:
        return {contact.id: _contact(contact, sides) for contact in plan.contacts}
    except ValueError as error:
        message = f"the plan's contacts cannot be taken: {error}"
        raise PlanFormatError(message, "give a plan.json that fmopt solve wrote") from error


class _Side:
    """Vertices of a part, and the faces that share some of them."""

    def __init__(self, body: Body) -> None:
        self.vertices = np.array(body.vertices, dtype=np.float64)
        self.faces, self.radii = body.faces, dict(body.balls)

    def normal(self, indices: Sequence[int]) -> Array:
        """Sum of the unit normals of the faces that hold all these vertices on one loop; 0 for a single vertex."""
        wanted, total = set(indices), np.zeros(3)
        for loops in self.faces if len(indices) > 1 else ():
            # On one loop: a vertex of the outline and one of a hole in it bound no edge of the face.
            if any(wanted <= set(loop) for loop in loops):
                # The outline comes first, counter-clockwise from outside; holes run the other way.
                total = total + self._face_normal(loops[0])
        return total

    def _face_normal(self, loop: Sequence[int]) -> Array:
        points = self.vertices[list(loop)]
        doubled = cross(points, np.roll(points, -1, axis=0)).sum(axis=0)
        size = float(np.linalg.norm(doubled))
        if not size > 0.0:
            raise ValueError(f"a face with vertices {list(loop)[:3]} has no normal")
        return np.asarray(doubled / size)


def _contact(row: Row, sides: Mapping[str, _Side]) -> Contact:
    indices = {"moving": list(row.moving), "fixed": list(row.fixed)}
    points = {side: sides[side].vertices[indices[side]] for side in sides}
    normals = {side: sides[side].normal(indices[side]) for side in sides}
    radius = sides["moving"].radii.get(row.moving[0], 0.0) if row.kind == "ball-face" else 0.0
    return Contact(row.id, row.kind, points["moving"], points["fixed"], normals["moving"], normals["fixed"], radius)
