"""From JSON to a plan: every value that the check uses is taken out here, or the plan is refused."""

from __future__ import annotations

import math
from typing import Any

from fmopt.verify.document import (
    FORMAT,
    Body,
    Contact,
    ContactClaim,
    Hybrid,
    JamFree,
    Numbers,
    Part,
    Plan,
    Segment,
    Separation,
    Specification,
    Tube,
    Witness,
    digest,
)
from fmopt.verify.reader import Reader

LARGEST_TOLERANCE = 1e-9  # m
LARGEST_NUMBER_OF_PIECES = 400
_TOP = {
    "format", "problem", "verdict", "parts", "contacts", "segments", "uncertainty", "goal", "touch_tolerance",
    "not_covered", "sha256", "specification",
}  # fmt: skip
_BESIDE = {
    "fmopt_version", "units", "frames", "nominal", "critical_points", "position_force", "search", "diagnostics",
    "recovery",
}  # fmt: skip
_SEGMENT = {
    "critical_point", "move", "state", "goal_state", "progress", "start", "goal", "clearance", "margin",
    "binding_contact", "basis", "tube", "separations", "contacts",
}  # fmt: skip
_TUBE = {
    "shape_start", "shape_goal", "generators_start", "generators_goal", "growth_start", "growth_goal", "theta_max",
    "offset_max", "offset_box", "angle_box",
}  # fmt: skip
_HYBRID = {
    "frame", "position_axes", "force_axes", "velocity", "speed", "bias_wrench", "push", "normal_forces", "termination",
}  # fmt: skip
FRAMES = ("hole", "hand", "world")
_KINDS = ("vertex-face", "face-vertex", "edge-edge")
_WITNESSES = ("fixed-face", "moving-face", "edges", "plane")


def parse(document: Any) -> Plan:
    """The plan of a JSON document.

    Raises:
        PlanError: something is missing, unknown, of the wrong type or out of range.
    """
    top = Reader(document)
    if not isinstance(document, dict):
        raise top.fail("must be an object")
    top.at("format").text([FORMAT])
    top.only(_TOP, _BESIDE)
    top.at("verdict").text(("CERTIFIED", "NOT_PROVED", "REFUTED"))
    moving, fixed = (_part(top.at("parts").only(("moving", "fixed")).at(key)) for key in ("moving", "fixed"))
    contacts = tuple(_contact(item, moving, fixed) for item in top.at("contacts").items())
    known = [c.id for c in contacts]
    if len(set(known)) != len(known):
        raise top.at("contacts").fail("repeats an id")
    uncertainty = top.at("uncertainty").only(("start_box", "velocity_error", "rho"), ("sources",))
    sizes = len(moving.pieces), len(fixed.pieces)
    return Plan(
        top.at("problem").only(("sha256",), ("title",)).at("sha256").text(),
        top.at("sha256").text() == digest(document),
        moving,
        fixed,
        contacts,
        tuple(_segment(item, known, moving, fixed, sizes) for item in top.at("segments").items(1)),
        uncertainty.at("start_box").numbers(6, 0.0, 0.5),
        uncertainty.at("velocity_error").numbers(2, 0.0, 1.0),
        uncertainty.at("rho").number(2.0**-10, 16.0),
        _framed(uncertainty),
        _specification(top.at("specification")),
        _pose(top.at("goal")),
        top.at("touch_tolerance").number(0.0, LARGEST_TOLERANCE),
        tuple(item.text() for item in top.at("not_covered").items()),
    )


def _framed(place: Reader) -> tuple[tuple[str, Numbers], ...]:
    """The boxes of start errors by the frame that they are fixed in; none where all are fixed in the world."""
    if not place.has("sources"):
        return ()
    found = []
    for item in place.at("sources").items(1):
        item.only(("frame", "box"))
        found.append((item.at("frame").text(FRAMES), item.at("box").numbers(6, 0.0, 0.5)))
    if len({frame for frame, _ in found}) != len(found):
        raise place.at("sources").fail("repeats a frame")
    by_axis = zip(*(box for _, box in found), strict=True)
    for whole, parts in zip(place.at("start_box").numbers(6), by_axis, strict=True):
        if abs(math.fsum(parts) - whole) > 1e-12 * whole:
            raise place.at("sources").fail("do not add up to the start box")
    return tuple(found)


