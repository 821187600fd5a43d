"""What trials add up to: success with its interval, contacts as planned, forces, times, failures by first departure.

What became of a trial: where the part came to rest, what it touched on the way, and where it first left the plan.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from math import pi
from typing import Any

import numpy as np

from fmopt.execution.confidence import success_interval
from fmopt.execution.program import FAILED
from fmopt.execution.rig import Event, Rig
from fmopt.execution.rotation import between, from_quaternions, quaternions
from fmopt.geometry.polyhedron import from_faces
from fmopt.plan import Body, Plan
from fmopt.plan.contact_geometry import Contact
from fmopt.plan.guarded_moves import PlanMove
from fmopt.plan.press import Seat
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array

SHARE = 0.2  # of the clearance, that the physics may penetrate and the part overshoot
CLOSED = 0.25  # of the clearance, up to which a contact counts as closed
_NEAR = 0.002  # m, from where a planned contact touches
_LEVEL = 1e-4  # m, how far off a face forces on it are found
_PRESSES = 0.5  # N
_SLOW = (1e-3, 0.05)  # m/s and rad/s


def summary(records: Sequence[Any]) -> dict[str, Any]:
    """Inside and beyond the certified set, and the success by size of error, in boxes."""
    inside = [record for record in records if record["size"] <= 1.0]
    beyond = [record for record in records if record["size"] > 1.0]
    return {
        "inside": _share(inside),
        "beyond": _share(beyond),
        "by_size": _by_size(records),
        "failures": failures(records),
        "departures": dict(Counter(r["departures"][0] for r in inside if r["departures"]).most_common()),
    }


def failures(records: Sequence[Any]) -> list[dict[str, Any]]:
    """Groups of failures by their first departure from the plan, or else their reason, largest first."""
    groups: dict[str, list[int]] = {}
    for record in records:
        if not record["success"]:
            first = record["departures"][0] if record["departures"] else record["reasons"][0]
            groups.setdefault(first, []).append(record["trial"])
    ordered = sorted(groups.items(), key=lambda group: (-len(group[1]), group[0]))
    return [{"departure": first, "count": len(numbers), "trials": numbers} for first, numbers in ordered]


def _share(records: Sequence[Any]) -> dict[str, Any]:
    if not records:
        return {"trials": 0}
    successes = sum(record["success"] for record in records)
    low, high = success_interval(successes, len(records))
    # Trials that tried again would have failed without.
    alone = sum(record["success"] and not record["retries"] for record in records)
    return {
        "trials": len(records),
        "successes": successes,
        "share": successes / len(records),
        "interval": [low, high],
        "without_recovery": {"successes": alone, "interval": list(success_interval(alone, len(records)))},
        "as_planned": sum(not record["departures"] for record in records) / len(records),
        "seconds": _spread([r["seconds"] for r in records if r["seconds"] is not None]),
        "peak_force": _spread([r["peak_force"] for r in records]),
        "impact_force": _spread([r["impact_force"] for r in records]),
        "penetration": _spread([r["penetration"] for r in records]),
    }


def _spread(values: Sequence[float]) -> dict[str, float]:
    """Median and largest."""
    return {"median": float(np.median(values)), "largest": float(np.max(values))} if len(values) else {}


def _by_size(records: Sequence[Any], width: float = 0.25) -> list[dict[str, Any]]:
    rows: dict[int, list[bool]] = {}
    for record in records:
        # Bins are closed above, as a size of 1 is still inside.
        rows.setdefault(max(int(np.ceil(record["size"] / width)) - 1, 0), []).append(record["success"])
    return [
        {"size": [width * k, width * (k + 1)], "trials": len(rows[k]), "share": sum(rows[k]) / len(rows[k])}
        for k in sorted(rows)
    ]


def _in_words(share: float, interval: Sequence[float]) -> str:
    low, high = interval
    return f"{100 * share:.1f} % (95 % interval {100 * low:.1f} to {100 * high:.1f} %)"


def lines(found: dict[str, Any]) -> list[str]:
    """The summary for people."""
    told = []
    if (said := found.get("verdict", "CERTIFIED")) != "CERTIFIED":
        told.append(f"the plan is {said}: no set of errors is certified, trials are all that is known of it")
    told += [found["caution"]] if "caution" in found else []
    asked = f"; asked for {found['contact_force']:g} N of contact force"
    for name in ("inside", "beyond"):
        part = found[name]
        if part["trials"]:
            told.append(
                f"{name} the certified set: {part['successes']} of {part['trials']} seated, "
                f"{_in_words(part['share'], part['interval'])}, contacts as planned in {100 * part['as_planned']:.1f} %"
            )
            alone = part["without_recovery"]
            if alone["successes"] != part["successes"]:
                words = _in_words(alone["successes"] / part["trials"], alone["interval"])
                told.append(f"  without trying again {alone['successes']} of {part['trials']}, {words}")
            told.append(
                f"  force up to {part['peak_force']['largest']:.1f} N filtered, impact "
                f"{part['impact_force']['largest']:.1f} N, penetration up to "
                f"{1e6 * part['penetration']['largest']:.1f} µm{asked}"
            )
    for row in found["by_size"] if found["beyond"]["trials"] else ():
        low, high = row["size"]
        share = f"{100 * row['share']:.1f} % of {row['trials']} seated"
        told.append(f"  errors of {low:.2f} to {high:.2f} boxes ({'inside' if high <= 1.0 else 'beyond'}): {share}")
    for group in found["failures"]:
        told.append(f"  {group['count']} failed, first: {group['departure']}; such as trial {group['trials'][0]}")
    return told


@dataclass(frozen=True)
class Fit:
    """The fit that success is measured by: clearance a side and depth, m, the half-diagonal ρ, m, and the goal pose.

    Contacts of balls leave a part turned as it is, and what is fixed to it beside them where that is: `free` is what
    the plan's error sets then leave open of the pose (6,), m and rad, and 0 without balls. The part looks the same
    after each of `turns` parts of a whole turn about the axis. `moving` and `fixed` are the convex pieces of the parts,
    each as its planes (k, 4): outward normals, and how far they lie along these, m.
    """

    clearance: float
    depth: float
    rho: float
    goal: Pose
    loose: float
    free: tuple[float, ...] = (0.0,) * 6
    turns: int = 1
    moving: tuple[Array, ...] = ()
    fixed: tuple[Array, ...] = ()

    @staticmethod
    def of(plan: Plan) -> Fit:
        """The fit of a plan; `loose` is what its own error sets leave open of the depth, m."""
        goal, last = Pose.from_vector(plan.goal), plan.segments[-1]
        # A contact that ends the last move fixes the depth; a move that ends by its travel leaves it open.
        loose = 0.0 if last.hybrid.felt else last.tube.box[2]
        free = (*last.tube.box, *last.tube.angles) if plan.moving.body.balls else (0.0,) * 6
        moving, fixed = (tuple(map(_planes, plan.parts[side].pieces)) for side in ("moving", "fixed"))
        return Fit(plan.moving.measured_clearance, -float(goal.p[2]), plan.rho, goal, loose, free, 1, moving, fixed)

    @staticmethod
    def of_seat(seat: Seat) -> Fit:
        """The fit that success of presses is measured by."""
        free = (0.0, 0.0, 0.0, 0.0, 0.0, pi if seat.free_turn else 0.0)
        return Fit(seat.clearance, seat.depth, seat.rho, Pose.from_vector(seat.goal), seat.loose, free, seat.symmetry)

    def meet(self, point: Array, pose: Pose, goal: Pose) -> bool:
        """Whether what touches in a point (3,) of B, m, is to touch at a goal, as far as contacts count as closed."""
        # At the goal: carried there as a point of the moving part, or left in place and seen from that part.
        own, other = goal.apply(pose.inverse().apply(point)), goal.inverse().apply(point)
        return min(_off(self.fixed, own), _off(self.moving, other)) <= CLOSED * self.clearance


def _planes(piece: Body) -> Array:
    """The planes (k, 4) of a convex piece."""
    found = from_faces(piece.vertices, piece.faces)
    return np.column_stack([found.normals, found.offsets])


def _off(pieces: Sequence[Array], point: Array) -> float:
    """How far a point (3,) is from the surface of a part, about, m: from the planes of the piece next to it."""
    return abs(min((float((each[:, :3] @ point - each[:, 3]).max()) for each in pieces), default=np.inf))


@dataclass(frozen=True)
class Retry:
    """A move that failed, what was felt, and which of the plan's shifts is tried next."""

    move: int
    felt: str
    shift: int


