"""From JSON to what a plan tells of how it was found.

From JSON to the planar sets of possible contact that a plan tells of.
"""

from __future__ import annotations

from fmopt.verify.reading.diagnostics import (
    Agreement,
    Boundary,
    Contribution,
    Curve,
    Diagnostics,
    Diagram,
    DiagramPose,
    ErrorTolerance,
    Graph,
    Hand,
    HandMove,
    Phase,
    Planar,
    PlanarSegment,
    Polyline,
    Reduced,
    Sensitivity,
    Slice,
    State,
    Surface,
    ToleranceEnd,
    Visit,
)
from fmopt.verify.reading.parse_segments import STATE_VERDICTS, read_interval
from fmopt.verify.reading.reader import FIXED_IN, MOST, Fields, Reader, fields

PHASES = ("gross", "fine", "blocked")
CARRIERS = ("r_M", "r_m", "g_M", "g_m", "n", "line")
CONTACT_KINDS = ("type-1", "type-2")
_IN_PLANE = "diagnostics.planar"
_PLANAR = fields(_IN_PLANE, objects="deviations nominal agreement segments carry sets surfaces")
_DEVIATIONS = fields(f"{_IN_PLANE}.deviations", commentary="position angle")
_PHASE = fields(f"{_IN_PLANE}.nominal[]", commentary="kind start end contacts")
_SEGMENT = fields(f"{_IN_PLANE}.segments[]", commentary="kind", objects="phases")
_PART = fields(f"{_IN_PLANE}.segments[].phases[]", commentary="kind start end contacts")
_AGREEMENT = fields(f"{_IN_PLANE}.agreement", commentary="both neither only_possible only_stopped agrees words")
_CARRY = fields(f"{_IN_PLANE}.carry", commentary="aside height")
_SET = fields(f"{_IN_PLANE}.sets[]", commentary="name nominal", objects="loops")
_CURVE = fields(f"{_IN_PLANE}.sets[].loops[][]", commentary="on line arc", optional=("line", "arc"))
_SURFACE = fields(f"{_IN_PLANE}.surfaces[]", commentary="contact kind", objects="slices")
_SLICE = fields(f"{_IN_PLANE}.surfaces[].slices[]", commentary="phi name nominal", objects="loops")
_CUT = fields(f"{_IN_PLANE}.surfaces[].slices[].loops[][]", commentary="on line arc", optional=("line", "arc"))
PLANAR_FIELDS: tuple[Fields, ...] = (
    _PLANAR, _DEVIATIONS, _PHASE, _SEGMENT, _PART, _AGREEMENT, _CARRY, _SET, _CURVE, _SURFACE, _SLICE, _CUT,
)  # fmt: skip

PLANES = ("xz", "yz", "xy")
CHANGES = ("start", "made", "left", "passed", "unexplained")
POSES = ("start", "first contact", "goal")
_WHERE = "diagnostics"
_TOP = fields(
    _WHERE,
    commentary="imported notes",
    objects="graphs sequence diagrams freedom_on_planes budget clearance hand tolerated reduced planar",
    optional=("imported", "notes", "hand", "tolerated", "reduced", "planar"),
)
_GRAPH = fields(f"{_WHERE}.graphs[]", commentary="critical_point sons verdicts chosen", objects="states")
_STATE = fields(f"{_WHERE}.graphs[].states[]", commentary="id contacts dimension")
_VISIT = fields(f"{_WHERE}.sequence[]", commentary="contacts segment change", objects="in")
_HELD = fields(f"{_WHERE}.sequence[].in[]", commentary="critical_point state")
_DIAGRAM = fields(
    f"{_WHERE}.diagrams[]",
    commentary="plane fixed expanded turning room path",
    objects="zone poses",
    optional=("turning",),
)
_ZONE = fields(f"{_WHERE}.diagrams[].zone", commentary="radius half_angle")
_POSE = fields(f"{_WHERE}.diagrams[].poses[]", commentary="name time centre line ball cone edges trapezoid")
_FREEDOM = fields(f"{_WHERE}.freedom_on_planes[]", commentary="t0 t1 s")
_SHARE = fields(f"{_WHERE}.budget[]", commentary="source symbol contribution frame")
_CLEARANCE = fields(f"{_WHERE}.clearance", commentary="measured")
_HAND = fields(f"{_WHERE}.hand", commentary="grasped standing exchanged", objects="segments")
_HAND_MOVE = fields(f"{_WHERE}.hand.segments[]", commentary="start goal velocity bias_wrench")
_TOLERATED = fields(
    f"{_WHERE}.tolerated", commentary="factor start_box", objects="sensitivities ends", optional=("ends",)
)
_SENSITIVITY = fields(f"{_WHERE}.tolerated.sensitivities[]", commentary="name value step change")
_END = fields(f"{_WHERE}.tolerated.ends", commentary="move binding reason")
_REDUCED = fields(f"{_WHERE}.reduced", commentary="share stated_start_box short")
DIAGNOSTIC_FIELDS: tuple[Fields, ...] = (
    _TOP, _GRAPH, _STATE, _VISIT, _HELD, _DIAGRAM, _ZONE, _POSE, _FREEDOM, _SHARE, _CLEARANCE, _HAND, _HAND_MOVE,
    _TOLERATED, _SENSITIVITY, _END, _REDUCED, *PLANAR_FIELDS,
)  # fmt: skip
TOLERANCES = (
    *(f"start.{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz")),
    "velocity.translation",
    "velocity.rotation",
    "clearance",
)


