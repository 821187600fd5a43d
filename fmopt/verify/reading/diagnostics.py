"""What a plan tells of how it was found, as values: contact graphs, cut-diagrams, tolerated errors, planar sets."""

from __future__ import annotations

from dataclasses import dataclass

from fmopt.verify.reading.reader import Numbers

Point = tuple[float, float]
Polyline = tuple[Point, ...]


@dataclass(frozen=True)
class Interval:
    """S(t) from `start` to `end` (s): −1, 0, 1 or 2 for each degree of freedom x, y, z, rx, ry, rz."""

    start: float
    end: float
    s: tuple[int, ...]


@dataclass(frozen=True)
class State:
    """A contact state of a graph: its name there, the contacts that touch, and how many freedoms they leave."""

    id: str
    contacts: tuple[str, ...]
    dimension: int


@dataclass(frozen=True)
class Graph:
    """The contact graph of a critical point.

    Attributes:
        critical_point: what the point is called.
        states: its states.
        sons: of each state, by index.
        verdicts: what was found of each state on the true surfaces.
        chosen: the states that the motion goes through, by index, in order.
    """

    critical_point: str
    states: tuple[State, ...]
    sons: tuple[tuple[int, ...], ...]
    verdicts: tuple[str, ...]
    chosen: tuple[int, ...]


@dataclass(frozen=True)
class Visit:
    """A contact state that the motion comes to.

    Attributes:
        contacts: those that touch.
        segment: with which it begins, −1 for the start.
        change: how it begins: start, made, left, passed or unexplained.
        held_in: critical points, by index, and the name of the state in the graph of each.
    """

    contacts: tuple[str, ...]
    segment: int
    change: str
    held_in: tuple[tuple[int, str], ...]


@dataclass(frozen=True)
class DiagramPose:
    """The uncertain line L at a pose, in the plane of its cut-diagram.

    Attributes:
        name, time: of the pose, s.
        centre: nominal centre, m.
        line: nominal L, two points.
        ball: where the centre may be, four corners.
        cone: the two extreme directions, each as a line of two points.
        edges: the two long edges of the trapezoid, likewise.
        trapezoid: outline of all lines L.
    """

    name: str
    time: float
    centre: Point
    line: Polyline
    ball: Polyline
    cone: tuple[Polyline, ...]
    edges: tuple[Polyline, ...]
    trapezoid: Polyline


@dataclass(frozen=True)
class Diagram:
    """The cut-diagram of a plane.

    Attributes:
        plane: "xz", "yz" or "xy".
        radius, half_angle: of the uncertain zone, m and rad.
        fixed: loops of G, the material of operand 2.
        expanded: loops of GE, where the nominal centre cannot be.
        turning: loops of GE while operand 1 turns; None where it does not.
        room: distance of the seated centre from the sides of GE, m.
        path: P(t) in the plane.
        poses: L at the poses worth drawing.
    """

    plane: str
    radius: float
    half_angle: float
    fixed: tuple[Polyline, ...]
    expanded: tuple[Polyline, ...]
    turning: tuple[Polyline, ...] | None
    room: float
    path: Polyline
    poses: tuple[DiagramPose, ...]


@dataclass(frozen=True)
class HandMove:
    """A segment as the hand makes it: poses (6,) at its ends, twist (6,) and bias wrench (6,) of what is grasped."""

    start: Numbers
    goal: Numbers
    velocity: Numbers
    bias: Numbers


@dataclass(frozen=True)
class Hand:
    """The motion of the hand: what it has grasped, what stands, whether that is operand 2 and 1, and each segment."""

    grasped: str
    standing: str
    exchanged: bool
    segments: tuple[HandMove, ...]


@dataclass(frozen=True)
class Contribution:
    """What a source adds to the half-widths (6,) of the start errors, m and rad, and where that is fixed."""

    source: str
    symbol: str
    box: Numbers
    frame: str


@dataclass(frozen=True)
class Sensitivity:
    """What a tolerance of some value (m, rad or a share), wider by a step, adds to the margin, m; None if all fails."""

    name: str
    value: float
    step: float
    change: float | None


@dataclass(frozen=True)
class ToleranceEnd:
    """What fails first as start errors grow: in which move, the inequality without margin, or why it is impossible."""

    move: int
    binding: str
    reason: str


@dataclass(frozen=True)
class ErrorTolerance:
    """By which factor all start errors may grow, to which half-widths (6,), what each tolerance costs, what ends it."""

    factor: float
    start_box: Numbers
    sensitivities: tuple[Sensitivity, ...]
    end: ToleranceEnd | None


@dataclass(frozen=True)
class Reduced:
    """That the plan is for a share of the start errors that the problem states (6,), and what stops more of them."""

    share: float
    stated_start_box: Numbers
    short: str