def _pose(place: Reader) -> Numbers:
    pose = place.numbers(6, -8.0, 8.0)
    if math.hypot(*pose[3:]) > 6.5:
        raise place.fail("a rotation vector must not be longer than a full turn")
    return pose


def _body(place: Reader) -> Body:
    vertices = tuple(item.numbers(3, -4.0, 4.0) for item in place.at("vertices").items(4))
    faces = tuple(
        tuple(loop.indices(len(vertices), 3) for loop in face.items(1)) for face in place.at("faces").items(4)
    )
    return Body(vertices, faces)


def _part(place: Reader) -> Part:
    place.only(("vertices", "faces", "pieces"), ("name", "declared_clearance", "measured_clearance"))
    pieces = []
    items = place.at("pieces").items(1)
    if len(items) > LARGEST_NUMBER_OF_PIECES:
        raise place.at("pieces").fail(f"must have at most {LARGEST_NUMBER_OF_PIECES} entries")
    for item in items:
        piece = _body(item.only(("vertices", "faces")))
        if any(len(face) != 1 for face in piece.faces):
            raise item.fail("a face of a convex piece has one loop")
        pieces.append(piece)
    return Part(_body(place), tuple(pieces))


def _contact(place: Reader, moving: Part, fixed: Part) -> Contact:
    place.only(("id", "kind", "moving", "fixed"))
    kind = place.at("kind").text(_KINDS)
    own = place.at("moving").only(("vertices",)).at("vertices").indices(len(moving.body.vertices), 1)
    other = place.at("fixed").only(("vertices",)).at("vertices").indices(len(fixed.body.vertices), 1)
    sizes = {"vertex-face": (1, 3), "face-vertex": (3, 1), "edge-edge": (2, 2)}[kind]
    for indices, size in zip((own, other), sizes, strict=True):
        if len(indices) < size or (size < 3 and len(indices) != size):
            raise place.fail(f"a {kind} contact has other numbers of vertices")
    return Contact(place.at("id").text(), kind, own, other)


def _ids(place: Reader, known: list[str]) -> tuple[str, ...]:
    found = tuple(item.text(known) for item in place.items())
    if len(set(found)) != len(found):
        raise place.fail("repeats a contact")
    return found


def _segment(place: Reader, known: list[str], moving: Part, fixed: Part, sizes: tuple[int, int]) -> Segment:
    place.only(_SEGMENT, ("hybrid", "leaving"))
    progress = place.at("progress").numbers(2, 0.0, 1.0)
    if not progress[0] < progress[1]:
        raise place.at("progress").fail("must increase")
    basis = []
    for item in place.at("basis").items():
        item.only(("contact", "direction", "made"))
        direction = item.at("direction").numbers(6, -4096.0, 4096.0)
        basis.append((item.at("contact").text(known), direction, item.at("made").flag()))
    claims = place.at("contacts").items()
    return Segment(
        place.at("critical_point").integer(),
        place.at("move").integer(),
        _ids(place.at("state"), known),
        _ids(place.at("goal_state"), known),
        (progress[0], progress[1]),
        _pose(place.at("start")),
        _pose(place.at("goal")),
        place.at("clearance").number(),
        place.at("margin").number(),
        place.at("binding_contact").text(),
        tuple(basis),
        _tube(place.at("tube")),
        tuple(_separation(item, moving, fixed, sizes) for item in place.at("separations").items()),
        tuple(_claim(item, known) for item in claims),
        _hybrid(place.at("hybrid"), known) if place.has("hybrid") else None,
        _ids(place.at("leaving"), known) if place.has("leaving") else (),
    )


def _tube(place: Reader) -> Tube:
    place.only(_TUBE)
    matrices = {
        f"{kind}_{end}": place.at(f"{kind}_{end}").matrix(None if kind == "generators" else 6)
        for kind in ("shape", "generators", "growth")
        for end in ("start", "goal")
    }
    theta, offset = place.at("theta_max").number(0.0, 1.0), place.at("offset_max").number(0.0, 1.0)
    box, angles = (place.at(key).numbers(3, 0.0, 1.0) for key in ("offset_box", "angle_box"))
    return Tube(matrices, theta, offset, box, angles)


