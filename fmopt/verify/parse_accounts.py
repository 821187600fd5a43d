"""From JSON to what a plan tells besides its segments."""

from __future__ import annotations

import math
import re
from itertools import pairwise

from fmopt.verify.accounts import (
    CriticalPoint,
    Foreseen,
    Interval,
    Lift,
    MoveRecovery,
    Nominal,
    PositionForce,
    Recovery,
    Search,
)
from fmopt.verify.document import Part
from fmopt.verify.keys import Fields, fields
from fmopt.verify.parse_segments import feature_pair
from fmopt.verify.reader import Reader

LARGEST_NUMBER_OF_RETRIES = 64
AXES = ("x", "y", "z", "rx", "ry", "rz")
_MOVE_NAME = re.compile(r"[+-]r?[xyz]|[a-z]{1,16}", re.ASCII)
STATE_VERDICTS = ("confirmed", "blocked", "out_of_bounds", "split", "undecided")
_NOMINAL = fields("nominal", commentary="nodes times", objects="intervals")
_INTERVAL = fields("nominal.intervals[]", commentary="t0 t1 s")
_ROW = fields("position_force[]", commentary="t0 t1 s pa_start pa_end pn_start pn_end fa fa_sign applied either_sign")
_CRITICAL = fields(
    "critical_points[]", commentary="name pose pcs enumerated states_by_dimension states_confirmed states_by_verdict"
)
_SEARCH = fields("search", commentary="objective cost lower_bound gap states_expanded moves heading")
_RECOVERY = fields("recovery", proved="retries covers", commentary="why not_covered", objects="lift moves")
_LIFT = fields("recovery.lift", proved="direction above clear turn")
_MOVE = fields("recovery.moves[]", proved="move back_off room", objects="first order")
_ORDER = fields("recovery.moves[].order", commentary="early late")
_FIRST = fields(
    "recovery.moves[].first[]", commentary="kind factor axis axis_factor wrench angle told", objects="moving fixed"
)
_SIDE = fields("recovery.moves[].first[].*", commentary="vertices")
ACCOUNT_FIELDS: tuple[Fields, ...] = (
    _NOMINAL, _INTERVAL, _ROW, _CRITICAL, _SEARCH, _RECOVERY, _LIFT, _MOVE, _ORDER, _FIRST, _SIDE,
)  # fmt: skip


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


def read_search(place: Reader) -> Search:
    """How the sequence of moves was found."""
    place.only(_SEARCH)
    return Search(
        place.at("objective").text(),
        place.at("cost").number(),
        place.at("lower_bound").number(),
        place.at("gap").number(),
        place.at("states_expanded").integer(),
        tuple(_move_name(item) for item in place.at("moves").items()),
        place.at("heading").number(-4.0, 4.0),
    )


def _move_name(place: Reader) -> str:
    if _MOVE_NAME.fullmatch(place.text()) is None:
        raise place.fail("must be an axis with its sign, or a word")
    return str(place.value)


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
        tuple(_foreseen(item, moving, fixed) for item in place.at("first").items()),
        early,
        late,
    )


def _foreseen(place: Reader, moving: Part, fixed: Part) -> Foreseen:
    place.only(_FIRST)
    kind, own, other = feature_pair(place, _SIDE, moving, fixed)
    axis_factor, angle = place.filled("axis_factor"), place.filled("angle")
    axis = place.at("axis").text((*AXES, ""))
    if (axis_factor is None) != (axis == ""):
        raise place.at("axis_factor").fail("must be there where one axis makes the contact, and only there")
    return Foreseen(
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
