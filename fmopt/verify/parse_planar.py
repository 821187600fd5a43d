"""From JSON to the planar sets of possible contact that a plan tells of."""

from __future__ import annotations

from fmopt.verify.diagnostics import (
    Agreement,
    Boundary,
    Curve,
    Phase,
    Planar,
    PlanarSegment,
    Polyline,
    Slice,
    Surface,
)
from fmopt.verify.keys import Fields, fields
from fmopt.verify.reader import MOST, Reader

PHASES = ("gross", "fine", "blocked")
CARRIERS = ("r_M", "r_m", "g_M", "g_m", "n", "line")
CONTACT_KINDS = ("type-1", "type-2")
_WHERE = "diagnostics.planar"
_PLANAR = fields(_WHERE, objects="deviations nominal agreement segments carry sets surfaces")
_DEVIATIONS = fields(f"{_WHERE}.deviations", commentary="position angle")
_PHASE = fields(f"{_WHERE}.nominal[]", commentary="kind start end contacts")
_SEGMENT = fields(f"{_WHERE}.segments[]", commentary="kind", objects="phases")
_PART = fields(f"{_WHERE}.segments[].phases[]", commentary="kind start end contacts")
_AGREEMENT = fields(f"{_WHERE}.agreement", commentary="both neither only_possible only_stopped agrees words")
_CARRY = fields(f"{_WHERE}.carry", commentary="aside height")
_SET = fields(f"{_WHERE}.sets[]", commentary="name nominal", objects="loops")
_CURVE = fields(f"{_WHERE}.sets[].loops[][]", commentary="on line arc", optional=("line", "arc"))
_SURFACE = fields(f"{_WHERE}.surfaces[]", commentary="contact kind", objects="slices")
_SLICE = fields(f"{_WHERE}.surfaces[].slices[]", commentary="phi name nominal", objects="loops")
_CUT = fields(f"{_WHERE}.surfaces[].slices[].loops[][]", commentary="on line arc", optional=("line", "arc"))
PLANAR_FIELDS: tuple[Fields, ...] = (
    _PLANAR, _DEVIATIONS, _PHASE, _SEGMENT, _PART, _AGREEMENT, _CARRY, _SET, _CURVE, _SURFACE, _SLICE, _CUT,
)  # fmt: skip


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
    """A set in the plane, as `uncertainty.planar.record.boundary_record` makes it."""
    return _boundary(place.only(_SET))


def read_surface(place: Reader) -> Surface:
    """Configurations of a contact, as `uncertainty.planar.record.surface_record` makes them."""
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
    """Points of a plane."""
    return tuple((u, v) for u, v in (item.numbers(2) for item in place.items(least, most=most)))