@dataclass(frozen=True)
class Curve:
    """A piece of a boundary in the plane: a line (x, y, x, y) or an arc (x, y, radius, start, sweep), m and rad."""

    on: str
    line: Numbers | None
    arc: Numbers | None


@dataclass(frozen=True)
class Boundary:
    """A set in the plane by its boundary, and the polyline that it shrinks to without deviations, m."""

    name: str
    loops: tuple[tuple[Curve, ...], ...]
    nominal: Polyline


@dataclass(frozen=True)
class Slice:
    """A set of reference points at an orientation φ, rad."""

    phi: float
    boundary: Boundary


@dataclass(frozen=True)
class Surface:
    """Configurations at which a contact is possible, sliced over φ."""

    contact: str
    kind: str
    slices: tuple[Slice, ...]


@dataclass(frozen=True)
class Phase:
    """A part of a motion, gross, fine or blocked, and the contacts possible in it."""

    kind: str
    start: float
    end: float
    contacts: tuple[str, ...]


@dataclass(frozen=True)
class PlanarSegment:
    """What a segment is, and its parts, from 0 to 1."""

    kind: str
    phases: tuple[Phase, ...]


@dataclass(frozen=True)
class Agreement:
    """For how long (s) the sets allow a contact and S(t) stops a motion, both, neither or one, and what that says."""

    both: float
    neither: float
    only_possible: float
    only_stopped: float
    agrees: bool
    words: str


@dataclass(frozen=True)
class Planar:
    """What the planar sets of possible contact say.

    Attributes:
        position, angle: deviations at the start, m and rad.
        nominal: parts of the nominal trajectory, s.
        agreement: of these sets with S(t).
        segments: parts of each segment.
        aside, height: how far to the side and how far above its start the part is carried without a contact, m; the
            height is None beyond the size of the part.
        sets, surfaces: those worth drawing.
    """

    position: float
    angle: float
    nominal: tuple[Phase, ...]
    agreement: Agreement
    segments: tuple[PlanarSegment, ...]
    aside: float
    height: float | None
    sets: tuple[Boundary, ...]
    surfaces: tuple[Surface, ...]


@dataclass(frozen=True)
class Diagnostics:
    """What a plan tells of how it was found.

    Attributes:
        graphs: of the critical points, those of the motion first.
        sequence: the contact states that the motion comes to.
        diagrams: cut-diagrams of the T-C mapping.
        freedom_on_planes: S(t) as these show it.
        budget: where the start errors come from.
        measured_clearance: on each side along x and y, m; None where nothing stops the part.
        imported: what to know of parts that came as meshes.
        notes: what the plan leaves out, and why.
        hand: what the hand does, where that is not what the plan says of the moving part.
        tolerated: how much error the motion tolerates, where that was asked for.
        reduced: that the plan is for smaller errors than the problem states.
        planar: sets of possible contact, of a planar problem.
    """

    graphs: tuple[Graph, ...]
    sequence: tuple[Visit, ...]
    diagrams: tuple[Diagram, ...]
    freedom_on_planes: tuple[Interval, ...]
    budget: tuple[Contribution, ...]
    measured_clearance: tuple[float | None, float | None]
    imported: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    hand: Hand | None = None
    tolerated: ErrorTolerance | None = None
    reduced: Reduced | None = None
    planar: Planar | None = None


@dataclass(frozen=True)
class SearchedState:
    """A contact state that the search came to.

    Attributes:
        origin: number of the state that it was come to from; None where a way to begin ends in it.
        moves: the freedoms of the moves from there.
        contacts: that are held in it.
        freedoms: that are taken away in it.
        cost: of the way to it; None where a margin on it is so short that no cost is told.
        margin: the least on it, m.
        expanded: whether moves were looked for from it.
    """

    origin: int | None
    moves: tuple[str, ...]
    contacts: tuple[str, ...]
    freedoms: int
    cost: float | None
    margin: float
    expanded: bool


@dataclass(frozen=True)
class Search:
    """How the sequence of moves was found.

    Attributes:
        objective: what its cost is made of.
        cost, lower_bound, gap: of the sequence, of any, and their difference.
        states_expanded: states looked at.
        moves: the freedom of each move, "approach" or an axis with its sign.
        heading: turn about z of the axes that moves go along and about, rad.
        states: all states that were come to, in that order, before the way to begin was varied and poses were placed.
        way: numbers of those that the sequence goes through.
    """

    objective: str
    cost: float
    lower_bound: float
    gap: float
    states_expanded: int
    moves: tuple[str, ...]
    heading: float
    states: tuple[SearchedState, ...] = ()
    way: tuple[int, ...] = ()
