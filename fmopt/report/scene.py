"""The motion in three dimensions, to be turned and played: data for `scene.js`, with nothing from outside.

The fixed part is cut open by a quarter on the side that looks at the viewer, so that the hole is seen.
"""

import html
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from importlib.resources import files
from itertools import groupby, pairwise
from typing import Any

import numpy as np

from fmopt.geometry.convex_pieces import clip, faceted
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.geometry.section import section
from fmopt.plan import Numbers, Plan, Segment, StatedContact, StatedPart
from fmopt.plan.description import TracePose
from fmopt.plan.evidence import Evidence
from fmopt.plan.press import Press, first_presses
from fmopt.report.bodies import body_of, contact_place, creases, loops_of, pieces_of
from fmopt.report.moves import margin_claim, move_words, moves, turn_between
from fmopt.report.presses import outcome_words, press_rows, presses_of
from fmopt.report.sections import start_of
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array

_ROUND = 4  # decimals of a coordinate in mm: 0.1 µm
_MAX_DRAWS = 1000  # beside the vertices
_SAME = 1e-9  # m, and what the cosine between equal normals may be short of 1 by
_LEANS = math.sin(math.radians(1.0))  # a lean from which on the first view is across it
# How near to a wall's plane sight may change its side, and how far off that plane it is led: 20° together.
_ALONGSIDE, _ASIDE = math.sin(math.radians(5.0)), math.sin(math.radians(15.0))


def resource(name: str) -> str:
    """The text of a file that lies beside this module."""
    return files("fmopt.report").joinpath(name).read_text(encoding="utf-8")


def embedded(value: Any) -> str:
    """JSON that may stand in a script element: nothing in it can end the element or start another."""
    text = json.dumps(value, separators=(",", ":"), ensure_ascii=True)
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


@dataclass(frozen=True)
class SceneLeg:
    """A piece of the way that is shown: poses (6,) at its ends, the contacts held, made at its end, and its share."""

    move: int
    start: Numbers
    goal: Numbers
    held: tuple[str, ...] = ()
    made: tuple[str, ...] = ()
    share: tuple[float, float] = (0.0, 1.0)


# Controls of the scene: what stands before them, their name, and their choices in words.
Choices = Sequence[tuple[str, str, Mapping[str, str]]]
_GUARDED: Choices = (
    ("look at", "look", {"whole": "everything", "contact": "the contact being made"}),
    ("contacts", "names", {"ids": "with their ids", "dots": "dots only"}),
)
_ARROWS = ("arrows", "names", {"ids": "with numbers", "none": "not shown"})
_OF_CONTACTS = "Dots: contacts held; rings: contacts being made, each with its id"
_OF_PRESSES = (
    "Grey: the part where the press begins; green: its way and the twist; red: force and moment. A dot is where a "
    "trial came to rest that seats, a ring one that seats at a later attempt, a cross one that does not: click it for "
    "its name, or to see it"
)


def scene(plan: Plan) -> str:
    """The viewer as a fragment of HTML."""
    data, label = scene_data(plan), _label(plan.moving, plan.fixed)
    if plan.press_plan is None:
        return _viewer(data, label, "")
    ways = {way["name"]: f"{way['name']}, which does not seat" for way in data.get("ways", ())}
    trials = (
        ("shown", "run", {"": "a trial without errors", **ways}),
        ("look at", "look", {"whole": "everything", "rests": "where trials come to rest"}),
        ("trials", "cloud", {"step": "after each press", "end": "at their end", "none": "not shown"}),
    )
    choices = trials if "ways" in data else [("look at", "look", {"whole": "everything"})]
    return _viewer(data, label, "", (*choices, _ARROWS), _OF_PRESSES)


