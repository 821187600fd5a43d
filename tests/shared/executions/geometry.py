"""True geometry for simulated executions: overlap of convex pieces, and contacts as exact functions of the pose.

Arrays run over executions first: positions p (n, 3) in m, rotation matrices R (n, 3, 3).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Poses = tuple[Array, Array]


def hats(w: Array) -> Array:
    """Matrices [w]× of vectors (n, 3)."""
    K = np.zeros((len(w), 3, 3))
    K[:, 2, 1], K[:, 0, 2], K[:, 1, 0] = w[:, 0], w[:, 1], w[:, 2]
    return K - K.transpose(0, 2, 1)


def rotations(r: Array) -> Array:
    """Rotation matrices of rotation vectors (n, 3), Rodrigues' formula."""
    half = 0.5 * np.sqrt(dots(r, r))
    s = np.sinc(half / np.pi)
    K = hats(r)
    return np.asarray(np.eye(3) + (s * np.cos(half))[:, None, None] * K + (0.5 * s * s)[:, None, None] * (K @ K))


def vectors(R: Array) -> Array:
    """Rotation vectors of rotation matrices (n, 3, 3), angles below π."""
    s = 0.5 * np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1)
    angle = np.arctan2(np.linalg.norm(s, axis=1), 0.5 * (np.trace(R, axis1=1, axis2=2) - 1.0))
    return np.asarray(s / np.sinc(angle / np.pi)[:, None])


def unit(a: Array) -> Array:
    """Vectors (…, 3) over their lengths."""
    return np.asarray(a / np.linalg.norm(a, axis=-1, keepdims=True))


