"""From JSON to the part of a plan that the check judges; the description is any object, which the seal covers."""

import math
import re
from dataclasses import replace
from typing import Any

from fmopt.verify.reading.document import (
    Body,
    Found,
    Segment,
    StatedContact,
    StatedEvidence,
    StatedPart,
    StatedPlan,
    StatedSpecification,
)
from fmopt.verify.reading.parse_segments import RECOVERY_FIELDS, SEGMENT_FIELDS, pose, read_recovery, read_segment
from fmopt.verify.reading.reader import FIXED_IN, FORMAT, FRAMES, UNITS, VERDICTS, Numbers, Reader, digest, fields

LARGEST_TOLERANCE = 1e-9  # m
KINDS = ("guarded_move", "press")
SUBJECT = ("parts", "goal", "segments", "presses")  # of evidence
TOUCH = 1e-4  # m, distance at which solids around the parts count as touching
LARGEST_NUMBER_OF_PIECES = 400
LARGEST_NUMBER_OF_BALLS = 16
SMALLEST_RADIUS, LARGEST_RADIUS = 1e-6, 4.0  # m
LARGEST_FORM = 1e-3  # m
# Vertices; 3 or more of a face.
_SIZES = {"vertex-face": (1, 3), "face-vertex": (3, 1), "edge-edge": (2, 2), "ball-face": (1, 3)}
_FRACTION = re.compile(r"(-?[0-9]+)(?:/([1-9][0-9]*))?", re.ASCII)
_LONGEST_FRACTION = 800
_VERSION = re.compile(r"[0-9A-Za-z][0-9A-Za-z.+-]{0,39}", re.ASCII)
_TOP = fields(
    "",
    proved="format verdict touch_tolerance not_covered sha256",
    compared="goal",
    commentary="fmopt_version description",
    objects="problem units frames parts contacts segments uncertainty specification recovery presses evidence",
    optional="recovery description presses evidence",
)
_PROBLEM = fields("problem", compared="sha256", commentary="title")
_UNITS = fields("units", proved=" ".join(UNITS))
_FRAMES = fields("frames", proved=" ".join(FRAMES))
_UNCERTAINTY = fields("uncertainty", compared="start_box velocity_error rho", objects="sources", optional="sources")
_SOURCE = fields("uncertainty.sources[]", compared="frame box")
_SPECIFICATION = fields(
    "specification",
    compared="speed contact_force torque_limit friction termination_force impact_force apparent_mass contact_stiffness",
    optional="impact_force apparent_mass contact_stiffness",
)
_PARTS = fields("parts", objects="moving fixed")
_PART = fields(
    "parts.*",
    compared="vertices faces declared_clearance form",
    commentary="name measured_clearance",
    objects="pieces exact found balls",
    optional="exact found balls form",
)
_FOUND = fields("parts.*.found", proved="frame", compared="side feature", optional="frame")
_BALL = fields("parts.*.balls[]", compared="vertex radius")
_EXACT = fields("parts.*.exact[]", proved="vertex at")
_PIECE = fields("parts.*.pieces[]", proved="vertices faces")
_EVIDENCE = fields(
    "evidence",
    proved="draws seated first_tries confidence bound min_rate vertices vertices_seated subject level",
    compared="max_time",
    commentary="examined seed engine conditions",
    objects="outcomes vertex_outcomes",
    optional="max_time",
)
_OUTCOME = fields(
    "evidence.*[]",
    proved="seated attempt seconds distance",
    commentary="press peak_force penetration reasons offset turn rests way",
    optional="distance rests way",
)
_CONTACT = fields("contacts[]", proved="id kind", objects="moving fixed")
_SIDE = fields("contacts[].*", proved="vertices")
FIELDS = (
    _TOP, _PROBLEM, _UNITS, _FRAMES, _UNCERTAINTY, _SOURCE, _SPECIFICATION, _PARTS, _PART, _EXACT, _FOUND, _BALL,
    _PIECE, _EVIDENCE, _OUTCOME,
    _CONTACT, _SIDE, *SEGMENT_FIELDS, *RECOVERY_FIELDS,
)  # fmt: skip


