"""Executions of a plan on real parts: each face plane of both is moved and tilted within its tolerance of form.

What ends a move is the first touch of any of the contacts that it makes. Of the plan's promises those are looked at
that say something of the real parts: error sets, distances of pieces that no contact touches, contacts of the basis
inside their real features, moves neither too short nor too long.
"""

import copy
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from tests.shared.executions.errors import sources_of
from tests.shared.executions.geometry import Array, Poses, Scene, Touch, gaps, normal_of, unit
from tests.shared.executions.model import (
    FARTHEST,
    NOTHING_BOUNDS,
    OVERLAP,
    ROUNDING,
    Course,
    Piece,
    carried_out,
    first_zero,
    left,
)
from tests.shared.executions.promises import Ledger

Plan = dict[str, Any]
Plane = tuple[Array, float]

_SAME = 1e-9  # m
_PASSED = 1e-9  # m: a contact this near to its zero when its move starts is not made by it


def off_form(plan: Plan, rng: np.random.Generator, share: float = 1.0) -> Plan:
    """The plan with real parts in place of its own, off them by a share of their tolerances of form."""
    real = copy.deepcopy(plan)
    for side in ("moving", "fixed"):
        said = plan["parts"][side]
        real["parts"][side] = _moved(said, share * said.get("form", 0.0), rng)
    return real


def _moved(part: Plan, most: float, rng: np.random.Generator) -> Plan:
    points = np.array(part["vertices"])
    planes = [_plane(points, face[0]) for face in part["faces"]]
    steps = rng.choice([-1.0, 1.0], len(planes)) * rng.uniform(0.3, 1.0, len(planes))
    tilts = rng.normal(size=(len(planes), 3)) / np.ptp(points, axis=0).max()
    middles = [points[face[0]].mean(axis=0) for face in part["faces"]]
    found, scale = points, most
    for _ in range(4 if most else 0):
        moved = []
        for (n, _), middle, step, tilt in zip(planes, middles, steps, tilts, strict=True):
            normal = n + scale * (tilt - n * (tilt @ n))
            normal = normal / np.linalg.norm(normal)
            moved.append((normal, float(normal @ (middle + scale * step * n))))
        found = _met(points, part["faces"], planes, moved)
        farthest = max(float(np.linalg.norm(found - points, axis=1).max()), *_farthest(part, planes, moved))
        scale *= 0.999999 * most / farthest
    if not most:
        return part
    pieces = [
        {**piece, "vertices": _met(np.array(piece["vertices"]), piece["faces"], planes, moved).tolist()}
        for piece in part["pieces"]
    ]
    return {**part, "vertices": found.tolist(), "pieces": pieces}


def _farthest(part: Plan, planes: list[Plane], moved: list[Plane]) -> list[float]:
    """How far vertices of the pieces go at most."""
    found = []
    for piece in part["pieces"]:
        points = np.array(piece["vertices"])
        there = _met(points, piece["faces"], planes, moved)
        found.append(float(np.linalg.norm(there - points, axis=1).max()))
    return found


def _plane(points: Array, loop: list[int]) -> Plane:
    normal = normal_of(points[loop])
    return normal, float(normal @ points[loop[0]])


def _met(points: Array, faces: list[list[list[int]]], planes: list[Plane], moved: list[Plane]) -> Array:
    """Where the planes of faces (their own where they are in no moved one) meet in place of the points."""
    around: list[list[Plane]] = [[] for _ in points]
    for loops in faces:
        own = _plane(points, loops[0])
        for (n, o), there in zip(planes, moved, strict=True):
            if abs(own[0] @ n) > 1.0 - 1e-12 and abs(own[1] - float(own[0] @ n) * o) <= _SAME:
                own = there
                break
        for vertex in {v for loop in loops for v in loop}:
            around[vertex].append(own)
    found = points.copy()
    for vertex, own_planes in enumerate(around):
        N, o = np.array([n for n, _ in own_planes]), np.array([o for _, o in own_planes])
        found[vertex] += np.linalg.lstsq(N, o - N @ points[vertex], rcond=None)[0]
    return found


class _Any(NamedTuple):
    """What several contacts tell together: the least of their distances."""

    touches: list[Touch]

    def value(self, p: Array, R: Array) -> Array:
        return np.min([touch.value(p, R) for touch in self.touches], axis=0)


def execute(plan: Plan, real: Plan, count: int, seed: int, steps: int = 4) -> Ledger:
    """Runs executions of a plan on real parts, and checks what it promises of them."""
    nominal, scene = Scene(plan), Scene(real)
    through = partial(_through, steps=steps)
    return carried_out(plan, partial(_piece, nominal, scene), through, sources_of(plan), (count, seed))


def _piece(nominal: Scene, scene: Scene, k: int) -> Piece:
    """A piece of the plan whose contacts are those of the real parts."""
    piece = Piece(scene, k)
    basis = [b["contact"] for b in piece.said["basis"] if not b["made"]]
    piece.held = [scene.touches[name] for name in basis]
    if piece.made is not None:
        made = next(b["contact"] for b in piece.said["basis"] if b["made"])
        start = piece.p, piece.R
        new = [x for x in piece.said["goal_state"] if x not in piece.said["state"]] if piece.last else [made]
        group = [x for x in new if x == made or abs(float(nominal.touches[x].value(*start)[0])) > _PASSED]
        piece.made = _Any([scene.touches[x] for x in group])  # type: ignore[assignment]
        piece.way_row = Piece(nominal, k).way_row  # progress is told by the plan's own rows
    return piece


def _through(piece: Piece, ledger: Ledger, course: Course, steps: int) -> tuple[Array, Array]:
    def at(travel: Array) -> Poses:
        return course.at(piece, travel)[1]

    count, k = len(course.start), piece.number
    end = np.ones(count)
    if piece.made is not None:
        if piece.first:
            ledger.require("not made before its move", k, piece.touched(at(0.0 * end)))
        end = first_zero(left(piece, at), count, FARTHEST)
        ledger.require("gets there", k, FARTHEST - end)
        end = np.nan_to_num(end, nan=FARTHEST)
    for share in np.linspace(0.0, 1.0, steps + 1):
        commanded, poses = course.at(piece, share * end)
        _look(piece, ledger, poses)
    return piece.errors_at_goal(commanded), end


def _look(piece: Piece, ledger: Ledger, poses: Poses) -> None:
    scene, said, k = piece.scene, piece.said, piece.number
    basis = {b["contact"] for b in said["basis"]}
    single = {*said["state"]} <= basis and not said.get("leaving")
    for pair in said["separations"]:
        bodies = scene.moving[pair["moving_piece"]], scene.fixed[pair["fixed_piece"]]
        if pair["witness"]["kind"] == "plane":
            normal = unit(np.array(pair["witness"]["normal"]))
            own = (bodies[0].vertices @ poses[1].transpose(0, 2, 1) + poses[0][:, None]) @ normal
            room = own.min(axis=1) - float((bodies[1].vertices @ normal).max())
            ledger.require("separation", k, room - pair["margin"] + ROUNDING)
        elif single:
            ledger.require("overlap", k, gaps(*bodies, *poses) + OVERLAP)
    depths = {name: scene.touches[name].depths(*poses) for name in said["state"]}
    for entry in said["contacts"]:
        name = entry["id"]
        if entry["role"] == "held" and name in basis and entry["margin"] < NOTHING_BOUNDS:
            ledger.require(f"{name} inside", k, depths[name].min(axis=1) - entry["margin"] + ROUNDING)