def read_planar(place: Reader) -> Planar:
    """The planar sets of possible contact, and what they say of the motion."""
    place.only(_PLANAR)
    deviations, carry = place.at("deviations").only(_DEVIATIONS), place.at("carry").only(_CARRY)
    height = carry.filled("height")
    return Planar(
        deviations.at("position").number(0.0, 4.0),
        deviations.at("angle").number(0.0, 4.0),
        tuple(_phase(item.only(_PHASE)) for item in place.at("nominal").items(1)),
        _agreement(place.at("agreement").only(_AGREEMENT)),
        tuple(_segment(item.only(_SEGMENT)) for item in place.at("segments").items(1)),
        carry.at("aside").number(0.0),
        None if height is None else height.number(),
        tuple(read_boundary(item) for item in place.at("sets").items(most=64)),
        tuple(read_surface(item) for item in place.at("surfaces").items(most=64)),
    )


def _phase(place: Reader) -> Phase:
    contacts = tuple(item.label() for item in place.at("contacts").items())
    return Phase(place.at("kind").text(PHASES), place.at("start").number(0.0), place.at("end").number(0.0), contacts)


def _segment(place: Reader) -> PlanarSegment:
    phases = tuple(_phase(item.only(_PART)) for item in place.at("phases").items(1))
    return PlanarSegment(place.at("kind").text(PHASES), phases)


def _agreement(place: Reader) -> Agreement:
    return Agreement(
        place.at("both").number(0.0),
        place.at("neither").number(0.0),
        place.at("only_possible").number(0.0),
        place.at("only_stopped").number(0.0),
        place.at("agrees").flag(),
        place.at("words").text(),
    )


def read_boundary(place: Reader) -> Boundary:
    """A set in the plane, as `papers.basanez_suarez.account.boundary_record` makes it."""
    return _boundary(place.only(_SET))


def read_surface(place: Reader) -> Surface:
    """Configurations of a contact, as `papers.basanez_suarez.account.surface_record` makes them."""
    place.only(_SURFACE)
    kind = place.at("kind").text(CONTACT_KINDS)
    slices = tuple(_slice(item.only(_SLICE)) for item in place.at("slices").items(1, most=256))
    return Surface(place.at("contact").label(), kind, slices)


def _slice(place: Reader) -> Slice:
    return Slice(place.at("phi").number(-16.0, 16.0), _boundary(place))


def _boundary(place: Reader) -> Boundary:
    loops = tuple(tuple(_curve(item) for item in loop.items(1)) for loop in place.at("loops").items())
    return Boundary(place.at("name").text(), loops, points(place.at("nominal"), 0))


def _curve(place: Reader) -> Curve:
    place.only(_CURVE)
    line, arc = place.maybe("line"), place.maybe("arc")
    if (line is None) == (arc is None):
        raise place.fail("must be either a line or an arc")
    return Curve(
        place.at("on").text(CARRIERS),
        None if line is None else line.numbers(4),
        None if arc is None else arc.numbers(5),
    )


def points(place: Reader, least: int, most: int = MOST) -> Polyline:
    """Points of a plane.

    Args:
        place: of a list of pairs of numbers.
        least, most: how many.
    """
    return tuple((u, v) for u, v in (item.numbers(2) for item in place.items(least, most=most)))


def read_diagnostics(place: Reader) -> Diagnostics:
    """What a plan tells of how it was found."""
    place.only(_TOP)
    sides = place.at("clearance").only(_CLEARANCE).at("measured").items(exact=2)
    x, y = (None if side.value is None else side.number(-4.0, 4.0) for side in sides)
    imported, hand, planar = place.maybe("imported"), place.maybe("hand"), place.maybe("planar")
    notes = place.maybe("notes")
    tolerated, reduced = place.maybe("tolerated"), place.maybe("reduced")
    return Diagnostics(
        graphs=tuple(_graph(item) for item in place.at("graphs").items()),
        sequence=tuple(_visit(item) for item in place.at("sequence").items()),
        diagrams=tuple(read_diagram(item) for item in place.at("diagrams").items(most=len(PLANES))),
        freedom_on_planes=tuple(read_interval(item.only(_FREEDOM)) for item in place.at("freedom_on_planes").items()),
        budget=tuple(_contribution(item) for item in place.at("budget").items(most=256)),
        measured_clearance=(x, y),
        imported=() if imported is None else tuple(item.text() for item in imported.items()),
        notes=() if notes is None else tuple(item.text() for item in notes.items()),
        hand=None if hand is None else _hand(hand),
        tolerated=None if tolerated is None else _tolerated(tolerated),
        reduced=None if reduced is None else _reduced(reduced),
        planar=None if planar is None else read_planar(planar),
    )