@dataclass
class Log:
    """What is noted of one body on its way; `spent` is the time of the attempts before this one, s."""

    departures: list[str] = field(default_factory=list)
    ended: float = np.inf
    peak: float = 0.0
    impact: float = 0.0
    lowest: float = np.inf
    outcome: dict[str, Any] | None = None
    spent: float = 0.0
    retries: list[Retry] = field(default_factory=list)


def note(log: Log, event: Event, rig: Rig, moves: Sequence[PlanMove], known: Mapping[str, Contact], fit: Fit) -> None:
    """Holds the contacts at the end of a move against the plan's; without moves nothing is planned."""
    program = rig.program
    # The rig has gone on already: this is the step after that of the event.
    if rig.state.step[event.body] < 0:
        log.ended = event.time
    if rig.state.step[event.body] == FAILED:
        log.departures.append(f"{_spoken(program.steps[event.step].move)}: contact not felt")
        return
    if not moves:
        return
    move = moves[event.step]  # a plan's program has a step for each of its segments
    following = rig.state.step[event.body]
    if following >= 0 and program.steps[following].move == move.number:
        return
    # A contact that is felt early ends the move on an earlier piece; the plan says of the last one what then touches.
    last = max(i for i, other in enumerate(moves) if other.number == move.number)
    log.departures += departures(rig, event.body, moves[last], known, fit)


