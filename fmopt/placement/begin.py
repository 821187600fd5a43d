"""How a sequence begins: a corner goes into the mouth at once, touches the top first, or the part lies flat on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.placement.entry import Entry, Leant
from fmopt.placement.explore import Freedom, Near, Place, guarded, insides, neighbourhood
from fmopt.placement.motion import Move, Reached
from fmopt.placement.step import Node, Task, son
from fmopt.se3 import Pose
from fmopt.values import Array


def begin(task: Task, entry: Entry) -> Node | None:
    """The state with a corner inside, None when the approach cannot be certified.

    With a pose above the mouth the corner first goes down to touch the top, or the part is laid flat there, and leaves
    it to get there.
    """
    place = Place(entry.start, (), (), entry.corner)
    # The approach itself is no transition.
    above = Node(entry, place, Reached(task.start, (), ()), (), (), -task.costs.transition, 0)
    if entry.over is None:
        return son(task, above, Move(entry.start, entry.inside, (), ()), "approach")
    if entry.leant is not None:
        return _from_flat(task, above, entry, entry.over, entry.leant)
    height = float(entry.start.apply(entry.corner)[2])
    down = Freedom("-z", np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0]), 1.5 * height)
    move = guarded(task.assembly, place, down, neighbourhood(task.assembly, place, down, task.costs.reach))
    touched = None if move is None else son(task, above, move, "approach", thorough=True)
    if touched is None:
        return None
    lifted = son(task, touched, Move(touched.place.pose, entry.over, (), (), touched.place.held), "leave")
    return None if lifted is None else son(task, lifted, Move(entry.over, entry.inside, (), ()), "enter")


def _from_flat(task: Task, above: Node, entry: Entry, over: Pose, leant: Leant) -> Node | None:
    """The state with a corner inside after the part has lain flat on the top, on one corner first, then on an edge."""
    node: Node | None = replace(above, place=replace(above.place, pivot=leant.edge[0]))
    height = float(entry.start.apply(leant.edge[0])[2])
    edge, face = (np.append(np.zeros(3), axis) for axis in leant.axes)
    down = Freedom("approach", np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0]), 1.5 * height)
    for freedom, corners in (
        (down, leant.edge[:1]),
        (Freedom("edge", edge, task.max_turn), leant.edge[1:]),
        (Freedom("face", face, task.max_turn), task.assembly.moving.polyhedron.vertices),
    ):
        node = None if node is None else _onto_top(task, node, freedom, corners)
    if node is None:
        return None
    flat, last = node.place.pose, node.moves[-1]
    lifted = flat.moved([0.0, 0.0, float(over.apply(entry.corner)[2]), 0.0, 0.0, 0.0])
    ways = (
        ("leave", flat, lifted, (*last.held, *last.making)),
        ("tilt", lifted, over, ()),
        ("enter", over, entry.inside, ()),
    )
    for name, at, to, left in ways:
        node = None if node is None else son(task, node, Move(at, to, (), (), left), name)
    return None if node is None else replace(node, place=replace(node.place, pivot=entry.corner))


def _onto_top(task: Task, node: Node, freedom: Freedom, corners: Array) -> Node | None:
    """The state after a guarded move that brings one of some corners (n, 3) of the body onto a face.

    Of several that come down together, one that comes down well inside the face counts, the farther the better, and
    where it leaves no margin the next.
    """
    assembly, start = task.assembly, node.place.pose
    vertices = assembly.moving.polyhedron.vertices
    near = [
        contact
        for contact in neighbourhood(assembly, node.place, freedom, task.costs.reach).contacts
        if contact.kind is Kind.VERTEX_FACE and (corners == vertices[contact.moving_feature]).all(axis=1).any()
    ]
    move = guarded(assembly, node.place, freedom, Near.of(assembly, near))
    if move is None:
        return None
    spread = float(node.reached.errors.support(np.eye(2, 6)).max())
    inside = insides(assembly, near, move.goal)
    heights = start.apply(vertices[[contact.moving_feature for contact in near]])[:, 2]
    # Of those that come together the last in the list is met first.
    order = sorted(range(len(near)), key=lambda n: (bool(inside[n] > spread), round(float(heights[n]), 9)))
    near = [near[n] for n in order]
    best: Node | None = None
    tried: set[PrimitiveContact] = set()
    for _ in near:
        move = guarded(assembly, node.place, freedom, Near.of(assembly, near))
        if move is not None and move.making[0] not in tried:
            tried.add(move.making[0])
            after = son(task, node, move, freedom.name, thorough=True)
            if after is not None and (best is None or after.reached.margin > best.reached.margin):
                best = after
        if best is not None and best.reached.margin > 0.0:
            break
        near.insert(0, near.pop())
    return best
