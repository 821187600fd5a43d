"""How a plan was found: contact graphs, cut-diagrams, error budget and tolerance, planar sets, motion of the hand."""

from typing import Annotated

from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass

from fmopt.plan.field_types import (
    FORM,
    Flag,
    Freedom,
    HalfWidths,
    Index,
    Label,
    Line,
    Loops,
    Many,
    MotionKind,
    NonNegative,
    Number,
    Pair,
    Point,
    Polyline,
    Six,
    StateVerdict,
    check_indices,
    one_of,
)


@dataclass(frozen=True, config=FORM)
class Interval:
    """S(t) from `start` to `end` (s): −1, 0, 1 or 2 for each degree of freedom x, y, z, rx, ry, rz."""

    start: NonNegative
    end: NonNegative
    s: Annotated[tuple[Freedom, ...], Field(min_length=6, max_length=6)]


@dataclass(frozen=True, config=FORM)
class State:
    """A contact state of a graph: its name there, the contacts that touch, and how many freedoms they leave."""

    id: Label
    contacts: Many[Label]
    dimension: Annotated[Index, Field(le=6)]


@dataclass(frozen=True, config=FORM)
class Graph:
    """The contact graph of a critical point.

    Attributes:
        sons: of each state, by index.
        verdicts: what was found of each state on the true surfaces.
        chosen: the states that the motion goes through, by index, in order.
    """

    critical_point: Label
    states: Many[State]
    sons: Many[Many[Index]]
    verdicts: Many[StateVerdict]
    chosen: Many[Index]

    @model_validator(mode="after")
    def _check_sons(self) -> "Graph":
        if not len(self.states) == len(self.sons) == len(self.verdicts):
            raise ValueError("each state must have sons and a verdict")
        for what, indices in (("chosen", self.chosen), *(("sons", sons) for sons in self.sons)):
            check_indices(what, indices, len(self.states))
        return self


@dataclass(frozen=True, config=FORM)
class Visit:
    """A contact state that the motion comes to.

    It begins with a segment, −1 for the start; `held_in` has critical points, by index, and the name of each one's
    state in the graph.
    """

    contacts: Many[Label]
    segment: Annotated[int, Field(strict=True, ge=-1, lt=10**6)]
    change: Annotated[str, one_of("start", "made", "left", "passed", "unexplained")]
    held_in: Many[tuple[Index, Label]]


@dataclass(frozen=True, config=FORM)
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

    name: Annotated[str, one_of("start", "first contact", "goal")]
    time: NonNegative
    centre: Point
    line: Pair
    ball: Annotated[Polyline, Field(min_length=4, max_length=4)]
    cone: Annotated[tuple[Pair, ...], Field(min_length=2, max_length=2)]
    edges: Annotated[tuple[Pair, ...], Field(min_length=2, max_length=2)]
    trapezoid: Annotated[Polyline, Field(min_length=1)]


@dataclass(frozen=True, config=FORM)
class Diagram:
    """The cut-diagram of a plane.

    Attributes:
        radius, half_angle: of the uncertain zone, m and rad.
        fixed: loops of G, the material of operand 2.
        expanded: loops of GE, where the nominal centre cannot be.
        room: distance of the seated centre from the sides of GE, m.
        path: P(t) in the plane.
        poses: L at the poses worth drawing.
        turning: loops of GE while operand 1 turns; None where it does not.
    """

    plane: Annotated[str, one_of("xz", "yz", "xy")]
    radius: NonNegative
    half_angle: NonNegative
    fixed: Loops
    expanded: Loops
    room: NonNegative
    path: Annotated[Polyline, Field(min_length=1)]
    poses: Annotated[tuple[DiagramPose, ...], Field(min_length=1, max_length=3)]
    turning: Loops | None = None


@dataclass(frozen=True, config=FORM)
class HandMove:
    """A segment as the hand makes it: poses (6,) at its ends, twist (6,) and bias wrench (6,) of what is grasped."""

    start: Six
    goal: Six
    velocity: Six
    bias_wrench: Six


