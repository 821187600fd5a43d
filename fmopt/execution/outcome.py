"""What became of a trial: where the part came to rest, what it touched on the way, and where it first left the plan."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from fmopt.execution.program import FAILED
from fmopt.execution.rig import Event, Rig
from fmopt.execution.rotation import between, from_quaternions, quaternions
from fmopt.guarded.contacts import Contact
from fmopt.guarded.moves import Move
from fmopt.plan import Plan
from fmopt.se3 import Pose

SHARE = 0.2  # of the clearance, that the physics may penetrate and the part overshoot
CLOSED = 0.25  # of the clearance, up to which a contact counts as closed
_NEAR = 0.002  # m, from where a planned contact touches
_LEVEL = 1e-4  # m, how far off a face forces on it are found
_PRESSES = 0.5  # N
_SLOW = (1e-3, 0.05)  # m/s and rad/s


@dataclass(frozen=True)
class Fit:
    """The fit that success is measured by: clearance a side and depth, m, the half-diagonal ρ, m, and the goal pose."""

    clearance: float
    depth: float
    rho: float
    goal: Pose
    loose: float

    @staticmethod
    def of(plan: Plan) -> Fit:
        """The fit of a plan; `loose` is what its own error sets leave open of the depth, m."""
        goal, last = Pose.from_vector(plan.goal), plan.segments[-1]
        loose = 0.0 if last.hybrid.felt else last.tube.box[2]
        return Fit(plan.moving.measured_clearance, -float(goal.p[2]), plan.rho, goal, loose)


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


def note(log: Log, event: Event, rig: Rig, moves: Sequence[Move], known: Mapping[str, Contact], fit: Fit) -> None:
    """Holds the contacts at the end of a move against the plan's; without moves nothing is planned."""
    program = rig.program
    if rig.state.step[event.body] < 0:
        log.ended = event.time
    if rig.state.step[event.body] == FAILED:
        log.departures.append(f"{_spoken(program.steps[event.step].move)}: contact not felt")
        return
    if not moves:
        return
    move = moves[event.step]
    following = rig.state.step[event.body]
    if following >= 0 and program.steps[following].move == move.number:
        return
    last = max(i for i, other in enumerate(moves) if other.number == move.number)
    log.departures += departures(rig, event.body, moves[last], known, fit)


def _spoken(number: int) -> str:
    """A move as people count them, from 1; plans count from 0."""
    return f"move {number + 1}"


def departures(rig: Rig, body: int, move: Move, known: Mapping[str, Contact], fit: Fit) -> list[str]:
    """Planned contacts that gape, and forces where none is planned, in words.

    Edges that have turned parallel cross nowhere; what they hold, the vertices at their ends hold on the faces. Where
    several vertices are to be on one face, what lies between them may press on it anywhere.
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
    flat = [one for n, one in enumerate(corners) if any(_same_face(one, other) for other in corners[:n])]
    sensed = rig.contacts[body]
    pressing = sensed[(sensed[:, 0] > 0.0) & (np.linalg.norm(sensed[:, 1:4], axis=1) > _PRESSES)]
    for row in pressing:
        near = any(float(np.linalg.norm(row[5:] - place)) <= _NEAR for place in places)
        if not near and not any(abs(face.above(row[5:])) <= _LEVEL for face in flat):
            found.append(f"{_spoken(move.number)}: a contact that is not planned")
            break
    return found


def _same_face(one: Contact, other: Contact) -> bool:
    """Whether two contacts of vertices are with the same fixed face."""
    return np.array_equal(one.fixed, other.fixed)


def watch(logs: Sequence[Log], rig: Rig, left: Container[int] = ()) -> None:
    """Forces and depth, in every period; of all bodies but those `left` out."""
    filtered = np.linalg.norm(rig.state.filtered[:, :3], axis=1)
    raw = np.linalg.norm(rig.reaction[:, :3], axis=1)
    for body, log in enumerate(logs):
        if body in left:
            continue
        log.peak, log.impact = max(log.peak, float(filtered[body])), max(log.impact, float(raw[body]))
        log.lowest = min(log.lowest, float(rig.qpos[body, 2]))


def rest(log: Log, rig: Rig, body: int, fit: Fit) -> dict[str, Any]:
    """The verdict on the whole pose at rest, with the reasons against it."""
    q, v = rig.qpos[body], rig.qvel[body]
    off = q[:3] - fit.goal.p
    turned = between(q[3:], quaternions(fit.goal.vector()[3:]))
    room = 2.0 * (1.0 + SHARE) * fit.clearance
    failed = bool(rig.state.step[body] == FAILED)
    checks = (
        (not failed, "stopped on the way"),
        (abs(off[2]) <= fit.clearance + fit.loose, f"{1e3 * off[2]:.3f} mm from its depth"),
        (float(np.abs(off[:2]).max()) <= room, "beside the hole"),
        (float(np.abs(turned[:2]).max()) <= 2.0 * room / fit.depth, "tilted"),
        (abs(turned[2]) <= 2.0 * room / fit.rho, "turned about its axis"),
        (np.linalg.norm(v[:3]) <= _SLOW[0] and np.linalg.norm(v[3:]) <= _SLOW[1], "not at rest"),
        (fit.goal.p[2] - log.lowest <= SHARE * fit.clearance + fit.loose, "overshot"),
        (rig.depth[body] <= SHARE * fit.clearance, f"penetration {1e6 * rig.depth[body]:.1f} µm"),
    )
    reasons = [words for good, words in checks if not good]
    return {
        "success": not reasons,
        "reasons": reasons,
        "departures": log.departures,
        "seconds": log.spent + log.ended if np.isfinite(log.ended) else None,
        "peak_force": log.peak,
        "impact_force": log.impact,
        "penetration": float(rig.depth[body]),
        "offset": [float(value) for value in off],
        "turn": [float(value) for value in turned],
        "retries": [asdict(retry) for retry in log.retries],
    }