def _graph(place: Reader) -> Graph:
    place.only(_GRAPH)
    states = tuple(_state(item) for item in place.at("states").items())
    count = len(states)
    return Graph(
        place.at("critical_point").label(),
        states,
        tuple(item.indices(count) for item in place.at("sons").items(exact=count)),
        tuple(item.text(STATE_VERDICTS) for item in place.at("verdicts").items(exact=count)),
        place.at("chosen").indices(count),
    )


def _state(place: Reader) -> State:
    place.only(_STATE)
    contacts = tuple(item.label() for item in place.at("contacts").items())
    return State(place.at("id").label(), contacts, place.at("dimension").integer(7))


def _visit(place: Reader) -> Visit:
    place.only(_VISIT)
    held = (item.only(_HELD) for item in place.at("in").items())
    return Visit(
        tuple(item.label() for item in place.at("contacts").items()),
        place.at("segment").integer(low=-1),
        place.at("change").text(CHANGES),
        tuple((item.at("critical_point").integer(), item.at("state").label()) for item in held),
    )


def read_diagram(place: Reader) -> Diagram:
    """A cut-diagram."""
    place.only(_DIAGRAM)
    zone, turning = place.at("zone").only(_ZONE), place.maybe("turning")
    return Diagram(
        place.at("plane").text(PLANES),
        zone.at("radius").number(0.0, 4.0),
        zone.at("half_angle").number(0.0, 4.0),
        _loops(place.at("fixed")),
        _loops(place.at("expanded")),
        None if turning is None else _loops(turning),
        place.at("room").number(0.0),
        points(place.at("path"), 1),
        tuple(_pose(item) for item in place.at("poses").items(1, most=len(POSES))),
    )


def _loops(place: Reader) -> tuple[Polyline, ...]:
    return tuple(points(item, 2) for item in place.items())


def _pose(place: Reader) -> DiagramPose:
    place.only(_POSE)
    u, v = place.at("centre").numbers(2)
    return DiagramPose(
        place.at("name").text(POSES),
        place.at("time").number(0.0),
        (u, v),
        points(place.at("line"), 2, 2),
        points(place.at("ball"), 4, 4),
        tuple(points(item, 2, 2) for item in place.at("cone").items(exact=2)),
        tuple(points(item, 2, 2) for item in place.at("edges").items(exact=2)),
        points(place.at("trapezoid"), 1),
    )


def _contribution(place: Reader) -> Contribution:
    place.only(_SHARE)
    box = place.at("contribution").numbers(6, 0.0, 4.0)
    frame = place.at("frame").text(FIXED_IN)
    return Contribution(place.at("source").text(), place.at("symbol").text(), box, frame)


def _hand(place: Reader) -> Hand:
    place.only(_HAND)
    moves = [item.only(_HAND_MOVE) for item in place.at("segments").items()]
    keys = ("start", "goal", "velocity", "bias_wrench")
    return Hand(
        place.at("grasped").text(),
        place.at("standing").text(),
        place.at("exchanged").flag(),
        tuple(HandMove(*(move.at(key).numbers(6) for key in keys)) for move in moves),
    )


def _tolerated(place: Reader) -> ErrorTolerance:
    place.only(_TOLERATED)
    end = place.maybe("ends")
    return ErrorTolerance(
        place.at("factor").number(0.0),
        place.at("start_box").numbers(6, 0.0),
        tuple(_sensitivity(item) for item in place.at("sensitivities").items(most=len(TOLERANCES))),
        None if end is None else _end(end),
    )


def _sensitivity(place: Reader) -> Sensitivity:
    place.only(_SENSITIVITY)
    change, step = place.filled("change"), place.at("step").number(-4.0, 4.0)
    if step == 0.0:
        raise place.at("step").fail("must not be 0")
    return Sensitivity(
        place.at("name").text(TOLERANCES),
        place.at("value").number(-4.0, 4.0),
        step,
        None if change is None else change.number(),
    )


def _end(place: Reader) -> ToleranceEnd:
    place.only(_END)
    return ToleranceEnd(place.at("move").integer(), place.at("binding").text(), place.at("reason").text())


def _reduced(place: Reader) -> Reduced:
    place.only(_REDUCED)
    box = place.at("stated_start_box").numbers(6, 0.0, 4.0)
    return Reduced(place.at("share").number(0.0, 1.0), box, place.at("short").text())
