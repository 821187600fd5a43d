"""From JSON to the segments of a plan, with their claims and their control.

From JSON to what a plan tells besides its segments.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise

from fmopt.verify.reading.diagnostics import Interval
from fmopt.verify.reading.document import (
    ContactClaim,
    CriticalPoint,
    Hybrid,
    JamFree,
    Lift,
    MoveRecovery,
    Nominal,
    Part,
    PositionForce,
    Recovery,
    Segment,
    Separation,
    Tube,
    UnplannedContact,
    Witness,
)
from fmopt.verify.reading.reader import Fields, Numbers, Reader, fields

SLOWEST = 1e-9  # m/s
LEAST_FORCE = 1e-9  # N, that ends a move
STAYS = ("push", "stop", "none")
_SEGMENT = fields(
    "segments[]",
    proved="move state goal_state progress start goal clearance margin binding_contact leaving",
    commentary="critical_point",
    objects="basis tube separations contacts hybrid",
    optional=("leaving",),
)
_BASIS = fields("segments[].basis[]", proved="contact direction made")
_TUBE = fields(
    "segments[].tube",
    proved="shape_start shape_goal generators_start generators_goal growth_start growth_goal slide_start "
    "slide_goal swing_start swing_goal theta_max offset_max offset_box angle_box",
)
_SEPARATION = fields("segments[].separations[]", proved="moving_piece fixed_piece margin", objects="witness")
_WITNESS = fields(
    "segments[].separations[].witness", proved="kind moving fixed normal offset", optional=("normal", "offset")
)
_CLAIM = fields("segments[].contacts[]", proved="id role normal offset remainder margin")
_HYBRID = fields(
    "segments[].hybrid",
    proved="frame position_axes force_axes velocity speed bias_wrench push stays",
    objects="normal_forces termination jam_free impact",
    optional=("jam_free", "impact"),
)
_FORCE = fields("segments[].hybrid.normal_forces[]", proved="contact force")
_TERMINATION = fields("segments[].hybrid.termination", proved="contacts wrench threshold max_travel timeout")
_JAM_FREE = fields("segments[].hybrid.jam_free", proved="push least_push angle twists", objects="planes")
_PLANE = fields("segments[].hybrid.jam_free.planes[]", proved="towards angles")
_IMPACT = fields("segments[].hybrid.impact", proved="approach force")
SEGMENT_FIELDS: tuple[Fields, ...] = (
    _SEGMENT, _BASIS, _TUBE, _SEPARATION, _WITNESS, _CLAIM, _HYBRID, _FORCE, _TERMINATION, _JAM_FREE, _PLANE, _IMPACT,
)  # fmt: skip
_SIZES = {
    "vertex-face": (1, 3),
    "face-vertex": (3, 1),
    "edge-edge": (2, 2),
    "ball-face": (1, 3),
}  # vertices; 3 or more of a face
_MANY = 256  # generators of an error set, twists that prove a range
_WITNESSES = ("fixed-face", "moving-face", "edges", "plane")

LARGEST_NUMBER_OF_RETRIES = 64
AXES = ("x", "y", "z", "rx", "ry", "rz")
STATE_VERDICTS = ("confirmed", "blocked", "out_of_bounds", "split", "undecided")
_NOMINAL = fields("nominal", commentary="nodes times", objects="intervals")
_INTERVAL = fields("nominal.intervals[]", commentary="t0 t1 s")
_ROW = fields("position_force[]", commentary="t0 t1 s pa_start pa_end pn_start pn_end fa fa_sign applied either_sign")
_CRITICAL = fields(
    "critical_points[]", commentary="name pose pcs enumerated states_by_dimension states_confirmed states_by_verdict"
)
_RECOVERY = fields("recovery", proved="retries covers", commentary="why not_covered", objects="lift moves")
_LIFT = fields("recovery.lift", proved="direction above clear turn")
_MOVE = fields("recovery.moves[]", proved="move back_off room", objects="first order")
_ORDER = fields("recovery.moves[].order", commentary="early late")
_FIRST = fields(
    "recovery.moves[].first[]", commentary="kind factor axis axis_factor wrench angle told", objects="moving fixed"
)
_TOUCHED = fields("recovery.moves[].first[].*", commentary="vertices")
ACCOUNT_FIELDS: tuple[Fields, ...] = (
    _NOMINAL, _INTERVAL, _ROW, _CRITICAL, _RECOVERY, _LIFT, _MOVE, _ORDER, _FIRST, _TOUCHED,
)  # fmt: skip


def pose(place: Reader) -> Numbers:
    """A pose (6,) within the room of a plan."""
    found = place.numbers(6, -8.0, 8.0)
    if math.hypot(*found[3:]) > 6.5:  # a little over 2π, and less than the 8 rad of `exponential`
        raise place.fail("a rotation vector must not be longer than a full turn")
    return found


def feature_pair(
    place: Reader, side: Fields, moving: Part, fixed: Part
) -> tuple[str, tuple[int, ...], tuple[int, ...]]:
    """The kind of a primitive contact, and the vertices of its features."""
    kind = place.at("kind").text(_SIZES)
    own = place.at("moving").only(side).at("vertices").indices(len(moving.body.vertices), 1)
    other = place.at("fixed").only(side).at("vertices").indices(len(fixed.body.vertices), 1)
    for indices, size in zip((own, other), _SIZES[kind], strict=True):
        if len(indices) < size or (size < 3 and len(indices) != size):
            raise place.fail(f"a {kind} contact has other numbers of vertices")
    centres = {vertex for vertex, _ in moving.body.balls}
    if kind in ("vertex-face", "ball-face") and (own[0] in centres) != (kind == "ball-face"):
        raise place.fail(f"a {kind} contact is one of a {'point' if own[0] in centres else 'ball'} of the moving part")
    return kind, own, other


def _ids(place: Reader, known: Iterable[str]) -> tuple[str, ...]:
    found = tuple(item.text(known) for item in place.items())
    if len(set(found)) != len(found):
        raise place.fail("repeats a contact")
    return found


def read_segment(place: Reader, known: Iterable[str], moving: Part, fixed: Part) -> Segment:
    """A segment.

    Args:
        place: where it stands.
        known: ids of the plan's contacts.
        moving, fixed: the parts.

    Raises:
        PlanError: it has another form.
    """
    place.only(_SEGMENT)
    progress = place.at("progress").numbers(2, 0.0, 1.0)
    if not progress[0] < progress[1]:
        raise place.at("progress").fail("must increase")
    basis = []
    for item in place.at("basis").items(most=6):
        item.only(_BASIS)
        direction = item.at("direction").numbers(6, -4096.0, 4096.0)
        basis.append((item.at("contact").text(known), direction, item.at("made").flag()))
    claims = place.at("contacts").items()
    separations = place.at("separations").items(most=2 * (len(moving.pieces) + len(moving.balls)) * len(fixed.pieces))
    return Segment(
        place.at("critical_point").integer(),
        place.at("move").integer(),
        _ids(place.at("state"), known),
        _ids(place.at("goal_state"), known),
        (progress[0], progress[1]),
        pose(place.at("start")),
        pose(place.at("goal")),
        place.at("clearance").number(),
        place.at("margin").number(),
        place.at("binding_contact").label(),
        tuple(basis),
        _tube(place.at("tube")),
        tuple(_separation(item, moving, fixed) for item in separations),
        tuple(_claim(item, known) for item in claims),
        _hybrid(place.at("hybrid"), known),
        _ids(place.at("leaving"), known) if place.has("leaving") else (),
    )


def _tube(place: Reader) -> Tube:
    place.only(_TUBE)
    matrices: dict[str, tuple[Numbers, ...]] = {
        f"{kind}_{end}": place.at(f"{kind}_{end}").matrix(None if kind == "generators" else 6, _MANY)
        for kind in ("shape", "generators", "growth", "slide", "swing")
        for end in ("start", "goal")
    }
    theta, offset = place.at("theta_max").number(0.0, 1.0), place.at("offset_max").number(0.0, 1.0)
    box, angles = (place.at(key).numbers(3, 0.0, 1.0) for key in ("offset_box", "angle_box"))
    return Tube(matrices, theta, offset, box, angles)


def _separation(place: Reader, moving: Part, fixed: Part) -> Separation:
    place.only(_SEPARATION)
    i = place.at("moving_piece").integer(len(moving.pieces) + len(moving.balls))
    j = place.at("fixed_piece").integer(len(fixed.pieces))
    witness = place.at("witness").only(_WITNESS)
    kind = witness.at("kind").text(_WITNESSES)
    witness.only(("kind", "moving", "fixed"), ("normal", "offset") if kind == "plane" else ())
    counts = {"fixed-face": (0, None), "moving-face": (None, 0), "edges": (2, 2), "plane": (0, 0)}[kind]
    own, other = (
        witness.at(key).indices(len((*part.pieces, *part.balls)[n].vertices), 0, count)
        for key, part, n, count in zip(("moving", "fixed"), (moving, fixed), (i, j), counts, strict=True)
    )
    normal: Numbers = (0.0, 0.0, 0.0)
    offset = 0.0
    if kind == "plane":
        normal, offset = witness.at("normal").numbers(3, -2.0, 2.0), witness.at("offset").number(-16.0, 16.0)
    return Separation(i, j, Witness(kind, own, other, normal, offset), place.at("margin").number())


def _claim(place: Reader, known: Iterable[str]) -> ContactClaim:
    place.only(_CLAIM)
    return ContactClaim(
        place.at("id").text(known),
        place.at("role").text(("held", "made")),
        place.at("normal").numbers(6),
        place.at("offset").number(),
        place.at("remainder").number(),
        place.at("margin").number(),
    )


def _hybrid(place: Reader, known: Iterable[str]) -> Hybrid:
    place.only(_HYBRID)
    end = place.at("termination").only(_TERMINATION)
    forces = [item.only(_FORCE) for item in place.at("normal_forces").items()]
    return Hybrid(
        place.at("frame").numbers(6),
        place.at("position_axes").matrix(None, 6),
        place.at("force_axes").matrix(None, 6),
        place.at("velocity").numbers(6),
        place.at("speed").number(SLOWEST),
        place.at("bias_wrench").numbers(6),
        place.at("push").number(),
        tuple((item.at("contact").text(known), item.at("force").number()) for item in forces),
        _ids(end.at("contacts"), known),
        end.at("wrench").numbers(6),
        end.at("threshold").number(LEAST_FORCE),
        end.at("max_travel").number(0.0),
        end.at("timeout").number(0.0, 1e12),
        place.at("stays").text(STAYS),
        _jam_free(place.at("jam_free")) if place.has("jam_free") else None,
        _impact(place.at("impact")) if place.has("impact") else None,
    )


def _impact(place: Reader) -> tuple[float, float]:
    place.only(_IMPACT)
    return place.at("approach").number(0.0), place.at("force").number(0.0)


def _jam_free(place: Reader) -> JamFree:
    place.only(_JAM_FREE)
    planes = []
    for item in place.at("planes").items(most=64):
        away, to = item.only(_PLANE).at("angles").numbers(2, 0.0, math.pi)
        planes.append((item.at("towards").label(), (away, to)))
    if len({name for name, _ in planes}) != len(planes):
        raise place.at("planes").fail("repeats a plane")
    least = place.filled("least_push")
    return JamFree(
        place.at("push").number(0.0),
        None if least is None else least.number(0.0),
        place.at("angle").number(0.0, math.pi),
        tuple(planes),
        place.at("twists").matrix(None, _MANY),
    )


def read_nominal(place: Reader) -> Nominal:
    """The nominal trajectory."""
    place.only(_NOMINAL)
    times = tuple(item.number(0.0) for item in place.at("times").items(2))
    intervals = tuple(read_interval(item.only(_INTERVAL)) for item in place.at("intervals").items(1))
    if any(a > b for a, b in pairwise(times)) or not times[-1] > 0.0:
        raise place.at("times").fail("must not go back")
    return Nominal(place.at("nodes").matrix(len(times)), times, intervals)


def read_interval(place: Reader) -> Interval:
    """An interval of S(t)."""
    s = tuple(item.integer(3, low=-1) for item in place.at("s").items(exact=6))
    return Interval(place.at("t0").number(0.0), place.at("t1").number(0.0), s)


def read_position_force(place: Reader) -> tuple[PositionForce, ...]:
    """The rows of Pₐ(t) and Fₐ(t)."""
    return tuple(_row(item.only(_ROW)) for item in place.items(1))


def _row(place: Reader) -> PositionForce:
    place.at("fa_sign").text(("reaction",))
    pa_start, pa_end, pn_start, pn_end, fa, applied = (
        place.at(key).numbers(6) for key in ("pa_start", "pa_end", "pn_start", "pn_end", "fa", "applied")
    )
    either = place.at("either_sign").indices(6)
    return PositionForce(read_interval(place), pa_start, pa_end, pn_start, pn_end, fa, applied, either)


def read_critical_points(place: Reader) -> tuple[CriticalPoint, ...]:
    """The poses near which contact states were looked for."""
    return tuple(_critical(item.only(_CRITICAL)) for item in place.items())


def _critical(place: Reader) -> CriticalPoint:
    dimensions = place.at("states_by_dimension").only((), map(str, range(7)))
    verdicts = place.at("states_by_verdict").only(STATE_VERDICTS)
    return CriticalPoint(
        place.at("name").label(),
        place.at("pose").numbers(6),
        tuple(item.label() for item in place.at("pcs").items()),
        place.at("enumerated").flag(),
        {k: dimensions.at(str(k)).integer() for k in range(7) if dimensions.has(str(k))},
        place.at("states_confirmed").integer(),
        {name: verdicts.at(name).integer() for name in STATE_VERDICTS},
    )


def read_recovery(place: Reader, moving: Part, fixed: Part) -> Recovery:
    """Backing off and trying again, with the parts whose contacts it names."""
    place.only(_RECOVERY)
    lift = place.filled("lift")
    retries = tuple(item.numbers(6, -4.0, 4.0) for item in place.at("retries").items(most=LARGEST_NUMBER_OF_RETRIES))
    return Recovery(
        None if lift is None else _lift(lift),
        place.at("why").text(),
        retries,
        place.at("covers").numbers(6, 0.0, 8.0),
        tuple(_move(item, len(retries), moving, fixed) for item in place.at("moves").items()),
        tuple(item.text() for item in place.at("not_covered").items(most=64)),
    )


def _lift(place: Reader) -> Lift:
    place.only(_LIFT)
    if place.at("direction").numbers(3) != (0.0, 0.0, 1.0):
        raise place.at("direction").fail("must be the z of the hole's frame")
    turn = place.at("turn").number(0.0, 0.5 * math.pi)
    return Lift(place.at("above").number(-4.0, 4.0), place.at("clear").number(-8.0, 8.0), turn)


def _move(place: Reader, retries: int, moving: Part, fixed: Part) -> MoveRecovery:
    place.only(_MOVE)
    order = place.at("order").only(_ORDER)
    early, late = (order.at(key).indices(max(retries, 1)) for key in ("early", "late"))
    for key, found in (("early", early), ("late", late)):
        if len(found) != retries:
            raise order.at(key).fail("must name each retry once")
    room = place.filled("room")
    return MoveRecovery(
        place.at("move").integer(),
        place.at("back_off").flag(),
        None if room is None else room.number(),
        tuple(_unplanned(item, moving, fixed) for item in place.at("first").items()),
        early,
        late,
    )


def _unplanned(place: Reader, moving: Part, fixed: Part) -> UnplannedContact:
    place.only(_FIRST)
    kind, own, other = feature_pair(place, _TOUCHED, moving, fixed)
    axis_factor, angle = place.filled("axis_factor"), place.filled("angle")
    axis = place.at("axis").text((*AXES, ""))
    if (axis_factor is None) != (axis == ""):
        raise place.at("axis_factor").fail("must be there where one axis makes the contact, and only there")
    return UnplannedContact(
        kind,
        own,
        other,
        place.at("factor").number(0.0),
        axis,
        None if axis_factor is None else axis_factor.number(0.0),
        place.at("wrench").numbers(6),
        None if angle is None else angle.number(0.0, math.pi),
        place.at("told").flag(),
    )