@dataclass(frozen=True, config=FORM)
class Hand:
    """The motion of the hand: what it has grasped, what stands, whether that is operand 2 and 1, and each segment."""

    grasped: Line
    standing: Line
    exchanged: Flag
    segments: Many[HandMove]


@dataclass(frozen=True, config=FORM)
class SourceContribution:
    """What a source adds to the half-widths (6,) of the start errors, m and rad, and where that is fixed."""

    source: Line
    symbol: Line
    box: HalfWidths
    frame: Annotated[str, one_of("hole", "hand", "world")]


@dataclass(frozen=True, config=FORM)
class Sensitivity:
    """What one tolerance, or the clearance on each side, adds to the margin when it is wider.

    Attributes:
        name: of the component: "start.x", "velocity.translation", "clearance".
        value: what it is, in m, rad or as a fraction.
        step: by how much it was widened, in the same unit.
        change: what the margin gained by that, m; a loss is negative. None when the motion fails altogether.
    """

    name: Annotated[str, Field(pattern=r"^(start\.r?[xyz]|velocity\.(translation|rotation)|clearance)$")]
    value: Number
    step: Number
    change: Number | None = None

    @model_validator(mode="after")
    def _check_step(self) -> "Sensitivity":
        if self.step == 0.0:
            raise ValueError("step must not be 0")
        return self


@dataclass(frozen=True, config=FORM)
class ToleranceEnd:
    """What fails first as start errors grow.

    Attributes:
        move: counts from 0.
        binding: the inequality whose margin is gone, as claims name it; empty where the move becomes impossible.
        reason: why the move becomes impossible; empty where it has a margin.
    """

    move: Index
    binding: Line
    reason: Line


@dataclass(frozen=True, config=FORM)
class ErrorTolerance:
    """How much error a placed motion tolerates.

    Attributes:
        factor: by how much all start errors together may grow before the margin is gone; below 1 where it is now.
        start_box: half-widths (6,) of the start error at that factor, m and rad.
        sensitivities: of the margin, one for each error that the problem states, and for the clearance.
        end: what fails at the least factor that was found too large; None where none was.
    """

    factor: NonNegative
    start_box: HalfWidths
    sensitivities: Annotated[tuple[Sensitivity, ...], Field(max_length=9)]
    end: ToleranceEnd | None = None


@dataclass(frozen=True, config=FORM)
class Reduced:
    """That the plan is for a share of the start errors that the problem states (6,), and what stops more of them."""

    share: Annotated[NonNegative, Field(le=1.0)]
    stated_start_box: HalfWidths
    short: Line


@dataclass(frozen=True, config=FORM)
class Curve:
    """A piece of a boundary in the plane: a line (x, y, x, y) or an arc (x, y, radius, start, sweep), m and rad."""

    on: Annotated[str, one_of("r_M", "r_m", "g_M", "g_m", "n", "line")]
    line: tuple[Number, Number, Number, Number] | None = None
    arc: tuple[Number, Number, Number, Number, Number] | None = None

    @model_validator(mode="after")
    def _check_kind(self) -> "Curve":
        if (self.line is None) == (self.arc is None):
            raise ValueError("must be either a line or an arc")
        return self


@dataclass(frozen=True, config=FORM)
class Boundary:
    """A set in the plane by its boundary, and the polyline that it shrinks to without deviations, m."""

    name: Line
    loops: Many[Annotated[Many[Curve], Field(min_length=1)]]
    nominal: Polyline


@dataclass(frozen=True, config=FORM)
class Slice:
    """A set of reference points at an orientation φ, rad."""

    phi: Number
    boundary: Boundary


@dataclass(frozen=True, config=FORM)
class Surface:
    """Configurations at which a contact is possible, sliced over φ."""

    contact: Label
    kind: Annotated[str, one_of("type-1", "type-2")]
    slices: Annotated[tuple[Slice, ...], Field(min_length=1, max_length=256)]