def _separation(place: Reader, moving: Part, fixed: Part, sizes: tuple[int, int]) -> Separation:
    place.only(("moving_piece", "fixed_piece", "witness", "margin"))
    i, j = place.at("moving_piece").integer(sizes[0]), place.at("fixed_piece").integer(sizes[1])
    witness = place.at("witness")
    kind = witness.at("kind").text(_WITNESSES)
    witness.only(("kind", "moving", "fixed"), ("normal", "offset") if kind == "plane" else ())
    counts = {"fixed-face": (0, None), "moving-face": (None, 0), "edges": (2, 2), "plane": (0, 0)}[kind]
    own, other = (
        witness.at(key).indices(len(part.pieces[n].vertices), 0, count)
        for key, part, n, count in zip(("moving", "fixed"), (moving, fixed), (i, j), counts, strict=True)
    )
    normal: Numbers = (0.0, 0.0, 0.0)
    offset = 0.0
    if kind == "plane":
        normal, offset = witness.at("normal").numbers(3, -2.0, 2.0), witness.at("offset").number(-16.0, 16.0)
    return Separation(i, j, Witness(kind, own, other, normal, offset), place.at("margin").number())


def _claim(place: Reader, known: list[str]) -> ContactClaim:
    place.only(("id", "role", "normal", "offset", "remainder", "margin"))
    return ContactClaim(
        place.at("id").text(known),
        place.at("role").text(("held", "made")),
        place.at("normal").numbers(6),
        place.at("offset").number(),
        place.at("remainder").number(),
        place.at("margin").number(),
    )


def _hybrid(place: Reader, known: list[str]) -> Hybrid:
    place.only(_HYBRID, ("jam_free", "impact", "stays"))
    if place.has("stays"):
        place.at("stays").text(("push", "stop", "none"))
    end = place.at("termination").only(("contacts", "wrench", "threshold", "max_travel", "timeout"))
    forces = [item.only(("contact", "force")) for item in place.at("normal_forces").items()]
    return Hybrid(
        place.at("frame").numbers(6),
        place.at("position_axes").matrix(None),
        place.at("force_axes").matrix(None),
        place.at("velocity").numbers(6),
        place.at("speed").number(0.0),
        place.at("bias_wrench").numbers(6),
        place.at("push").number(),
        tuple((item.at("contact").text(known), item.at("force").number()) for item in forces),
        _ids(end.at("contacts"), known),
        end.at("wrench").numbers(6),
        end.at("threshold").number(0.0),
        end.at("max_travel").number(0.0),
        end.at("timeout").number(0.0, 1e12),
        _jam_free(place.at("jam_free")) if place.has("jam_free") else None,
        _impact(place.at("impact")) if place.has("impact") else None,
    )


def _impact(place: Reader) -> tuple[float, float]:
    place.only(("approach", "force"))
    return place.at("approach").number(0.0), place.at("force").number(0.0)


def _jam_free(place: Reader) -> JamFree:
    place.only(("push", "least_push", "angle", "planes", "twists"))
    planes = []
    for item in place.at("planes").items():
        away, to = item.only(("towards", "angles")).at("angles").numbers(2, 0.0, math.pi)
        planes.append((item.at("towards").text(), (away, to)))
    if len({name for name, _ in planes}) != len(planes):
        raise place.at("planes").fail("repeats a plane")
    least = place.at("least_push")
    return JamFree(
        place.at("push").number(0.0),
        None if least.value is None else least.number(0.0),
        place.at("angle").number(0.0, math.pi),
        tuple(planes),
        place.at("twists").matrix(None),
    )


def _specification(place: Reader) -> Specification:
    names = ("speed", "contact_force", "torque_limit", "friction", "termination_force")
    limits = ("impact_force", "apparent_mass", "contact_stiffness")
    place.only((*names, *limits) if any(place.has(name) for name in limits) else names)
    speed, contact_force, torque, friction, threshold = (place.at(name).number(0.0) for name in names)
    impact = None
    if place.has(limits[0]):
        force, mass, stiffness = (place.at(name).number(0.0, 1e12) for name in limits)
        impact = force, mass, stiffness
    return Specification(speed, contact_force, torque, friction, threshold, impact)
