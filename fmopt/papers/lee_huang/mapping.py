"""The T-C mapping of an insertion: from operands and goal to the three diagrams, P(t), and S(t) on the planes.

[LeeHuang1985] section 4.1: cut-diagrams G of operand 2 on the planes of the B-frame, expanded to GE while operand 1
shrinks to a line L, the nominal trajectory in what is left, and the uncertain line held against GE.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from fmopt.errors import GeometryError, InterferenceError
from fmopt.geometry.convex_pieces import pieces
from fmopt.geometry.csg import Solid, sagitta
from fmopt.geometry.plane.region import Region
from fmopt.papers.lee_huang.cut_diagram import cut_diagram, same, section_limit
from fmopt.papers.lee_huang.diagram import disc, of_region
from fmopt.papers.lee_huang.nominal_trajectory import NominalTrajectory, nearest_branch, through
from fmopt.papers.lee_huang.plane_freedom import OperandSlice, PlaneView, freedom_on_planes
from fmopt.papers.lee_huang.shrink_expand import expanded, expanded_over, frame, section_at
from fmopt.papers.lee_huang.swept import Body, checked, free_until
from fmopt.papers.lee_huang.uncertainty_zone import Zone, zones
from fmopt.papers.lee_huang.visibility import Sight, TurningSight, position_nodes, turning_nodes
from fmopt.plan.diagnostics import Diagram, DiagramPose, Interval
from fmopt.plan.field_types import Polyline, polyline
from fmopt.spatial.se3 import Pose, exp
from fmopt.spatial.values import Array, Value, frozen
from fmopt.task.object_model.command import Answer
from fmopt.task.object_model.tree import moved

_LEVEL = 1e-9  # m, heights of operand 1 closer than this are one
_INSIDE = 1e-6  # of a stretch: how far from its ends its sections are taken
_CHORD = 1e-6  # of the size: arcs that a corner or an edge meets become polylines within this
_ROOM = 1.01  # of how far the uncertain part strays: the height of N_2 above the mouth
_TURNING_ROOM = 1.25  # of that: what is kept free around a part that turns in one place, to prove that it is
_TURN_EARLY = 0.5  # share of the leg on which a part turns when it must be clear before the leg ends


@dataclass(frozen=True, eq=False)
class PlaneDiagrams(Value):
    """One plane of the mapping.

    Args:
        fixed: G, the cut-diagram of operand 2, in the plane's axes u, v, m.
        sections: sections of operand 1 about its nominal centre at the goal's orientation, each with the stretch of
            heights (m) that it stands for on the plane x-y; a stretch that tapers has two.
        expanded: GE for the goal's orientation; on x-y for the section that is in the plane at the goal.
        turning: GE over all orientations on the way to the goal's; None where operand 1 does not turn, and on x-y.
        starting: GE for the orientation at the start; None likewise.
    """

    zone: Zone
    fixed: Region
    sections: tuple[tuple[Region, tuple[float, float] | None], ...]
    expanded: Region
    turning: Region | None = None
    starting: Region | None = None

    @cached_property
    def views(self) -> tuple[PlaneView, ...]:
        """What S(t) asks of the plane: exact where operand 1 is a disc about its nominal centre, or nothing is round.

        Round edges that meet others become polylines within 1e-6 of the region's size, on the side of contact.
        """
        round_, other = [], []
        for region, heights in self.sections:
            own = disc(region)
            if own is None:
                other.append(OperandSlice(of_region(region, _CHORD * region.size), heights))
            else:
                round_.append(OperandSlice(own, heights))
        both = ((round_, 0.0), (other, _CHORD * self.fixed.size))
        return tuple(PlaneView(self.zone, of_region(self.fixed, chord), tuple(group)) for group, chord in both if group)


@dataclass(frozen=True, eq=False)
class Mapping(Value):
    """A finished T-C mapping: the diagrams on the planes x-z, y-z and x-y, P(t), and S(t) as the planes show it."""

    planes: tuple[PlaneDiagrams, ...]
    path: NominalTrajectory
    freedoms: tuple[Interval, ...]


def answered(found: Answer, box: ArrayLike, rho: float) -> Mapping:
    """The T-C mapping of a task as the knowledge base answers it, everything else of the workcell in place.

    What is linked to an operand moves or stands with it; obstacles stand, or where the operands were exchanged move.
    The box is half-widths (6,) of operand 1's pose error in the B-frame, m and rad, ρ the characteristic length, m.

    Raises:
        GeometryError, InterferenceError: as `task_mapping`.
    """
    movers: list[Body] = [(found.moving.ref.object, found.moving.whole)]
    standing: list[Body] = [(found.fixed.ref.object, found.fixed.whole)]
    # Where operands are exchanged, what stands in the workcell moves against operand 2 with operand 1.
    (movers if found.exchanged else standing).extend((other.name, other.solid) for other in found.obstacles)
    operands, speed = (found.moving.true, found.fixed.solid), found.task.specification.speed
    return task_mapping(MappingTask(*operands, found.P0, found.PT, box, speed, rho, movers, standing))


@dataclass(frozen=True, eq=False)
class MappingTask:
    """The T of a T-C mapping: the operands, where one goes in the other, how far it may be off, and how fast it is.

    Args:
        moving: operand 1 in its own frame, whose origin is the nominal centre.
        fixed: operand 2 in the B-frame.
        start: P(0) (6,), m and rad.
        box: half-widths (6,) of the pose error, m and rad.
        speed: of the specification, m/s.
        rho: characteristic length, m.
        movers: everything that moves, names and solids in operand 1's frame; operand 1 alone when empty.
        standing: everything that stands, in the B-frame; operand 2 alone when empty.
    """

    moving: Solid
    fixed: Solid
    start: ArrayLike
    goal: ArrayLike
    box: ArrayLike
    speed: float
    rho: float
    movers: Sequence[Body] = ()
    standing: Sequence[Body] = ()

    @property
    def bodies(self) -> tuple[Sequence[Body], Sequence[Body]]:
        """Everything that moves, and everything that stands."""
        return self.movers or [("operand 1", self.moving)], self.standing or [("operand 2", self.fixed)]


def task_mapping(task: MappingTask) -> Mapping:
    """The T-C mapping of a task.

    Raises:
        GeometryError: N₁ or N_T lies in GE, no path is visible, or operand 1 turns too near the mouth.
        InterferenceError: the motion meets something, on the planes or off them.
    """
    planes = plane_diagrams(task.moving, task.fixed, task.start, task.goal, task.box)
    # A margin for the whole part: any point of it may stray by so much, in any direction.
    half = frozen(task.box, 6, name="half-widths")
    radius = max(float(np.linalg.norm(piece.vertices, axis=1).max()) for piece in pieces(task.moving))
    margin = max(float(np.linalg.norm(half[:3]) + radius * np.linalg.norm(half[3:])), 1e-9)
    path = nominal_path(task, planes, margin)
    clear = free_until(*task.bodies, path, margin) if np.any(path.nodes[0, 3:] != path.nodes[-1, 3:]) else 0.0
    return Mapping(planes, path, freedom_on_planes([view for plane in planes for view in plane.views], path, clear))


def plane_diagrams(
    moving: Solid, fixed: Solid, start: ArrayLike, goal: ArrayLike, box: ArrayLike
) -> tuple[PlaneDiagrams, ...]:
    """G, the sections of operand 1 and GE on the three planes (m).

    Each operand is in its own frame, poses (6,) of operand 1 in that of operand 2, and the box half-widths (6,) of the
    pose error, all in m and rad, turns as rotation vectors.
    """
    P = np.asarray(goal, dtype=np.float64)
    first = nearest_branch(np.asarray(start, dtype=np.float64)[3:], P[3:])
    turned = moved(moving, Pose(np.zeros(3), exp(P[3:])))
    found: list[PlaneDiagrams] = []
    for zone in zones(box):
        upright = zone.plane.v == 2
        # The plane of the mouth runs in a face of operand 2: the hole counts as it is just below.
        G = cut_diagram(fixed, frame(zone.plane)) if upright else section_limit(fixed, frame(zone.plane), -1)
        sections = ((section_at(moving, zone.plane, P[3:]), None),) if upright else tuple(_levels(turned))
        seated = sections[0][0] if upright else _seated(sections, -float(P[2]))
        turning = starting = None
        if upright and np.any(first != P[3:]):
            turning = expanded_over(G, moving, zone.plane, first, P[3:])
            starting = expanded(G, [section_at(moving, zone.plane, first)])
        # In most parts x-z and y-z look alike: one expansion serves both.
        alike = (one.expanded for one in found if same(one.fixed, G) and same(one.sections[0][0], seated))
        found.append(PlaneDiagrams(zone, G, sections, next(alike, None) or expanded(G, [seated]), turning, starting))
    return tuple(found)


def nominal_path(task: MappingTask, planes: Sequence[PlaneDiagrams], margin: float) -> NominalTrajectory:
    """P(t) from pose to pose (6,): nodes visible in GE, turned before the mouth, the whole motion free in space.

    N₂ stands as high above the mouth as the uncertain part strays, if the start does, so that the way there is free.

    The part turns on the first leg, as in the paper, and where the uncertain part would still be near the mouth at the
    end of it, on its first half; where turning there meets something, on the next leg above the mouth. Where all that
    does, it turns in one place, which the diagrams for all its orientations leave free. The margin, m, is how far a
    point of the uncertain operand 1 strays.

    Raises:
        GeometryError: no visible path.
        InterferenceError: every such motion meets something; what the first of them meets.
    """
    first, last = np.asarray(task.start, dtype=np.float64), np.asarray(task.goal, dtype=np.float64)
    bodies, speed, rho = task.bodies, task.speed, task.rho
    # Twice the sagitta: polygons around round surfaces may be proud of them by so much on either side.
    room = _ROOM * margin + 2.0 * sum(sagitta(solid) for side in bodies for _, solid in side)

    def free(nodes: Sequence[Array], leg: int) -> NominalTrajectory:
        path = through(nodes, first[3:], last[3:], speed, rho, (leg, 1.0))
        # It still turns where the mouth is within reach: then it turns on half the leg.
        if np.any(path.nodes[0, 3:] != path.nodes[-1, 3:]) and free_until(*bodies, path, margin) < path.times[leg + 1]:
            path = through(nodes, first[3:], last[3:], speed, rho, (leg, _TURN_EARLY))
        checked(*bodies, path)
        return path

    sights = _sights(planes)
    try:
        return _on_a_leg(position_nodes(first[:3], last[:3], sights.goal, room), free)
    except (GeometryError, InterferenceError) as failure:
        if not np.any(first[3:] != last[3:]):
            raise
        try:
            return free(*turning_nodes(first[:3], last[:3], sights, _TURNING_ROOM * room))
        except (GeometryError, InterferenceError) as error:
            # What a motion meets says more than that there is no path.
            raise (failure if isinstance(failure, InterferenceError) else error) from error


def _on_a_leg(nodes: Sequence[Array], free: Callable[[Sequence[Array], int], NominalTrajectory]) -> NominalTrajectory:
    """P(t) that turns on the first leg above the mouth that is free; else what the first of them meets is raised."""
    failure: InterferenceError | None = None
    for leg in [k for k, (a, b) in enumerate(pairwise(nodes)) if min(a[2], b[2]) >= 0.0] or [0]:
        try:
            return free(nodes, leg)
        except InterferenceError as error:
            failure = failure or error
    assert failure is not None
    raise failure


def _sights(planes: Sequence[PlaneDiagrams]) -> TurningSight:
    """What the diagrams leave visible; for every orientation the same where operand 1 does not turn."""

    def sight(name: str) -> Sight:
        return Sight({plane.zone.plane.name: getattr(plane, name) or plane.expanded for plane in planes})

    return TurningSight(sight("starting"), sight("turning"), sight("expanded"))


def _levels(turned: Solid) -> list[tuple[Region, tuple[float, float]]]:
    """Sections of operand 1 across its axis: between neighbouring heights of its corners, near both ends of each."""
    heights = np.unique(np.concatenate([np.asarray(piece.vertices[:, 2]) for piece in pieces(turned)]))
    kept = heights[np.concatenate([[True], np.diff(heights) > _LEVEL])]
    found: list[tuple[Region, tuple[float, float]]] = []
    for low, high in pairwise(kept.tolist()):
        # Just inside the stretch: at its ends sections jump.
        inset = _INSIDE * (high - low)
        ends = [cut_diagram(turned, Pose(np.array([0.0, 0.0, z]), np.eye(3))) for z in (low + inset, high - inset)]
        # Between two levels of corners sections of a prism are one.
        same = abs(ends[0].area - ends[1].area) <= 1e-9 * max(ends[0].area, ends[1].area)
        found += [(end, (low, high)) for end in (ends[:1] if same else ends)]
    return found


def _seated(sections: Sequence[tuple[Region, tuple[float, float] | None]], height: float) -> Region:
    """The section of operand 1 at a height, of two stretches that meet there the lower."""
    found = (region for region, ends in sections if ends and ends[0] - _LEVEL <= height <= ends[1] + _LEVEL)
    return next(found, Region(()))


def diagrams(mapping: Mapping, length: float) -> tuple[Diagram, ...]:
    """The diagrams for plans and figures, curves as polylines within 1e-4 of the size of their loops; L in m."""
    return tuple(_diagram(plane, mapping.path, mapping.freedoms, length) for plane in mapping.planes)


def _diagram(diagrams: PlaneDiagrams, path: NominalTrajectory, freedoms: Sequence[Interval], length: float) -> Diagram:
    zone, plane = diagrams.zone, diagrams.zone.plane
    upright = plane.v == 2
    engaged = next((one.start for one in freedoms if one.start > 0.0 and any(one.s)), None)
    times = {"start": 0.0, **({} if engaged is None else {"first contact": engaged}), "goal": path.duration}
    poses = []
    for name, t in times.items():
        P = path.at(t)
        along = exp(P[3:])[:, 2][[plane.u, plane.v]]
        reach = length * float(np.linalg.norm(along)) if upright else 0.0
        angle = float(np.arctan2(along[1], along[0])) if upright else 0.5 * np.pi
        poses.append(_pose(name, t, zone, P[[plane.u, plane.v]], angle, reach))
    seat = path.nodes[-1, [plane.u, plane.v]]
    return Diagram(
        plane=plane.name,
        radius=zone.radius,
        half_angle=zone.half_angle,
        fixed=_loops(diagrams.fixed),
        expanded=_loops(diagrams.expanded),
        room=0.0 if diagrams.expanded.empty else float(diagrams.expanded.boundary_distance(seat)[0]),
        path=polyline(path.nodes[:, [plane.u, plane.v]]),
        poses=tuple(poses),
        turning=None if diagrams.turning is None else _loops(diagrams.turning),
    )


def _pose(name: str, t: float, zone: Zone, centre: Array, angle: float, length: float) -> DiagramPose:
    trapezoid = zone.trapezoid(centre, angle, length)
    return DiagramPose(
        name=name,
        time=t,
        centre=polyline(centre)[0],
        line=polyline(trapezoid.line(centre, angle)),
        ball=polyline(trapezoid.ball.corners),
        cone=tuple(polyline(trapezoid.line(centre, angle + side * zone.half_angle)) for side in (-1.0, 1.0)),
        edges=tuple(polyline(edge) for edge in trapezoid.edges),
        trapezoid=polyline(trapezoid.outline),
    )


def _loops(region: Region) -> tuple[Polyline, ...]:
    found = []
    for loop in region.loops:
        tolerance = 1e-4 * Region((loop,)).size
        found.append(polyline(np.vstack([curve.polyline(tolerance)[:-1] for curve in loop])))
    return tuple(found)