def seating(moving: StatedPart, fixed: StatedPart, nodes: Sequence[Numbers]) -> str:
    """A viewer of two parts on a way straight from pose to pose (6,) in B, m and rad, as a fragment of HTML."""
    legs = [SceneLeg(k, a, b) for k, (a, b) in enumerate(pairwise(nodes))]
    return _viewer(_data(moving, fixed, legs), _label(moving, fixed), "")


def part_scene(part: StatedPart) -> str:
    """A part alone, as a fragment of HTML: it can be turned and cut open, and nothing moves."""
    body, stock, quarter = faceted(body_of(part.body)), [*map(faceted, pieces_of(part))], (1, -1)
    data = _fixed_data(body, stock, (quarter, _into(quarter)), [SceneLeg(0, (0.0,) * 6, (0.0,) * 6)])
    return _viewer(data, f"Picture in three dimensions of {part.name}", " scene-still")


def _viewer(
    data: Mapping[str, Any], label: str, kind: str, choices: Choices = _GUARDED, legend: str = _OF_CONTACTS
) -> str:
    text = embedded(data)
    # One id for each viewer on a page, and the same one every time, as the page is the same bytes.
    name = f"scene-{sha256(text.encode()).hexdigest()[:12]}"
    frame = resource("scene.html").replace("{{name}}", name).replace("{{kind}}", kind)
    frame = frame.replace("{{legend}}", legend).replace("{{choices}}", "\n".join(_choice(*one) for one in choices))
    frame = frame.replace("{{label}}", html.escape(label))  # last: names of parts may look like a placeholder
    program = f"(function(){{{resource('scene.js')}\nshowScene(document.getElementById('{name}'));}})();"
    return (
        f'{frame}<script type="application/json" id="{name}-data">{text}</script>\n'
        f"<style>{resource('scene.css')}</style>\n<script>{program}</script>\n"
    )


def _choice(words: str, name: str, options: Mapping[str, str]) -> str:
    listed = "".join(f'<option value="{one}">{said}</option>' for one, said in options.items())
    return f'<label class="scene-moves">{words} <select data-do="{name}">{listed}</select></label>'


def _label(moving: StatedPart, fixed: StatedPart) -> str:
    return f"Picture in three dimensions of {moving.name} going into {fixed.name}"


def scene_data(plan: Plan) -> dict[str, Any]:
    """What the viewer shows, lengths in mm: polygons and lines of both parts, the path, the moves in words."""
    if plan.press_plan is not None:
        return _press_data(plan)
    run = moves(plan)
    data = _data(plan.moving, plan.fixed, [_leg_of(piece, k) for k, move in enumerate(run) for piece in move.segments])
    said = [(move_words(plan, m), ", ".join(m.state) or "nothing", margin_claim(plan, m.margin)) for m in run]
    return {
        **data,
        "moves": [dict(zip(("words", "held", "margin"), one, strict=True)) for one in said],
        "contacts": {c.id: _pair(plan, c) for c in plan.contacts},
    }


def _press_data(plan: Plan) -> dict[str, Any]:
    """What the viewer shows of presses: a trial without errors, the ways of some that fail, where all came to rest."""
    attempts, evidence = presses_of(plan).attempts, plan.trials
    most = max(float(np.linalg.norm(press.wrench[:3])) for attempt in attempts for press in attempt.presses)
    captions = [
        {
            "words": f"{press.name}: wrench {row[3]}, twist {row[2]}",
            "held": f"all but what follows: {row[1]}",
            "margin": row[4],
            "at": _rounded(press.reference),
            "arrows": _arrows(press, most),
        }
        for attempt in attempts
        for press, row in zip(attempt.presses, press_rows(attempt), strict=True)
    ]
    backs = len(captions)
    captions.append({"words": "out along its way, to the next start", "held": "all", "at": [0.0] * 3, "arrows": []})
    trace = list(plan.description.trace)
    for number in sorted({*range(len(attempts[0].presses))} - {one.press for one in trace}):
        # It ends as soon as it begins, or is not come to: the part stays.
        begun = (one for one in trace if one.press < number)
        stays = max(begun, key=lambda one: (one.press, one.time), default=TracePose(0.0, 0, start_of(plan)))
        trace += [replace(stays, press=number)] * 2
    legs, steps = _steps(sorted(trace, key=lambda one: one.press), backs)
    data = {**_data(plan.moving, plan.fixed, legs), "moves": captions, "steps": steps}
    return data if evidence is None else {**data, **_trial_data(evidence, first_presses(attempts), backs)}


