"""A small plan built by hand: a tilted cube comes down on a table with one vertex and slides on it.

Everything that the plan states is computed here from the definitions, with 50 digits and for vertex-face contacts
alone: a second way to the numbers that the check derives.
"""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mpmath as mp

from fmopt.plan import FORMAT, FRAMES, NOT_COVERED, UNITS

mp.mp.dps = 50
RHO = 0.014
RATES = (0.01, 0.01)
START_BOX = (3e-4, 3e-4, 2e-4, 5e-3, 5e-3, 5e-3)
TILT = (0.2, -0.15, 0.02)
CLEARANCE = {"declared_clearance": [1e-3, 1e-3], "measured_clearance": 1e-3}
CONTROL = {"speed": 0.01, "contact_force": 20.0, "torque_limit": 1.0, "friction": 0.3, "termination_force": 2.0}


def box_body(low: Sequence[float], high: Sequence[float]) -> dict[str, Any]:
    """A box as the plan file holds a body."""
    at = [[(low, high)[i][0], (low, high)[j][1], (low, high)[k][2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return {"vertices": at, "faces": [[face] for face in faces]}


def vector(x: Sequence[Any]) -> mp.matrix:
    return mp.matrix([mp.mpf(a) for a in x])


def dot(a: mp.matrix, b: mp.matrix) -> mp.mpf:
    return mp.fsum(x * y for x, y in zip(a, b, strict=True))


def cross(a: mp.matrix, b: mp.matrix) -> mp.matrix:
    return mp.matrix([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def hat(r: mp.matrix) -> mp.matrix:
    return mp.matrix([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])


def exp(r: mp.matrix) -> mp.matrix:
    angle = mp.norm(r)
    K = hat(r)
    return mp.eye(3) + mp.sin(angle) / angle * K + (1 - mp.cos(angle)) / angle**2 * K * K if angle else mp.eye(3)


def log(R: mp.matrix) -> mp.matrix:
    s = mp.matrix([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    sine = mp.norm(s)
    return s * (mp.asin(sine) / sine) if sine else s


def joined(a: mp.matrix, b: mp.matrix) -> mp.matrix:
    return mp.matrix([*a, *b])


@dataclass
class Set:
    core: list[mp.matrix]
    thick: list[mp.matrix]
    slide: mp.matrix
    swing: mp.matrix
    shape: mp.matrix

    def support(self, N: mp.matrix, gens: Sequence[mp.matrix]) -> mp.mpf:
        zonotope = mp.fsum(abs(dot(g, N)) for g in gens) + self.drift(N)
        return min(zonotope, mp.sqrt(max((N.T * self.shape * N)[0], 0)))

    def drift(self, N: mp.matrix) -> mp.mpf:
        return mp.fsum(mp.sqrt(max((N.T * Q * N)[0], 0)) for Q in (self.slide, self.swing))

    def half(self, thick: Sequence[mp.matrix]) -> list[mp.mpf]:
        drifts = [mp.sqrt(self.slide[a, a]) + mp.sqrt(self.swing[a, a]) for a in range(6)]
        return [mp.fsum(abs(g[a]) for g in (*self.core, *thick)) + drifts[a] for a in range(6)]


def outer_sum(A: mp.matrix, B: mp.matrix) -> mp.matrix:
    weights = [1, 1, 1, mp.mpf(RHO) ** 2, mp.mpf(RHO) ** 2, mp.mpf(RHO) ** 2]
    a, b = (mp.sqrt(mp.fsum(w * Q[i, i] for i, w in enumerate(weights))) for Q in (A, B))
    if not a or not b:
        return B if not a else A
    return (1 + b / a) * A + (1 + a / b) * B


def measure(v: mp.matrix) -> mp.mpf:
    return mp.sqrt(mp.fsum(x**2 for x in v[:3]) + mp.mpf(RHO) ** 2 * mp.fsum(x**2 for x in v[3:]))


def crossing(v: mp.matrix, theta: mp.mpf, angles: Sequence[mp.mpf]) -> mp.mpf:
    """A bound of |ε × v| for |ε| ≤ θ, ε in the box."""
    x, y, z = (abs(a) for a in v)
    a, b, c = angles
    return min(mp.sqrt((y * c + z * b) ** 2 + (z * a + x * c) ** 2 + (x * b + y * a) ** 2), theta * mp.norm(v))


@dataclass
class Bend:
    """Turn τ of a piece, |ε| ≤ θ and the box of ε."""

    turn: mp.matrix
    theta: mp.mpf
    angles: Sequence[mp.mpf]

    def rest(self, n: mp.matrix, start: mp.matrix, goal: mp.matrix) -> mp.mpf:
        """What n·(R v) differs by from its linear part, for R v at both ends of the piece."""
        swept = mp.norm(cross(self.turn, start))
        swung = max(crossing(w, self.theta, self.angles) for w in (start, goal)) + self.theta * swept / 2
        swung = min(swung, self.theta * mp.norm(start))
        across = crossing(n, self.theta, self.angles)
        return across * (swung + swept) / 2 + mp.norm(cross(self.turn, n)) * swept / 8

    def at_rest(self, n: mp.matrix, goal: mp.matrix) -> mp.mpf:
        """The same where the piece has ended, R v = goal, by second derivatives."""
        G = n * goal.T + goal * n.T - 2 * dot(n, goal) * mp.eye(3)
        second = mp.fsum(abs(G[i, j]) * self.angles[i] * self.angles[j] for i in range(3) for j in range(3)) / 4
        return second + self.theta**3 * mp.norm(goal) / 6


def down(x: mp.mpf) -> float:
    return float(x - abs(x) * mp.mpf("1e-12") - mp.mpf("1e-18"))


def up(x: mp.mpf) -> float:
    return float(x + abs(x) * mp.mpf("1e-12"))


class Builder:
    """Builds the segments one after the other."""

    def __init__(self) -> None:
        axes = range(6)
        core = [mp.matrix([mp.mpf(START_BOX[a]) if a == b else 0 for b in axes]) for a in axes]
        shape = mp.diag([6 * mp.mpf(x) ** 2 for x in START_BOX])
        self.errors = Set(core, [], mp.zeros(6), mp.zeros(6), shape)
        self.sets = [self.errors]
        self.cube = box_body((-0.01, -0.01, 0.0), (0.01, 0.01, 0.02))
        self.body = [vector(v) for v in self.cube["vertices"]]
        R = exp(vector(TILT))
        self.lowest = min(range(8), key=lambda i: (R * self.body[i])[2])
        self.segments: list[dict[str, Any]] = []
        self.held: list[mp.matrix] = []

    def row(self, X: Sequence[float], v: mp.matrix, n: mp.matrix, a: Any) -> tuple[mp.mpf, mp.matrix, mp.matrix]:
        Rv = exp(vector(X[3:])) * v
        return dot(n, vector(X[:3]) + Rv) - a, joined(n, cross(Rv, n)), Rv

    def touch_row(self, X: Sequence[float]) -> tuple[mp.mpf, mp.matrix, mp.matrix]:
        return self.row(X, self.body[self.lowest], vector((0, 0, 1)), 0)

    def add(
        self, move: int, start: Sequence[float], goal: Sequence[float], held: bool, made: bool, progress: Any
    ) -> None:
        """Adds a segment on which the vertex contact is held, or made, or neither."""
        travel = vector(goal[:3]) - vector(start[:3])
        turn = log(exp(vector(goal[3:])) * exp(vector(start[3:])).T)
        V = joined(travel, turn)
        L, tau = measure(V), mp.norm(turn)
        (fS, NS, armS), (fG, NG, armG) = self.touch_row(start), self.touch_row(goal)
        up_z, hold = vector((0, 0, 1)), mp.eye(6)
        TS, TG = mp.zeros(6, 1), mp.zeros(6, 1)
        if held:
            C = self.held[0]
            TS, TG = C / dot(NS, C), C / dot(NG, C)
            hold = mp.eye(6) - TG * NG.T
        v = hold * V
        share = (mp.mpf(progress[1]) - mp.mpf(progress[0])) / (1 - mp.mpf(progress[0]))
        Pi = hold
        if made:
            Pi = hold - share * v * (NG.T * hold) / dot(NG, v)
            self.made = v / measure(v)
            TG = v / dot(NG, v)
        last = progress[1] == 1.0
        theta, box, angles = mp.mpf("0.01"), [mp.mpf("1e-3")] * 3, [mp.mpf("0.01")] * 3
        for _ in range(60):
            bend = Bend(turn, theta, angles)
            t = bend.rest(up_z, armS, armG) + max(
                abs(fS) + self.errors.support(NS, self.errors.core) if held else 0, abs(fG)
            )
            touching = held or (made and last)
            late = abs(fG) + bend.at_rest(up_z, armG) if last and made else 0
            goal_set = self._carried(V, L, tau, Pi, NG, v, share, made, theta, late)
            if touching:
                goal_set.thick = [t * TG]
                goal_set.shape = outer_sum(goal_set.shape, t**2 * TG * TG.T)
            slack = [t * TS] if held else []
            half = [max(a, b) for a, b in zip(self.errors.half(slack), goal_set.half(goal_set.thick), strict=True)]
            box, angles = ([mp.mpf(up(x)) for x in part] for part in (half[:3], half[3:]))
            theta = mp.mpf(up(mp.sqrt(mp.fsum(x**2 for x in angles))))
        self._state(move, start, goal, held, made, progress, goal_set, slack, box, Bend(turn, theta, angles))
        if made and last:
            self.held = [self.made]
        self.errors = goal_set
        self.sets.append(goal_set)

    def _carried(
        self, V: Any, L: Any, tau: Any, Pi: Any, NG: Any, v: Any, share: Any, made: bool, theta: Any, t: Any
    ) -> Set:
        lt, lr = mp.mpf(RATES[0]), mp.mpf(RATES[1]) / mp.mpf(RHO)
        o = mp.mpf(0)
        if made:
            rate = -dot(NG, v)
            eta = (lt * mp.norm(NG[:3]) + lr * mp.norm(NG[3:])) * L / rate
            zeta = mp.mpf(3) / 4 * (theta + 2 * lr * L) * tau * mp.sqrt(dot(NG[3:], NG[3:])) / rate
            late = mp.fsum(abs(dot(g, NG)) for g in self.errors.core)
            late = (late + self.errors.drift(NG)) / rate
            o = (share * (late + eta) + t / rate) / (1 - share * (eta + zeta))
        a, b = lt * L * (1 + o), lr * L * (1 + o)
        c = (theta + b) * o * tau / 2 * (1 + theta + b + o * tau)
        shape, drifts = Pi * self.errors.shape * Pi.T, []
        balls = [a**2] * 3 + [0] * 3, [0] * 3 + [(b + c) ** 2] * 3
        for radii, before in zip(balls, (self.errors.slide, self.errors.swing), strict=True):
            extra = Pi * mp.diag(radii) * Pi.T
            drifts.append(outer_sum(Pi * before * Pi.T, extra))
            shape = outer_sum(shape, extra)
        return Set([Pi * g for g in self.errors.core], [], *drifts, shape)

    def lowest_bound(
        self, start: Any, goal: Any, v: Any, n: Any, a: Any, goal_set: Set, slack: Any, bend: Bend, made: bool
    ) -> mp.mpf:
        """Certified lower bound of a vertex's height; for a contact just made, at the end alone."""
        (f, N, before), (g, M, after) = self.row(start, v, n, a), self.row(goal, v, n, a)
        at_goal = g - goal_set.support(M, [*goal_set.core, *goal_set.thick])
        if made:
            return at_goal - Bend(mp.matrix([0, 0, 0]), bend.theta, bend.angles).rest(n, after, after)
        at_start = f - self.errors.support(N, self.errors.core) - mp.fsum(abs(dot(s, N)) for s in slack)
        return min(at_start, at_goal) - bend.rest(n, before, after)

    def _state(
        self, move: int, start: Any, goal: Any, held: bool, made: bool, progress: Any, goal_set: Set, slack: Any,
        box: Any, bend: Bend,
    ) -> None:  # fmt: skip
        up_z = vector((0, 0, 1))
        last = progress[1] == 1.0
        name = f"v{self.lowest}-f5"
        kept = [k for k in range(8) if not ((held or made) and k == self.lowest)]
        bound = lambda v, n, a, at_end: self.lowest_bound(start, goal, v, n, a, goal_set, slack, bend, at_end)  # noqa: E731
        margin = min(bound(self.body[k], up_z, 0, False) for k in kept)
        clearance = min(self.row(X, self.body[k], up_z, 0)[0] for k in kept for X in (start, goal))
        named = [(margin, f"pieces 0/{j}") for j in (0, 1)]
        contacts = []
        (fS, NS, armS), (fG, NG, armG) = self.touch_row(start), self.touch_row(goal)
        rest = bend.rest(up_z, armS, armG)
        if held or (made and last):
            room = min(
                bound(self.body[self.lowest], vector(n), mp.mpf(-0.05), not held)
                for n in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))
            )
            named.append((room, name))
            contacts.append(
                {
                    "id": name, "role": "held" if held else "made", "normal": [float(x) for x in NG],
                    "offset": float(-fG), "remainder": up(rest), "margin": down(room),
                }
            )  # fmt: skip
        if made and progress[0] == 0.0:
            early = fS - self.errors.support(NS, self.errors.core) - rest
            named.append((early, f"{name} too early"))
        least, binding = min(named)
        witnesses = [
            {"kind": "fixed-face", "moving": [], "fixed": [1, 5, 7, 3]},
            {"kind": "plane", "moving": [], "fixed": [], "normal": [0.0, 0.0, 1.0], "offset": 0.0},
        ]
        if held or made:
            witnesses[1] = witnesses[0]
        self.segments.append(
            {
                "kind": "guarded_move", "move": move, "state": [name] if held else [],
                "goal_state": [name] if held or made else [], "progress": list(progress), "start": list(start),
                "goal": list(goal), "clearance": down(clearance), "margin": down(least), "binding_contact": binding,
                "basis": [{"contact": name, "direction": [float(x) for x in (self.held[0] if held else self.made)],
                           "made": made}] if held or made else [],
                "tube": {
                    "theta_max": float(bend.theta), "offset_box": [float(x) for x in box],
                    "angle_box": [float(x) for x in bend.angles],
                },
                "separations": [
                    {"moving_piece": 0, "fixed_piece": j, "witness": witnesses[j], "margin": down(margin)}
                    for j in (0, 1)
                ],
                "contacts": contacts,
                "hybrid": self._control(name, goal, held, made, V=joined(*self._ways(start, goal)),
                                        bound=mp.sqrt(mp.fsum(x**2 for x in box)) + mp.mpf(RHO) * bend.theta),
            }
        )  # fmt: skip

    @staticmethod
    def _ways(start: Any, goal: Any) -> tuple[mp.matrix, mp.matrix]:
        turn = log(exp(vector(goal[3:])) * exp(vector(start[3:])).T)
        return vector(goal[:3]) - vector(start[:3]), turn

    def _control(self, name: str, goal: Any, held: bool, made: bool, V: mp.matrix, bound: Any) -> dict[str, Any]:
        """Presses the held vertex with 5 N straight down, or pushes along the motion towards it with 12 N."""
        unit = V / measure(V)
        scale = vector([1, 1, 1, RHO, RHO, RHO])
        _, N, _ = self.touch_row(goal)
        point = vector(goal[:3]) + exp(vector(goal[3:])) * self.body[self.lowest]
        f, b = (5, 0) if held else (0, 12 if made else 0)
        bias = [-f * n + b * u * s**2 for n, u, s in zip(N, unit, scale, strict=True)]
        travel = measure(V) + bound
        return {
            "frame": [*(float(x) for x in point), 0.0, 0.0, 0.0] if held else [*goal[:3], 0.0, 0.0, 0.0],
            "speed": CONTROL["speed"],
            "position_axes": [
                [float(a == b) / float(scale[b]) for b in range(6)] for a in range(6) if not (held and a == 2)
            ],
            "force_axes": [[0.0, 0.0, 1.0, 0.0, 0.0, 0.0]] if held else [],
            "velocity": [float(x) for x in unit], "bias_wrench": [float(x) for x in bias], "push": float(b),
            "stays": "push",
            "normal_forces": [{"contact": name, "force": float(f)}] if held else [],
            "termination": {
                "contacts": [name] if made else [],
                "wrench": [float(CONTROL["termination_force"] * n) if made else 0.0 for n in N],
                "threshold": CONTROL["termination_force"], "max_travel": float(travel),
                "timeout": float(2 * travel / CONTROL["speed"]),
            },
        }  # fmt: skip


def touching_pose(builder: Builder, x: float, y: float, r: Sequence[float]) -> list[float]:
    """A pose with the lowest vertex on the table."""
    height = (exp(vector(r)) * builder.body[builder.lowest])[2]
    return [x, y, float(-height), *r]


def sealed(document: dict[str, Any]) -> dict[str, Any]:
    """The document with its digest."""
    bare = {key: value for key, value in document.items() if key != "sha256"}
    text = json.dumps(bare, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return {**bare, "sha256": hashlib.sha256(text.encode()).hexdigest()}


def table_plan() -> dict[str, Any]:
    """The plan: free motion, a guarded move down in two pieces, a slide with a little yaw."""
    return table_plan_with_sets()[0]


def table_plan_with_sets() -> tuple[dict[str, Any], list[Set]]:
    """The plan, with the error sets at its start and at the end of each segment."""
    builder = Builder()
    made = touching_pose(builder, 0.0, 0.0, TILT)
    half = [0.0, 0.0, made[2] + 0.0015, *TILT]
    above = [0.0, 0.0, made[2] + 0.003, *TILT]
    far = [0.002, 0.001, made[2] + 0.02, 0.19, -0.14, 0.0]
    slid = touching_pose(builder, 0.004, -0.003, (0.2, -0.16, 0.04))
    builder.add(0, far, above, False, False, (0.0, 1.0))
    builder.add(1, above, half, False, True, (0.0, 0.5))
    builder.add(1, half, made, False, True, (0.5, 1.0))
    builder.add(2, made, slid, True, False, (0.0, 1.0))
    table = box_body((-0.05, -0.05, -0.02), (0.05, 0.05, 0.0))
    left, right = box_body((-0.05, -0.05, -0.02), (0.01, 0.05, 0.0)), box_body((0.0, -0.05, -0.02), (0.05, 0.05, 0.0))
    plan = sealed(
        {
            "format": FORMAT,
            "fmopt_version": "1.0",
            "units": UNITS,
            "frames": FRAMES,
            "problem": {"title": "cube on a table", "sha256": "ab" * 32},
            "verdict": "CERTIFIED",
            "parts": {
                "moving": {"name": "cube", **builder.cube, "pieces": [builder.cube], **CLEARANCE},
                "fixed": {"name": "table", **table, "pieces": [left, right], **CLEARANCE},
            },
            "contacts": [
                {
                    "id": f"v{builder.lowest}-f5", "kind": "vertex-face",
                    "moving": {"vertices": [builder.lowest]}, "fixed": {"vertices": [1, 5, 7, 3]},
                }
            ],
            "segments": builder.segments,
            "uncertainty": {"start_box": list(START_BOX), "velocity_error": list(RATES), "rho": RHO},
            "goal": slid,
            "touch_tolerance": 1e-9,
            "not_covered": list(NOT_COVERED),
            "specification": CONTROL,
        }
    )  # fmt: skip
    return plan, builder.sets