def _spoken(number: int) -> str:
    """A move as people count them, from 1; plans count from 0."""
    return f"move {number + 1}"


def departures(rig: Rig, body: int, move: PlanMove, known: Mapping[str, Contact], fit: Fit) -> list[str]:
    """Planned contacts that gape, and forces where none is planned, in words.

    Edges that have turned parallel cross nowhere; what they hold, the vertices at their ends hold on the faces. Where
    several vertices are to be on one face, what lies between them may press on it anywhere. Contacts that follow from
    others, as those of parallel walls do, are not listed: what is to touch at the goal may.
    """
    q = rig.qpos[body]
    pose = Pose(q[:3], from_quaternions(q[3:]))
    found, places = [], []
    for name in move.goal_state:
        point, _, gap = known[name].touch(pose)
        places.append(point)
        if known[name].within(pose) and abs(gap) > CLOSED * fit.clearance:
            found.append(f"{_spoken(move.number)}: {name} open")
    corners = [known[name] for name in move.goal_state if known[name].kind == "vertex-face"]
    flat = [one for n, one in enumerate(corners) if any(np.array_equal(one.fixed, c.fixed) for c in corners[:n])]
    sensed = rig.engine.contacts[body]  # columns as `FIELDS`: found, force, distance, position
    pressing = sensed[(sensed[:, 0] > 0.0) & (np.linalg.norm(sensed[:, 1:4], axis=1) > _PRESSES)]
    for row in pressing:
        near = any(float(np.linalg.norm(row[5:] - place)) <= _NEAR for place in places)
        level = any(abs(face.above(row[5:])) <= _LEVEL for face in flat)
        if not near and not level and not fit.meet(row[5:], pose, move.goal):
            found.append(f"{_spoken(move.number)}: a contact that is not planned")
            break
    return found


def watch(logs: Sequence[Log], rig: Rig, left: Container[int] = ()) -> None:
    """Forces and depth, in every period."""
    filtered = np.linalg.norm(rig.state.filtered[:, :3], axis=1)
    raw = np.linalg.norm(rig.reaction[:, :3], axis=1)
    for body, log in enumerate(logs):
        if body in left:
            continue
        log.peak, log.impact = max(log.peak, float(filtered[body])), max(log.impact, float(raw[body]))
        log.lowest = min(log.lowest, float(rig.qpos[body, 2]))


def reasons_at_rest(fit: Fit, q: Array, v: Array, lowest: float, depth: float) -> tuple[list[str], Array, Array]:
    """What speaks against a part being seated, in words, with how far it is from the goal: (3,), m, and (3,), rad.

    Pose q (7,) and velocity v (6,) are as an engine has them; `lowest` is the z of the reference point at its lowest,
    and `depth` the greatest penetration, m.
    """
    off = q[:3] - fit.goal.p
    turned = between(q[3:], quaternions(fit.goal.vector()[3:]))
    if fit.turns > 1:
        turned[2] -= round(turned[2] * fit.turns / (2.0 * pi)) * 2.0 * pi / fit.turns
    # From wall to wall, as the goal may lie against either, and what contacts may give way by.
    room, free = 2.0 * (1.0 + SHARE) * fit.clearance, np.array(fit.free)
    checks = (
        (abs(off[2]) <= fit.clearance + fit.loose, f"{1e3 * off[2]:.3f} mm from its depth"),
        (float((np.abs(off[:2]) - free[:2]).max()) <= room, "beside the hole"),
        (float((np.abs(turned[:2]) - free[3:5]).max()) <= 2.0 * room / fit.depth, "tilted"),
        (abs(turned[2]) - fit.free[5] <= 2.0 * room / fit.rho, "turned about its axis"),
        (np.linalg.norm(v[:3]) <= _SLOW[0] and np.linalg.norm(v[3:]) <= _SLOW[1], "not at rest"),
        (fit.goal.p[2] - lowest <= SHARE * fit.clearance + fit.loose, "overshot"),
        (depth <= SHARE * fit.clearance, f"penetration {1e6 * depth:.1f} µm"),
    )
    return [words for good, words in checks if not good], off, turned


def rest(log: Log, rig: Rig, body: int, fit: Fit) -> dict[str, Any]:
    """The verdict on the whole pose at rest, with the reasons against it."""
    depth = float(rig.depth[body])
    reasons, off, turned = reasons_at_rest(fit, rig.qpos[body], rig.qvel[body], log.lowest, depth)
    if rig.state.step[body] == FAILED:
        reasons.insert(0, "stopped on the way")
    return {
        "success": not reasons,
        "reasons": reasons,
        "departures": log.departures,
        "seconds": log.spent + log.ended if np.isfinite(log.ended) else None,
        "peak_force": log.peak,
        "impact_force": log.impact,
        "penetration": depth,
        "offset": [float(value) for value in off],
        "turn": [float(value) for value in turned],
        "retries": [asdict(retry) for retry in log.retries],
    }