def _trial_data(evidence: Evidence, firsts: Sequence[int], backs: int) -> dict[str, Any]:
    """Ends of trials in words, where they were after each press and, last, at their end, and ways that are kept."""
    trials, ways = list[dict[str, str]](), list[dict[str, Any]]()
    cloud = [list[list[float]]() for _ in range(backs + 1)]
    for count, (name, one) in enumerate(evidence.by_name.items()):
        if _MAX_DRAWS <= count < evidence.draws and not one.way:
            continue
        for first, rests in zip(firsts, one.rests, strict=False):
            for number, rest in enumerate(rests, start=first):
                cloud[number].append([len(trials), *_rounded(rest)])
        cloud[backs] += [[len(trials), *_rounded(rests[-1])] for rests in one.rests[-1:]]
        end = "failed" if not one.seated else "later" if one.attempt else "seated"
        trials.append({"name": name, "end": end, "words": outcome_words(one)})
        if len(one.way) > 1:
            legs, steps = _steps(one.way, backs)
            ways.append({"name": name, "words": outcome_words(one), "path": [*map(_leg, legs)], "steps": steps})
    return {"trials": trials, "cloud": cloud, "ways": ways}


def _steps(poses: Sequence[TracePose], backs: int) -> tuple[list[SceneLeg], list[int]]:
    """Legs between poses, and the caption of each move: the press, or `backs`. The legs of a move share it by time."""
    legs, captions = list[SceneLeg](), list[int]()
    for caption, group in groupby(pairwise(poses), key=lambda pair: backs if pair[0].back else pair[0].press):
        pairs = list(group)
        begin, whole = pairs[0][0].time, pairs[-1][1].time - pairs[0][0].time or 1.0
        for one, other in pairs:
            share = round((one.time - begin) / whole, 4), round((other.time - begin) / whole, 4)
            legs.append(SceneLeg(len(captions), one.pose, other.pose, share=share))
        captions.append(caption)
    return legs, captions


def _arrows(press: Press, most: float) -> list[dict[str, Any]]:
    """Arrows of a press: directions, of forces as long as their share of the greatest one, N."""
    force, moment, way, turn = np.reshape([*press.wrench, *press.twist], (4, 3))
    rate = "°/s"
    if press.rocking is not None:
        turn, rate = np.array([0.0, 0.0, press.rocking.angle]), "° cone"
    listed = (
        ("wrench", False, force, most, 1.0, " N"),
        ("wrench", True, moment, 0.0, 1.0, " N m"),
        ("twist", False, way, 0.0, 1e3, " mm/s"),
        ("twist", True, turn, 0.0, math.degrees(1.0), rate),
    )
    return [
        {"ink": ink, "turn": turns, "v": np.round(v / (whole or size), 4).tolist(), "words": f"{gain * size:.3g}{unit}"}
        for ink, turns, v, whole, gain, unit in listed
        if (size := float(np.linalg.norm(v))) > 0.0
    ]


def _data(moving: StatedPart, fixed: StatedPart, legs: Sequence[SceneLeg]) -> dict[str, Any]:
    """What the viewer shows of two parts on a way without moves."""
    peg = faceted(body_of(moving.body))
    skin = [*map(_rounded, _covering(peg, [*map(faceted, pieces_of(moving))]))]
    data = _fixed_data(body_of(fixed.body), pieces_of(fixed), _opening(legs), legs)
    return {**data, "moving": {"polygons": skin, "lines": _rounded(_creases(peg))}}