@dataclass(frozen=True, config=FORM)
class Phase:
    """A part of a motion, gross, fine or blocked, and the contacts possible in it."""

    kind: MotionKind
    start: NonNegative
    end: NonNegative
    contacts: Many[Label]


@dataclass(frozen=True, config=FORM)
class PlanarSegment:
    """What a segment is, and its parts, from 0 to 1."""

    kind: MotionKind
    phases: Annotated[Many[Phase], Field(min_length=1)]


@dataclass(frozen=True, config=FORM)
class Agreement:
    """For how long (s) the sets allow a contact and S(t) stops a motion, both, neither or one, and what that says."""

    both: NonNegative
    neither: NonNegative
    only_possible: NonNegative
    only_stopped: NonNegative
    agrees: Flag
    words: Line


@dataclass(frozen=True, config=FORM)
class Planar:
    """What the planar sets of possible contact say.

    Attributes:
        position, angle: deviations at the start, m and rad.
        nominal: parts of the nominal trajectory, s.
        sets, surfaces: those worth drawing.
        aside, height: how far to the side and how far above its start the part is carried without a contact, m; the
            height is None beyond the size of the part.
    """

    position: NonNegative
    angle: NonNegative
    nominal: Annotated[Many[Phase], Field(min_length=1)]
    agreement: Agreement
    segments: Annotated[Many[PlanarSegment], Field(min_length=1)]
    sets: Annotated[tuple[Boundary, ...], Field(max_length=64)]
    surfaces: Annotated[tuple[Surface, ...], Field(max_length=64)]
    aside: NonNegative
    height: Number | None = None


@dataclass(frozen=True, config=FORM)
class UnplannedContact:
    """A contact that larger errors would make first, in a move by number.

    Attributes:
        kind, moving, fixed: the contact, by vertex indices of the parts.
        factor: of the start errors, with which it is made.
        axis, axis_factor: the degree whose start error makes it alone, and by which factor; empty and None for none.
        wrench: of a unit reaction, (6,).
        angle: to the wrench of the contact wanted, rad; None where none is.
        told: whether it can be told from the contact wanted.
    """

    move: Index
    kind: Label
    moving: Annotated[Many[Index], Field(min_length=1)]
    fixed: Annotated[Many[Index], Field(min_length=1)]
    factor: NonNegative
    wrench: Six
    told: Flag
    axis: Annotated[str, one_of("x", "y", "z", "rx", "ry", "rz", "")] = ""
    axis_factor: NonNegative | None = None
    angle: NonNegative | None = None


@dataclass(frozen=True, config=FORM)
class Diagnostics:
    """How a plan was found.

    Attributes:
        graphs: of the critical points, those of the motion first.
        sequence: the contact states that the motion comes to.
        freedom_on_planes: S(t) as the diagrams show it.
        budget: where the start errors come from.
        measured_clearance: on each side along x and y, m; None where nothing stops the part.
        imported: what to know of parts that came as meshes.
        notes: what the plan leaves out, and why.
        hand: what the hand does, where that is not what the plan says of the moving part.
        tolerated: how much error the motion tolerates, where that was asked for.
        reduced: that the plan is for smaller errors than the problem states.
        unplanned: contacts that moves do not plan and larger errors would make, in the order of the moves.
    """

    graphs: Many[Graph]
    sequence: Many[Visit]
    diagrams: Annotated[tuple[Diagram, ...], Field(max_length=3)]
    freedom_on_planes: Many[Interval]
    budget: Annotated[tuple[SourceContribution, ...], Field(max_length=256)]
    measured_clearance: tuple[Number | None, Number | None]
    imported: Many[Line] = ()
    notes: Many[Line] = ()
    hand: Hand | None = None
    tolerated: ErrorTolerance | None = None
    reduced: Reduced | None = None
    planar: Planar | None = None
    unplanned: Many[UnplannedContact] = ()
