"""From JSON to the segments of a plan, with their claims and their control, and to its recovery."""

import math
from collections.abc import Iterable

from fmopt.verify.reading.document import (
    Hybrid,
    JamFree,
    Lift,
    MoveRecovery,
    Segment,
    StatedContactClaim,
    StatedPart,
    StatedRecovery,
    StatedSeparation,
    StatedWitness,
    Tube,
)
from fmopt.verify.reading.reader import Fields, Numbers, Reader, fields

SLOWEST = 1e-9  # m/s
LEAST_FORCE = 1e-9  # N, that ends a move
KINDS = ("guarded_move",)
STAYS = ("push", "stop", "none")
_SEGMENT = fields(
    "segments[]",
    proved="kind move state goal_state progress start goal clearance margin binding_contact leaving",
    objects="basis tube separations contacts hybrid",
    optional="leaving",
)
_BASIS = fields("segments[].basis[]", proved="contact direction made")
_TUBE = fields("segments[].tube", proved="theta_max offset_box angle_box")
_SEPARATION = fields("segments[].separations[]", proved="moving_piece fixed_piece margin", objects="witness")
_WITNESS = fields(
    "segments[].separations[].witness", proved="kind moving fixed normal offset", optional="normal offset"
)
_OF_FEATURES = fields(_WITNESS.where, proved="kind moving fixed")
_CLAIM = fields("segments[].contacts[]", proved="id role normal offset remainder margin")
_HYBRID = fields(
    "segments[].hybrid",
    proved="frame position_axes force_axes velocity speed bias_wrench push stays",
    objects="normal_forces termination jam_free impact",
    optional="jam_free impact",
)
_FORCE = fields("segments[].hybrid.normal_forces[]", proved="contact force")
_TERMINATION = fields("segments[].hybrid.termination", proved="contacts wrench threshold max_travel timeout")
_JAM_FREE = fields("segments[].hybrid.jam_free", proved="push least_push angle twists", objects="planes")
_PLANE = fields("segments[].hybrid.jam_free.planes[]", proved="towards angles")
_IMPACT = fields("segments[].hybrid.impact", proved="approach force")
SEGMENT_FIELDS: tuple[Fields, ...] = (
    _SEGMENT, _BASIS, _TUBE, _SEPARATION, _WITNESS, _CLAIM, _HYBRID, _FORCE, _TERMINATION, _JAM_FREE, _PLANE, _IMPACT,
)  # fmt: skip
_MANY = 256  # twists that prove a range
_WITNESSES = ("fixed-face", "moving-face", "edges", "plane")
LARGEST_NUMBER_OF_RETRIES = 64
_RECOVERY = fields("recovery", proved="retries covers", commentary="why not_covered", objects="lift moves")
_LIFT = fields("recovery.lift", proved="direction above clear turn")
_MOVE = fields("recovery.moves[]", proved="move back_off room", objects="order")
_ORDER = fields("recovery.moves[].order", commentary="early late")
RECOVERY_FIELDS: tuple[Fields, ...] = (_RECOVERY, _LIFT, _MOVE, _ORDER)


def pose(place: Reader) -> Numbers:
    """A pose (6,) within the room of a plan."""
    found = place.numbers(6, -8.0, 8.0)
    if math.hypot(*found[3:]) > 6.5:  # a little over 2π, and less than the 8 rad of `exponential`
        raise place.fail("a rotation vector must not be longer than a full turn")
    return found


def _ids(place: Reader, known: Iterable[str]) -> tuple[str, ...]:
    found = tuple(item.text(known) for item in place.items())
    if len(set(found)) != len(found):
        raise place.fail("repeats a contact")
    return found


def read_segment(place: Reader, known: Iterable[str], moving: StatedPart, fixed: StatedPart) -> Segment:
    """A segment, whose kind says how the rest of it reads, of a plan with contacts of known ids.

    Raises:
        PlanError: it has another form.
    """
    place.at("kind").text(KINDS)
    progress = place.only(_SEGMENT).at("progress").numbers(2, 0.0, 1.0)
    if not progress[0] < progress[1]:
        raise place.at("progress").fail("must increase")
    basis = []
    for item in place.at("basis").items(most=6):
        direction = item.only(_BASIS).at("direction").numbers(6, -4096.0, 4096.0)
        basis.append((item.at("contact").text(known), direction, item.at("made").flag()))
    claims = place.at("contacts").items()
    separations = place.at("separations").items(most=2 * (len(moving.pieces) + len(moving.balls)) * len(fixed.pieces))
    return Segment(
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
        _tube(place.at("tube").only(_TUBE)),
        tuple(_separation(item, moving, fixed) for item in separations),
        tuple(_claim(item.only(_CLAIM), known) for item in claims),
        _hybrid(place.at("hybrid"), known),
        _ids(place.at("leaving"), known) if place.has("leaving") else (),
    )