def _fixed_data(
    block: Polyhedron, stock: Sequence[Polyhedron], view: tuple[tuple[int, int], float], legs: Sequence[SceneLeg]
) -> dict[str, Any]:
    """What the viewer shows where nothing moves; `view` is the quarter to take away and the azimuth, rad."""
    quarter, azimuth = view
    return {
        "moving": {"polygons": [], "lines": []},
        "fixed": {"polygons": [*map(_rounded, _covering(block, stock))], "lines": _rounded(_creases(block))},
        "open": _opened(block, stock, quarter),
        "quarter": list(quarter),
        "azimuth": azimuth,
        "path": [_leg(leg) for leg in legs],
        "moves": [],
        "contacts": {},
    }


def _leg_of(piece: Segment, move: int) -> SceneLeg:
    new = tuple(contact for contact in piece.goal_state if contact not in piece.state)
    return SceneLeg(move, piece.start, piece.goal, piece.state, new, piece.progress)


def _leg(leg: SceneLeg) -> dict[str, Any]:
    start = Pose.from_vector(leg.start)
    return {
        "move": leg.move,
        "span": list(leg.share),
        "p": _rounded([leg.start[:3], leg.goal[:3]]),
        "R": np.round(start.R, 9).tolist(),
        "w": np.round(turn_between(leg.start, leg.goal), 9).tolist(),
        "held": list(leg.held),
        "made": list(leg.made),
    }


def _pair(plan: Plan, contact: StatedContact) -> list[list[Any]]:
    """The corners of both features of a contact; of a ball its centre, and behind them the way from there to it."""
    pair = [_places(plan.moving, contact.moving), _places(plan.fixed, contact.fixed)]
    if contact.kind != "ball-face":
        return pair
    centre = plan.moving.body.vertices[contact.moving[0]]
    return [*pair, _rounded(contact_place(plan, contact.id, Pose.identity()) - centre)]


def _places(part: StatedPart, vertices: Sequence[int]) -> list[list[float]]:
    return list(_rounded([part.body.vertices[i] for i in vertices]))


def _rounded(points: Any) -> Any:
    """Points in m as lists in mm."""
    # Adding 0.0 leaves no −0.0, which would be other bytes.
    return (np.round(1e3 * np.asarray(points, dtype=np.float64), _ROUND) + 0.0).tolist()


def _opening(legs: Sequence[SceneLeg]) -> tuple[tuple[int, int], float]:
    """The quarter to take away, and the azimuth of the first view, rad: across the greatest lean where there is one.

    The line of sight is level with the axis about which the part leans, turned by at most 20°, into the quarter so that
    both walls of the cut are seen.
    """
    goal = legs[-1].goal
    # Signs (x, y): the quarter that the goal leans away from, so that its walls are seen.
    quarter = (1 if goal[0] <= 0.0 else -1, 1 if goal[1] < 0.0 else -1)
    axes = [Pose.from_vector(pose).R[:, 2] for leg in legs for pose in (leg.start, leg.goal)]
    lean = max((axis[:2] for axis in axes), key=lambda across: float(np.linalg.norm(across)), default=np.zeros(2))
    size = float(np.linalg.norm(lean))
    if size < _LEANS:
        return quarter, _into(quarter)
    sight = np.array([-lean[1], lean[0]]) / size
    sight = sight if float(sight @ quarter) >= 0.0 else -sight
    signs = [q if abs(s) < _ALONGSIDE else int(np.sign(s)) for s, q in zip(sight, quarter, strict=True)]
    x, y = np.maximum(np.abs(sight), _ASIDE) * signs
    return (signs[0], signs[1]), round(math.atan2(y, x), 4)


def _into(quarter: tuple[int, int]) -> float:
    """The azimuth, rad, from which both walls of the cut are seen."""
    return round(math.atan2(quarter[1], 0.8 * quarter[0]), 4)