def parse(document: Any) -> StatedPlan:
    """The plan of a JSON document.

    Raises:
        PlanError: something is missing, unknown, of the wrong type or out of range.
    """
    top = Reader(document)
    if not isinstance(document, dict):
        raise top.fail("must be an object")
    # Before all keys: of a file of another format nothing else would be worth saying.
    if (stated := top.at("format")).value == "fmopt.plan/1":
        raise stated.fail("fmopt.plan/1: written by an older fmopt; solve the problem again")
    stated.text([FORMAT])
    top.only(_TOP)
    _the_formats_own(top)
    moving, fixed = (_part(top.at("parts").only(_PARTS).at(key).only(_PART)) for key in ("moving", "fixed"))
    if fixed.body.balls:
        raise top.at("parts").at("fixed").at("balls").fail("are for the moving part only")
    contacts = tuple(_contact(item, moving, fixed) for item in top.at("contacts").items())
    # Looked up for each contact that a segment names, and listed in order where it names another.
    known = dict.fromkeys(c.id for c in contacts)
    if len(known) != len(contacts):
        raise top.at("contacts").fail("repeats an id")
    if len({(c.kind, c.moving, c.fixed) for c in contacts}) != len(contacts):
        raise top.at("contacts").fail("has a contact under two ids")
    uncertainty, problem = top.at("uncertainty").only(_UNCERTAINTY), top.at("problem").only(_PROBLEM)
    recovery, evidence = top.maybe("recovery"), top.maybe("evidence")
    segments, presses = _segments(top, known, moving, fixed)
    return StatedPlan(
        verdict=top.at("verdict").text(VERDICTS),
        title=problem.at("title").text(),
        problem=problem.at("sha256").sha256(),
        version=_version(top.at("fmopt_version")),
        sha256=top.at("sha256").sha256(),
        moving=moving,
        fixed=fixed,
        contacts=contacts,
        segments=segments,
        start_box=uncertainty.at("start_box").numbers(6, 0.0, 0.5),
        velocity_error=uncertainty.at("velocity_error").numbers(2, 0.0, 1.0),
        rho=uncertainty.at("rho").number(2.0**-10, 16.0),
        sources=_framed(uncertainty),
        specification=_specification(top.at("specification").only(_SPECIFICATION)),
        goal=pose(top.at("goal")),
        touch=top.at("touch_tolerance").number(0.0, LARGEST_TOLERANCE),
        not_covered=tuple(item.text() for item in top.at("not_covered").items(most=64)),
        recovery=None if recovery is None else read_recovery(recovery),
        presses=presses,
        evidence=None if evidence is None else _evidence(evidence.only(_EVIDENCE), top.at("presses")),
        subject=digest({key: document.get(key) for key in SUBJECT}) if presses else "",
        digest_holds=top.at("sha256").value == digest(document),
    )


def _segments(
    top: Reader, known: dict[str, None], moving: StatedPart, fixed: StatedPart
) -> tuple[tuple[Segment, ...], int]:
    """The guarded moves of a plan, or how many presses it has: those are read by whoever carries them out."""
    listed = top.at("segments").items(1)
    kinds = {item.at("kind").text(KINDS) for item in listed}
    if kinds == {"press"}:
        top.at("presses")
        return (), len(listed)
    for key in ("presses", "evidence"):
        if top.has(key):
            raise top.at(key).fail("belongs to a plan whose segments all are presses")
    if len(kinds) > 1:
        raise top.at("segments").fail("mix presses and guarded moves, which no check reads yet: give a plan of either")
    return tuple(read_segment(item, known, moving, fixed) for item in listed), 0