def cross(a: Array, b: Array) -> Array:
    """a × b of vectors (…, 3); a good deal faster than NumPy's for the small arrays here."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def dots(a: Array, b: Array) -> Array:
    """a·b (n,) of vectors (n, 3)."""
    return np.asarray((a * b).sum(axis=-1))


def normal_of(loop: Array) -> Array:
    """Unit normal of a plane polygon (k, 3), counter-clockwise seen from outside."""
    return unit(np.cross(loop - loop[0], np.roll(loop, -1, axis=0) - loop[0]).sum(axis=0))


@dataclass(frozen=True, eq=False)
class Convex:
    """A convex piece: vertices (v, 3), planes n·x ≤ a as rows (n, a), normals and edge directions, each once.

    `sides` are the ends (k, 2, 3) of its edges; a ball has its centre for a vertex, a radius, and none of the rest.
    """

    vertices: Array
    outward: Array
    normals: Array
    directions: Array
    sides: Array
    radius: float = 0.0

    @staticmethod
    def read(document: dict[str, Any]) -> "Convex":
        """The piece of a plan file."""
        vertices = np.array(document["vertices"], dtype=float)
        loops = [face[0] for face in document["faces"]]
        sides = [vertices[b] - vertices[a] for loop in loops for a, b in zip(loop, loop[1:] + loop[:1], strict=True)]
        normals = np.array([normal_of(vertices[x]) for x in loops])
        offsets = [n @ vertices[x[0]] for n, x in zip(normals, loops, strict=True)]
        ends = np.array([vertices[[a, b]] for loop in loops for a, b in zip(loop, loop[1:] + loop[:1], strict=True)])
        outward = np.column_stack([normals, offsets])
        return Convex(vertices, outward, _once(normals), _once(unit(np.array(sides))), ends)

    @staticmethod
    def ball(centre: Sequence[float], radius: float) -> "Convex":
        """A ball."""
        none = np.zeros((0, 3))
        return Convex(np.array([centre], dtype=float), np.zeros((0, 4)), none, none, np.zeros((0, 2, 3)), radius)

    def holds(self, x: Array) -> bool:
        """Whether a point (3,) is in the piece or within a nanometre of it."""
        return bool(np.all(self.outward[:, :3] @ x <= self.outward[:, 3] + 1e-9))


def _once(directions: Array) -> Array:
    kept: list[Array] = []
    for d in directions:
        if all(np.linalg.norm(np.cross(d, k)) > 1e-12 for k in kept):
            kept.append(d)
    return np.array(kept)


def gaps(moving: Convex, fixed: Convex, p: Array, R: Array) -> Array:
    """Width (n,) of the widest slab between the pieces; where all slabs overlap, minus the depth of penetration.

    Two convex polyhedra are apart exactly when a face normal or a cross product of two edges separates them.
    """
    if moving.radius:
        return _beside_ball(p + R @ moving.vertices[0], fixed) - moving.radius
    turned = moving.normals @ R.transpose(0, 2, 1)
    standing = np.broadcast_to(fixed.normals, (len(p), *fixed.normals.shape))
    best = _slabs(moving, fixed, p, R, np.concatenate([turned, standing], axis=1))
    left = np.flatnonzero(best < 0.0)
    if len(left):
        sides = moving.directions @ R[left].transpose(0, 2, 1)
        axes = cross(sides[:, :, None, :], fixed.directions[None, None]).reshape(len(left), -1, 3)
        size = np.linalg.norm(axes, axis=2, keepdims=True)
        axes = np.where(size > 1e-9, axes / np.maximum(size, 1e-9), turned[left, :1])
        best[left] = np.maximum(best[left], _slabs(moving, fixed, p[left], R[left], axes))
    return best


def _beside_ball(x: Array, fixed: Convex) -> Array:
    """Distances (n,) of points from a piece; inside, minus how far it is to the nearest face.

    The nearest point is the foot on a face, or lies on an edge.
    """
    heights = (x @ fixed.outward[:, :3].T - fixed.outward[:, 3]).max(axis=1)
    a, along = fixed.sides[:, 0], fixed.sides[:, 1] - fixed.sides[:, 0]
    share = np.clip(dots(x[:, None] - a, along) / dots(along, along), 0.0, 1.0)
    near = np.linalg.norm(x[:, None] - a - share[:, :, None] * along, axis=2).min(axis=1)
    foot = x[:, None] - (x @ fixed.outward[:, :3].T - fixed.outward[:, 3])[:, :, None] * fixed.outward[:, :3]
    on = (foot @ fixed.outward[:, :3].T <= fixed.outward[:, 3] + 1e-12).all(axis=2)
    over = np.where(on, x @ fixed.outward[:, :3].T - fixed.outward[:, 3], -np.inf).max(axis=1)
    return np.where(heights <= 0.0, heights, np.where(over > 0.0, np.minimum(over, near), near))


def _slabs(moving: Convex, fixed: Convex, p: Array, R: Array, axes: Array) -> Array:
    mine = axes @ (moving.vertices @ R.transpose(0, 2, 1) + p[:, None]).transpose(0, 2, 1)
    theirs = axes @ fixed.vertices.T
    apart = np.maximum(mine.min(axis=2) - theirs.max(axis=2), theirs.min(axis=2) - mine.max(axis=2))
    return np.asarray(apart.max(axis=1))


class Touch:
    """A contact as an exact function of the pose: f > 0 apart, f = 0 in touch.

    Args:
        kind: "vertex-face", "ball-face", "face-vertex", "edge-edge", or "hinge": the edge (a, b), of which a stays in a
            fixed plane that holds the fixed edge, meets that edge's line exactly when b is in the plane too.
        moving, fixed: points (k, 3) of the two features, in the frames of their parts; a face by its outer loop.
        counted: which bounds of the fixed feature count (sides of a face, ends of an edge); others lead into material.
        radius: of a ball about the moving point, m.
    """

    def __init__(self, kind: str, moving: Array, fixed: Array, counted: Array, radius: float = 0.0) -> None:
        self.kind, self.moving, self.fixed, self.counted, self.radius = kind, moving, fixed, counted, radius
        if kind == "edge-edge":
            self.side, self.along = unit(moving[1] - moving[0]), unit(fixed[1] - fixed[0])
        elif kind != "direction":
            self.normal = normal_of(moving if kind == "face-vertex" else fixed)

    def value(self, p: Array, R: Array) -> Array:
        """f (n,) in m; for crossing edges the distance of their lines times the sine of their angle."""
        if self.kind in ("vertex-face", "ball-face"):
            return np.asarray((p + R @ self.moving[0] - self.fixed[0]) @ self.normal) - self.radius
        if self.kind == "hinge":
            return np.asarray((R @ (self.moving[1] - self.moving[0])) @ self.normal)
        if self.kind == "direction":
            return np.asarray((R @ self.moving[0]) @ self.fixed[0])
        if self.kind == "face-vertex":
            return np.asarray(dots(R @ self.normal, self.fixed[0] - p - R @ self.moving[0]))
        m, r, _ = self._crossing(p, R)
        return dots(m, r)

    def row(self, p: Array, R: Array) -> Array:
        """Gradient (n, 6) of f in (d, δ): p ↦ p + d, R ↦ exp([δ]×) R."""
        if self.kind in ("vertex-face", "ball-face"):
            n = np.broadcast_to(self.normal, p.shape)
            return np.hstack([n, cross(R @ self.moving[0], n)])
        if self.kind == "hinge":
            n = np.broadcast_to(self.normal, p.shape)
            return np.hstack([0.0 * n, cross(R @ (self.moving[1] - self.moving[0]), n)])
        if self.kind == "direction":
            u = np.broadcast_to(self.fixed[0], p.shape)
            return np.hstack([0.0 * u, cross(R @ self.moving[0], u)])
        if self.kind == "face-vertex":
            n = R @ self.normal
            return np.hstack([-n, cross(n, self.fixed[0] - p)])
        m, r, side = self._crossing(p, R)
        return np.hstack([m, cross(side, cross(self.along, r)) + cross(R @ self.moving[0], m)])

    def _crossing(self, p: Array, R: Array) -> tuple[Array, Array, Array]:
        side = R @ self.side
        return cross(side, self.along), p + R @ self.moving[0] - self.fixed[0], side

    def depths(self, p: Array, R: Array) -> Array:
        """How far inside each bound of its features the touching point is, m; infinite where nothing bounds it.

        Bounds (n, k): sides of the face in the order of its loop; or both ends of the moving, then of the fixed edge.
        """
        if self.kind in ("vertex-face", "ball-face"):
            inward = np.cross(self.normal[None], unit(np.roll(self.fixed, -1, axis=0) - self.fixed))
            depth = (p + R @ self.moving[0]) @ inward.T - dots(self.fixed, inward)
            return np.where(self.counted, depth, np.inf)
        if self.kind == "face-vertex":
            inward = np.cross(self.normal[None], unit(np.roll(self.moving, -1, axis=0) - self.moving))
            return np.einsum("ni,nij,kj->nk", self.fixed[0] - p, R, inward) - dots(self.moving, inward)
        m, r, u = self._crossing(p, R)
        square = dots(m, m)
        parallel = square < 1e-8
        square = np.where(parallel, 1.0, square)
        c, ru, rf = u @ self.along, dots(r, u), r @ self.along
        s, t = (c * rf - ru) / square, (rf - c * ru) / square
        long, wide = (float(np.linalg.norm(x[1] - x[0])) for x in (self.moving, self.fixed))
        depth = np.stack([s, long - s, t, wide - t], axis=1)
        return np.where(parallel[:, None] | ~np.array([True, True, *self.counted]), np.inf, depth)


def _sides(loop: list[int]) -> list[set[int]]:
    """The ends of the sides of a loop."""
    return [{a, b} for a, b in zip(loop, loop[1:] + loop[:1], strict=True)]


class Scene:
    """Parts and contacts of a plan file."""

    def __init__(self, plan: dict[str, Any]) -> None:
        self.plan = plan
        self.rho = plan["uncertainty"]["rho"]
        self.moving, self.fixed = ([Convex.read(q) for q in plan["parts"][x]["pieces"]] for x in ("moving", "fixed"))
        points = {x: np.array(plan["parts"][x]["vertices"]) for x in ("moving", "fixed")}
        balls = {ball["vertex"]: ball["radius"] for ball in plan["parts"]["moving"].get("balls", ())}
        self.moving += [Convex.ball(points["moving"][n], radius) for n, radius in balls.items()]
        self.points, faces = points["fixed"], plan["parts"]["fixed"]["faces"]
        self.body = points["moving"]
        self.body_loops = [loop for face in plan["parts"]["moving"]["faces"] for loop in face[:1]]
        rings = [(face[0], loop) for face in faces for loop in face]
        self.beyond = {(a, b): outer for outer, loop in rings for a, b in zip(loop, loop[1:] + loop[:1], strict=True)}
        self.corners = {c["id"]: (c["moving"]["vertices"], c["fixed"]["vertices"]) for c in plan["contacts"]}
        self.touches = {
            c["id"]: Touch(
                c["kind"],
                points["moving"][c["moving"]["vertices"]],
                points["fixed"][c["fixed"]["vertices"]],
                self._counted(c["kind"], c["fixed"]["vertices"]),
                balls.get(c["moving"]["vertices"][0], 0.0),
            )
            for c in plan["contacts"]
        }
        self.hinges: dict[tuple[str, str], Touch | None] = {}

    def touch(self, name: str, together: Sequence[str]) -> Touch:
        """A contact's function where the contacts `together` are held: an edge on a wall becomes a hinge."""
        if self.touches[name].kind == "edge-edge":
            for other in together:
                if self.touches[other].kind == "vertex-face" and self.corners[other][0][0] in self.corners[name][0]:
                    hinge = self._hinge(name, other)
                    if hinge is not None:
                        return hinge
        return self.touches[name]

    def measure(self, name: str, held: Sequence[str]) -> Touch:
        """What tells how far a contact is from being made where others are held: a direction where that is enough.

        A vertex of an edge held on a rim of its wall touches as the edge lies in the wall, an edge of a body face
        another edge of which is held on the same rim as that face is level with the rim.
        """
        for other in held:
            if self.touches[other].kind != "edge-edge" or self.touch(other, held).kind == "hinge":
                continue
            if self.touches[name].kind == "vertex-face" and self.corners[name][0][0] in self.corners[other][0]:
                hinge = self._hinge(other, name)
                if hinge is not None:
                    return Touch("hinge", hinge.moving[::-1], hinge.fixed, hinge.counted)
        for other in held:
            level = self._level(name, other)
            if level is not None and self.touch(name, held).kind == "edge-edge":
                return level
        return self.touch(name, held)

    def _level(self, name: str, other: str) -> Touch | None:
        one, two = self.touches[name], self.touches[other]
        if one.kind != "edge-edge" or two.kind != "edge-edge" or name == other:
            return None
        if set(self.corners[name][1]) != set(self.corners[other][1]):
            return None
        ends = self.corners[name][0], self.corners[other][0]
        faces = [loop for loop in self.body_loops if all(set(edge) in _sides(loop) for edge in ends)]
        if len(faces) != 1:
            return None
        normal = normal_of(self.body[faces[0]])
        # The face's height under the rim, towards the edge that is to come: positive where the two are apart.
        reach = dots(one.moving - two.moving[0], cross(unit(two.moving[1] - two.moving[0]), normal))
        far = reach[np.argmax(np.abs(reach))] * normal
        return Touch("direction", np.array([far]), np.array([two.along]), two.counted)

    def _hinge(self, name: str, other: str) -> Touch | None:
        if (name, other) not in self.hinges:
            self.hinges[name, other] = self._as_hinge(name, other)
        return self.hinges[name, other]

    def _as_hinge(self, name: str, other: str) -> Touch | None:
        edge, wall = self.touches[name], self.touches[other]
        if np.abs((edge.fixed - wall.fixed[0]) @ wall.normal).max() > 1e-12:
            return None
        order = [0, 1] if self.corners[other][0][0] == self.corners[name][0][0] else [1, 0]
        return Touch("hinge", edge.moving[order], wall.fixed, edge.counted)

    def turns(self, names: Sequence[str]) -> list[tuple[str, int, str, int]]:
        """Which contacts take turns: a vertex on a face and its side, an edge across that side and its end."""
        kinds = {k: [x for x in names if self.touches[x].kind == k] for k in ("vertex-face", "edge-edge")}
        found = []
        for vertex in kinds["vertex-face"]:
            (v,), loop = self.corners[vertex]
            sides = [{a, b} for a, b in zip(loop, loop[1:] + loop[:1], strict=True)]
            for edge in kinds["edge-edge"]:
                ends, rim = self.corners[edge]
                if v in ends and set(rim) in sides:
                    found.append((vertex, sides.index(set(rim)), edge, ends.index(v)))
        return found

    def _counted(self, kind: str, corners: list[int]) -> Array:
        """Convex sides of a face; ends of an edge beyond which there is no material."""
        x = self.points[corners]
        if kind == "edge-edge":
            beyond = x + 1e-6 * unit(np.array([x[0] - x[1], x[1] - x[0]]))
            return np.array([not any(q.holds(y) for q in self.fixed) for y in beyond])
        n, convex = normal_of(x), []
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            inward = np.cross(normal_of(self.points[self.beyond[b, a]]), self.points[a] - self.points[b])
            convex.append(bool(inward @ n < 0.0))
        return np.array(convex)