def _covering(body: Polyhedron, pieces: Sequence[Polyhedron]) -> list[Array]:
    """Convex polygons that cover the surface: faces of the pieces in planes of the part's faces."""
    # Faces of the part may have holes or notches; those of its pieces are convex, which is all that the viewer fills.
    normals, offsets = body.normals, body.offsets
    found = []
    for piece in pieces:
        for face in piece.faces:
            if np.any((normals @ face.normal > 1.0 - _SAME) & (np.abs(offsets - face.offset) < _SAME)):
                found.append(piece.vertices[list(face.loops[0])])
    return found


def _creases(body: Polyhedron) -> list[Array]:
    """The edges worth a line, each (2, 3), m."""
    return [body.vertices[list(edge.vertices)] for edge in creases(body)]


def _opened(body: Polyhedron, pieces: Sequence[Polyhedron], quarter: tuple[int, int]) -> dict[str, Any]:
    """The part without a quarter about the mating axis: its skin, the faces of the cut, and the lines of both."""
    x, y = quarter[0] * np.array([1.0, 0.0, 0.0]), quarter[1] * np.array([0.0, 1.0, 0.0])
    skin = [part for loop in _covering(body, pieces) for part in _outside(loop, x, y)]
    caps = []
    for normal, other in ((x, y), (y, x)):
        for piece in pieces:
            # `clip` gives back what it does not cut as it is, and puts the face of the cut last.
            half = clip(piece, normal, 0.0)
            if half is not None and half is not piece:
                rest = _clipped(half.vertices[list(half.faces[-1].loops[0])], -other)
                caps += [rest] if len(rest) else []
    lines = [part for line in _creases(body) for part in _outside(line, x, y)] + _cut_lines(pieces, x, y)
    named = {"polygons": skin, "caps": caps, "lines": lines}
    return {name: [_rounded(loop) for loop in loops] for name, loops in named.items()}


def _outside(points: Array, x: Array, y: Array) -> list[Array]:
    """The parts of a polygon or line outside the quarter x·p > 0, y·p > 0."""
    # In two, along x·p = 0: a convex polygon without a quarter need not be convex.
    rest = _clipped(points, -x)
    return [part for part in (_clipped(points, x), _clipped(rest, y) if len(rest) else rest) if len(part)]


def _clipped(points: Array, normal: Array) -> Array:
    """The part of a convex polygon (n, 3), or of a line (2, 3), with normal·p ≤ 0; (0, 3) when nothing is left."""
    height = points @ normal
    height[np.abs(height) < _SAME] = 0.0  # no slivers along the plane
    # A polygon that touches the plane from beyond leaves nothing; one that lies in it stays.
    if len(points) > 2 and np.min(height) >= 0.0 and np.max(height) > 0.0:
        return np.zeros((0, 3))
    kept = []
    for k, (a, b) in enumerate(zip(height, np.roll(height, -1), strict=True)):
        if a <= 0.0:
            kept.append(points[k])
        if a * b < 0.0 and (len(points) > 2 or k == 0):  # the way back along a line would cross it again
            kept.append(points[k] + a / (a - b) * (points[(k + 1) % len(points)] - points[k]))
    return np.array(kept) if len(kept) >= min(len(points), 3) else np.zeros((0, 3))


def _cut_lines(pieces: Sequence[Polyhedron], x: Array, y: Array) -> list[Array]:
    """The outlines of the two faces of the cut, in the half-planes that bound the quarter."""
    lines = []
    for other in (y, x):
        frame = Pose(np.zeros(3), np.column_stack([other, [0.0, 0.0, 1.0], np.cross(other, [0.0, 0.0, 1.0])]))
        for corners in loops_of(section(pieces, frame)):
            for line in pairwise(np.column_stack([corners, np.zeros(len(corners))]) @ frame.R.T):
                part = _clipped(np.array(line), -other)
                lines += [part] if len(part) else []
    return lines