def _evidence(place: Reader, presses: Reader) -> StatedEvidence:
    cell = presses.at("cell") if presses.has("cell") else None
    crowded = cell is not None and any(cell.has(side) and cell.at(side).value for side in ("moving", "fixed"))
    counts = ("draws", "seated", "first_tries", "vertices", "vertices_seated")
    found: dict[str, Any] = {name: place.at(name).integer() for name in counts}
    found |= {name: place.at(name).number(0.0, 1.0) for name in ("confidence", "bound", "min_rate")}
    for name in ("outcomes", "vertex_outcomes"):
        found[name] = tuple(_attempt(item.only(_OUTCOME), crowded) for item in place.at(name).items())
    return StatedEvidence(
        **found,
        subject=place.at("subject").sha256(),
        tested=place.at("level").text(("tested", "below")) == "tested",
        start=place.at("conditions").at("start").numbers(6, 0.0, 0.5),
        seconds=tuple(item.at("seconds").number(0.0) for item in place.at("outcomes").items()),
        max_time=place.at("max_time").number(0.0, 1e7) if place.has("max_time") else None,
    )


def _attempt(outcome: Reader, crowded: bool) -> int:
    """The attempt at which a trial seats, from 0; −1 where it does not, or comes too near to tool or obstacles."""
    attempt = outcome.at("attempt").integer()
    near = outcome.at("distance").number() <= TOUCH if outcome.has("distance") else crowded
    return attempt if outcome.at("seated").flag() and not near else -1


def _the_formats_own(top: Reader) -> None:
    """That units and frames are those of the format: whoever reads the plan takes its numbers so."""
    for key, row, words in (("units", _UNITS, UNITS), ("frames", _FRAMES, FRAMES)):
        place = top.at(key).only(row)
        for name, text in words.items():
            place.at(name).text([text])


def _version(place: Reader) -> str:
    if not isinstance(place.value, str) or _VERSION.fullmatch(place.value) is None:
        raise place.fail("must be a version")
    return place.value


def _body(place: Reader, balls: tuple[tuple[int, float], ...] = ()) -> Body:
    # Turned, and put at ±8 m by poses, they stay within the 2⁴ m for which rounding is bounded.
    vertices = tuple(item.numbers(3, -4.0, 4.0) for item in place.at("vertices").items(4))
    count = len(vertices)
    faces = tuple(tuple(loop.indices(count, 3) for loop in face.items(1)) for face in place.at("faces").items(4))
    loose = set(range(count)).difference(*(loop for face in faces for loop in face))
    centres = {vertex for vertex, _ in balls}
    if loose - centres:
        raise place.at("vertices").fail(f"vertex {min(loose - centres)} belongs to no face")
    if centres - loose:
        raise place.at("balls").fail(f"vertex {min(centres - loose)} belongs to a face")
    return Body(vertices, faces, balls=balls)


def _balls(place: Reader) -> tuple[tuple[int, float], ...]:
    """The balls of a part: the vertices that are their centres, and their radii, m."""
    if not place.has("balls"):
        return ()
    count = len(place.at("vertices").items(4))
    found = []
    for item in place.at("balls").items(1, most=LARGEST_NUMBER_OF_BALLS):
        item.only(_BALL)
        found.append((item.at("vertex").integer(count), item.at("radius").number(SMALLEST_RADIUS, LARGEST_RADIUS)))
    if len({vertex for vertex, _ in found}) != len(found):
        raise place.at("balls").fail("repeat a vertex")
    return tuple(found)


def _part(place: Reader) -> StatedPart:
    pieces = []
    for item in place.at("pieces").items(1, most=LARGEST_NUMBER_OF_PIECES):
        piece = _body(item.only(_PIECE))
        if any(len(face) != 1 for face in piece.faces):
            raise item.fail("a face of a convex piece has one loop")
        pieces.append(piece)
    declared = place.filled("declared_clearance")
    stated = None if declared is None else declared.numbers(2, 0.0)
    measured = place.at("measured_clearance").number()
    body = _body(place, _balls(place))
    body = replace(body, exact=_exact(place, len(body.vertices)))
    clearance = None if stated is None else (stated[0], stated[1])
    balls = tuple(
        Body((body.vertices[n],), (), {0: body.exact[n]} if n in body.exact else {}, ((0, radius),))
        for n, radius in body.balls
    )
    form = place.at("form").number(0.0, LARGEST_FORM) if place.has("form") else 0.0
    return StatedPart(body, tuple(pieces), place.at("name").text(), clearance, measured, _found(place), balls, form)