def _tube(place: Reader) -> Tube:
    box, angles = (place.at(key).numbers(3, 0.0, 1.0) for key in ("offset_box", "angle_box"))
    return Tube(place.at("theta_max").number(0.0, 1.0), box, angles)


def _separation(place: Reader, moving: StatedPart, fixed: StatedPart) -> StatedSeparation:
    i = place.only(_SEPARATION).at("moving_piece").integer(len(moving.pieces) + len(moving.balls))
    j = place.at("fixed_piece").integer(len(fixed.pieces))
    witness = place.at("witness").only(_WITNESS)
    kind = witness.at("kind").text(_WITNESSES)
    if kind != "plane":
        witness.only(_OF_FEATURES)
    counts = {"fixed-face": (0, None), "moving-face": (None, 0), "edges": (2, 2), "plane": (0, 0)}[kind]
    own, other = (
        witness.at(key).indices(len((*part.pieces, *part.balls)[n].vertices), 0, count)
        for key, part, n, count in zip(("moving", "fixed"), (moving, fixed), (i, j), counts, strict=True)
    )
    normal: Numbers = (0.0, 0.0, 0.0)
    offset = 0.0
    if kind == "plane":
        normal, offset = witness.at("normal").numbers(3, -2.0, 2.0), witness.at("offset").number(-16.0, 16.0)
    return StatedSeparation(i, j, StatedWitness(kind, own, other, normal, offset), place.at("margin").number())


def _claim(place: Reader, known: Iterable[str]) -> StatedContactClaim:
    return StatedContactClaim(
        place.at("id").text(known),
        place.at("role").text(("held", "made")),
        place.at("normal").numbers(6),
        place.at("offset").number(),
        place.at("remainder").number(),
        place.at("margin").number(),
    )


def _hybrid(place: Reader, known: Iterable[str]) -> Hybrid:
    end = place.only(_HYBRID).at("termination").only(_TERMINATION)
    forces = [item.only(_FORCE) for item in place.at("normal_forces").items()]
    return Hybrid(
        place.at("frame").numbers(6),
        place.at("position_axes").matrix(6),
        place.at("force_axes").matrix(6),
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
        _jam_free(place.at("jam_free").only(_JAM_FREE)) if place.has("jam_free") else None,
        _impact(place.at("impact")) if place.has("impact") else None,
    )


def _impact(place: Reader) -> tuple[float, float]:
    return place.only(_IMPACT).at("approach").number(0.0), place.at("force").number(0.0)


def _jam_free(place: Reader) -> JamFree:
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
        place.at("twists").matrix(_MANY),
    )


def read_recovery(place: Reader) -> StatedRecovery:
    """Backing off and trying again."""
    lift = place.only(_RECOVERY).filled("lift")
    retries = tuple(item.numbers(6, -4.0, 4.0) for item in place.at("retries").items(most=LARGEST_NUMBER_OF_RETRIES))
    return StatedRecovery(
        None if lift is None else _lift(lift),
        place.at("why").text(),
        retries,
        place.at("covers").numbers(6, 0.0, 8.0),
        tuple(_move(item, len(retries)) for item in place.at("moves").items()),
        tuple(item.text() for item in place.at("not_covered").items(most=64)),
    )


def _lift(place: Reader) -> Lift:
    if place.only(_LIFT).at("direction").numbers(3) != (0.0, 0.0, 1.0):
        raise place.at("direction").fail("must be the z of the hole's frame")
    turn = place.at("turn").number(0.0, 0.5 * math.pi)
    return Lift(place.at("above").number(-4.0, 4.0), place.at("clear").number(-8.0, 8.0), turn)


def _move(place: Reader, retries: int) -> MoveRecovery:
    order = place.only(_MOVE).at("order").only(_ORDER)
    early, late = (order.at(key).indices(max(retries, 1)) for key in ("early", "late"))
    for key, found in (("early", early), ("late", late)):
        if len(found) != retries:
            raise order.at(key).fail("must name each retry once")
    room = place.filled("room")
    return MoveRecovery(
        place.at("move").integer(), place.at("back_off").flag(), None if room is None else room.number(), early, late
    )