def _found(place: Reader) -> Found | None:
    """How a part mates, where the planner found that."""
    found = place.maybe("found")
    if found is None:
        return None
    found.only(_FOUND)
    frame = found.at("frame").numbers(6, -1e3, 1e3) if found.has("frame") else None
    return Found(found.at("side").text(("moving", "fixed")), found.at("feature").text(), frame)


def _exact(place: Reader, count: int) -> dict[int, tuple[int, int, int, int]]:
    """The vertices whose coordinates are fractions and no floats, as integers (x, y, z, w) for (x, y, z)/w."""
    found: dict[int, tuple[int, int, int, int]] = {}
    for item in place.at("exact").items(most=count) if place.has("exact") else ():
        n = item.only(_EXACT).at("vertex").integer(count)
        if n in found:
            raise item.fail("repeats a vertex")
        x, y, z = (_fraction(value) for value in item.at("at").items(exact=3))
        w = math.lcm(x[1], y[1], z[1])
        found[n] = (x[0] * (w // x[1]), y[0] * (w // y[1]), z[0] * (w // z[1]), w)
    return found


def _fraction(place: Reader) -> tuple[int, int]:
    """Numerator and denominator, in lowest terms, of a fraction written as "-3/4"."""
    text = place.value
    match = _FRACTION.fullmatch(text) if isinstance(text, str) and len(text) <= _LONGEST_FRACTION else None
    if match is None:
        raise place.fail(f'must be a fraction such as "-3/4" of at most {_LONGEST_FRACTION} characters')
    p, q = int(match[1]), int(match[2] or 1)
    shared = math.gcd(p, q)
    # Then the common denominator is the least, and one point has one form: points are compared as tuples.
    return p // shared, q // shared


def _contact(place: Reader, moving: StatedPart, fixed: StatedPart) -> StatedContact:
    kind = place.only(_CONTACT).at("kind").text(_SIZES)
    own = place.at("moving").only(_SIDE).at("vertices").indices(len(moving.body.vertices), 1)
    other = place.at("fixed").only(_SIDE).at("vertices").indices(len(fixed.body.vertices), 1)
    for indices, size in zip((own, other), _SIZES[kind], strict=True):
        if len(indices) < size or (size < 3 and len(indices) != size):
            raise place.fail(f"a {kind} contact has other numbers of vertices")
    centres = {vertex for vertex, _ in moving.body.balls}
    if kind in ("vertex-face", "ball-face") and (own[0] in centres) != (kind == "ball-face"):
        raise place.fail(f"a {kind} contact is one of a {'point' if own[0] in centres else 'ball'} of the moving part")
    return StatedContact(place.at("id").label(), kind, own, other)


def _framed(place: Reader) -> tuple[tuple[str, Numbers], ...]:
    """The boxes of start errors by the frame that they are fixed in; none where all are fixed in the world."""
    if not place.has("sources"):
        return ()
    found = []
    for item in place.at("sources").items(1):
        found.append((item.only(_SOURCE).at("frame").text(FIXED_IN), item.at("box").numbers(6, 0.0, 0.5)))
    if len({frame for frame, _ in found}) != len(found):
        raise place.at("sources").fail("repeats a frame")
    by_axis = zip(*(box for _, box in found), strict=True)
    for whole, parts in zip(place.at("start_box").numbers(6), by_axis, strict=True):
        if abs(math.fsum(parts) - whole) > 1e-12 * whole:
            raise place.at("sources").fail("do not add up to the start box")
    return tuple(found)


def _specification(place: Reader) -> StatedSpecification:
    names = ("speed", "contact_force", "torque_limit", "friction", "termination_force")
    limits = ("impact_force", "apparent_mass", "contact_stiffness")
    speed, contact_force, torque, friction, threshold = (place.at(name).number(0.0) for name in names)
    impact = None
    if any(place.has(name) for name in limits):
        force, mass, stiffness = (place.at(name).number(0.0, 1e12) for name in limits)
        impact = force, mass, stiffness
    return StatedSpecification(speed, contact_force, torque, friction, threshold, impact)
