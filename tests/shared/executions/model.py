"""A simulator of the stated execution model on the true geometry of a plan file, and what it must never see.

It knows the plan file only: no row, remainder or bound of the planner. Held contacts are kept by Newton's method along
the compliant directions that the plan states, a contact is made where its exact function has its first zero, and every
further piece starts from the pose that was really reached. With a hole that is askew by H and a grasp that is off by G
the real pose is H⁻¹ · (C ⊕ κ) · G for the commanded one C; κ = (e, ε) takes it to p̄ + e, exp([ε]×) R̄, and stays what it
is where a piece starts but for drift and compliance.
"""

from collections.abc import Callable
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from fmopt.plan.error_sets import error_sets
from fmopt.verify.reading.parse import parse
from tests.shared.executions.errors import Fixed, Sources, drifts, sources_of, start_errors
from tests.shared.executions.geometry import Array, Poses, Scene, gaps, hats, rotations, vectors
from tests.shared.executions.promises import Ledger, Tube, Witness

Plan = dict[str, Any]
Watch = Callable[["Piece", Poses, bool], None]
Through = Callable[["Piece", Ledger, "Course"], tuple[Array, Array]]
OVERLAP, ROUNDING, NOTHING_BOUNDS, FARTHEST = 1e-7, 1e-9, 0.9, 2.0


class Piece:
    """One piece of motion of the plan: its nominal way, contacts, witnesses and stated sets."""

    def __init__(self, scene: Scene, number: int) -> None:
        segments = scene.plan["segments"]
        self.scene, self.number, self.said = scene, number, segments[number]
        self.first, self.last = self.said["progress"][0] == 0.0, self.said["progress"][1] == 1.0
        s0, s1 = self.said["progress"]
        self.share = (s1 - s0) / (1.0 - s0)
        start, goal = (np.array([self.said[x]]) for x in ("start", "goal"))
        self.p, self.R = start[:, :3], rotations(start[:, 3:])
        self.goal: Poses = goal[:, :3], rotations(goal[:, 3:])
        self.delta = (self.goal[0] - self.p)[0]
        self.omega = vectors(self.goal[1] @ self.R.transpose(0, 2, 1))[0]
        self.length = float(np.hypot(np.linalg.norm(self.delta), scene.rho * np.linalg.norm(self.omega)))
        end = next(s for s in segments[number:] if s["move"] == self.said["move"] and s["progress"][1] == 1.0)
        end_goal = np.array([end["goal"]])
        self.landmarks: list[Poses] = [(self.p, self.R), self.goal, (end_goal[:, :3], rotations(end_goal[:, 3:]))]
        held = [b for b in self.said["basis"] if not b["made"]]
        made = [b["contact"] for b in self.said["basis"] if b["made"]]
        self.directions = np.array([b["direction"] for b in held]).reshape(-1, 6).T
        self.held = [scene.touch(b["contact"], self.said["state"]) for b in held]
        self.made = scene.touch(made[0], self.said["state"]) if made else None
        self.measure = scene.measure(made[0], self.said["state"]) if made else None
        self._waived: dict[str, list[tuple[str, int, str, int]]] = {}

    @cached_property
    def witnesses(self) -> list[Witness]:
        """The separating planes of all pairs of pieces."""
        bodies = self.scene.moving, self.scene.fixed
        return [
            Witness.read(bodies[0][s["moving_piece"]], bodies[1][s["fixed_piece"]], s, self.landmarks)
            for s in self.said["separations"]
        ]

    def waived(self, role: str, names: list[str]) -> list[tuple[str, int, str, int]]:
        """The turns that contacts take where a stated margin cannot mean the vertex's bound, even nominally."""
        if role not in self._waived:
            margins = {c["id"]: c["margin"] for c in self.said["contacts"]}
            ends = self.landmarks[:2] if role == "held" else self.landmarks[1:2]
            touches = self.scene.touches
            self._waived[role] = [
                (vertex, side, edge, end)
                for vertex, side, edge, end in self.scene.turns(names)
                if min(touches[vertex].depths(*x)[0, side] for x in ends) < margins[vertex]
            ]
        return self._waived[role]

    def poses(self, e: Array, travel: Array) -> Poses:
        """Real poses at a travel (n,), as shares of the piece, with errors e (n, 6)."""
        way = rotations(travel[:, None] * self.omega)
        return self.p + travel[:, None] * self.delta + e[:, :3], rotations(e[:, 3:]) @ way @ self.R

    def errors_at_goal(self, poses: Poses) -> Array:
        """Errors (n, 6) of poses about the nominal pose at the end of the piece."""
        turned = poses[1] @ self.goal[1].transpose(0, 2, 1)
        return np.hstack([poses[0] - self.goal[0], vectors(turned)])

    def settled(self, base: Array, travel: Array, fixed: Fixed) -> tuple[Poses, Poses]:
        """Commanded poses with what the world adds (κ), and real ones, the held contacts at zero.

        κ is moved along the compliant directions only.
        """
        e = base.copy()
        for _ in range(20):
            commanded = self.poses(e, travel)
            p, R = fixed.seen(commanded)
            if not self.held:
                break
            f = np.stack([t.value(p, R) for t in self.held], axis=1)
            if np.abs(f).max() < 2e-15:
                break
            # How a change of ε turns the part: the left Jacobian of exp, to first order.
            turn = np.eye(3) + 0.5 * hats(e[:, 3:])
            moved = np.concatenate(
                [np.broadcast_to(self.directions[:3], (len(e), 3, f.shape[1])), turn @ self.directions[3:]], axis=1
            )
            rows = np.stack([t.row(p, R) for t in self.held], axis=1)
            e = e - np.linalg.solve(rows @ moved, f[:, :, None])[:, :, 0] @ self.directions.T
        return commanded, (p, R)

    @cached_property
    def way_row(self) -> Array:
        """Row (6,) that sees how far the contact being made is, through the compliance of the held ones."""
        row = self.measure.row(*self.goal)[0]
        if not self.held:
            return row
        rows = np.concatenate([t.row(*self.goal) for t in self.held])
        return np.asarray(row - row @ self.directions @ np.linalg.solve(rows @ self.directions, rows))

    def touched(self, poses: Poses) -> Array:
        """The function (n,) of the contact being made."""
        return self.made.value(*poses)

    def distance(self, poses: Poses) -> Array:
        """What measures how far the contact being made is (n,), m; an angle on an arm of ρ."""
        arms = {"hinge": np.diff(self.measure.moving, axis=0), "direction": self.measure.moving}
        arm = arms.get(self.measure.kind)
        scale = 1.0 if arm is None else self.scene.rho / float(np.linalg.norm(arm[0]))
        return scale * self.measure.value(*poses)


def first_zero(f: Callable[[Array], Array], count: int, farthest: float) -> Array:
    """The least x (n,) in [0, farthest] at which each f falls to zero, not a number where it does not.

    A scan in steps of 1/4 brackets it, the Illinois form of regula falsi closes in.
    """
    found = np.zeros(count, dtype=bool)
    a, b = np.zeros(count), np.full(count, np.nan)
    fa, fb = f(a), np.full(count, np.nan)
    found |= fa <= 0.0
    b[found], fb[found] = 0.0, fa[found]
    for x in np.arange(1, round(4 * farthest) + 1) / 4:
        fx = f(np.full(count, x))
        new = ~found & (fx <= 0.0)
        b[new], fb[new] = x, fx[new]
        found |= new
        a[~found], fa[~found] = x, fx[~found]
        if found.all():
            break
    kept = np.zeros(count)
    for _ in range(60):
        open_ = found & (fb < -1e-15) & (b - a > 1e-15)
        if not open_.any():
            break
        x = np.where(open_, b - fb * (b - a) / np.where(open_, fb - fa, 1.0), np.nan_to_num(b))
        fx = f(x)
        # A value that is zero but for rounding closes the bracket from above, whatever its sign.
        low, high = open_ & (fx <= 1e-15), open_ & (fx > 1e-15)
        b[low], fb[low] = x[low], fx[low]
        fa[low & (kept > 0)] *= 0.5
        a[high], fa[high] = x[high], fx[high]
        fb[high & (kept < 0)] *= 0.5
        kept = np.where(low, 1.0, np.where(high, -1.0, kept))
    return b


def execute(
    plan: Plan, count: int, seed: int, steps: int = 8, watch: Watch = lambda *_: None, sources: Sources | None = None
) -> Ledger:
    """Runs executions of a plan and checks everything that it promises on the way.

    In half of them the velocity error keeps its direction for a move, in the others only for a piece. The poses looked
    at are so many in every piece, besides its start; `watch` is shown them, and whether a move ends there. Sources are
    boxes of start errors, each with the frame in which it is fixed; the plan's where none are given.
    """
    scene = Scene(plan)
    own = sources_of(plan) if sources is None else sources
    return carried_out(plan, partial(Piece, scene), partial(_through, steps=steps, watch=watch), own, (count, seed))


def carried_out(
    plan: Plan, piece_at: Callable[[int], Piece], through: Through, sources: Sources, drawn: tuple[int, int]
) -> Ledger:
    """Takes executions, so many drawn with a seed, through a plan; checks error sets and lengths of ways."""
    (count, seed), ledger, sets, piece = drawn, Ledger(), error_sets(parse(plan)), piece_at(0)
    rng = np.random.default_rng(seed)
    e, fixed = start_errors(sources, (piece.p, piece.R), count, rng)
    fickle, rate, late = rng.random((count, 1)) < 0.5, np.zeros((count, 6)), np.zeros(count)
    Tube(piece.said["tube"], sets[:1], piece.scene.rho).check(ledger, -1, fixed.summed(e, (piece.p, piece.R)))
    for k in range(len(plan["segments"])):
        piece = piece_at(k)
        rate = np.where(fickle | piece.first, drifts(piece, count, rng), rate)
        e, end = through(piece, ledger, Course(e, rate * piece.length, fixed))
        late = (0.0 if piece.first else late) + (end - 1.0) * piece.length
        bound = piece.said["hybrid"]["termination"]["max_travel"] - piece.length
        ledger.require("neither longer nor shorter than stated", k, bound - np.abs(late) + ROUNDING)
        Tube(piece.said["tube"], sets[k + 1 : k + 2], piece.scene.rho).check(ledger, k, fixed.summed(e, piece.goal))
    return ledger


class Course(NamedTuple):
    """What executions bring to a piece: κ (n, 6) at its start, its drift (n, 6) over it, and the other sources."""

    start: Array
    drift: Array
    fixed: Fixed

    def at(self, piece: Piece, travel: Array) -> tuple[Poses, Poses]:
        """Commanded poses with κ, and real ones, at a travel (n,)."""
        return piece.settled(self.start + travel[:, None] * self.drift, travel, self.fixed)


def _through(piece: Piece, ledger: Ledger, course: Course, steps: int, watch: Watch) -> tuple[Array, Array]:
    """Takes all executions through a piece; κ (n, 6) about its goal, and ways (n,) as shares of the piece's."""

    def at(travel: Array) -> Poses:
        return course.at(piece, travel)[1]

    count = len(course.start)
    end = np.ones(count)
    if piece.made is not None:
        if piece.first:
            early = piece.distance(at(0.0 * end)) - piece.said["margin"]
            ledger.require("not made before its move", piece.number, early + ROUNDING)
        end = first_zero(left(piece, at), count, FARTHEST)
        ledger.require("gets there", piece.number, FARTHEST - end)
        end = np.nan_to_num(end, nan=FARTHEST)
    for share in np.linspace(0.0, 1.0, steps + 1):
        commanded, poses = course.at(piece, share * end)
        _look(piece, ledger, poses)
        watch(piece, poses, False)
    if piece.last:
        _arrive(piece, ledger, poses)
        watch(piece, poses, True)
    return piece.errors_at_goal(commanded), end


def left(piece: Piece, at: Callable[[Array], Poses]) -> Callable[[Array], Array]:
    """What is zero where the piece ends.

    A move ends as it touches. Before, progress is each execution's own: it goes on to its next piece as soon as its
    error along the way, seen through the compliance, is what it would be had the piece been as long as planned, shrunk
    in proportion to the way that is still to go.
    """
    if piece.last:
        return lambda travel: piece.touched(at(travel))
    kept, twist = 1.0 - piece.share, np.concatenate([piece.delta, piece.omega])

    def behind(travel: Array) -> Array:
        error = piece.errors_at_goal(at(travel))
        planned = error - (travel[:, None] - 1.0) * twist
        return np.asarray((error - kept * planned) @ piece.way_row)

    return behind


def _look(piece: Piece, ledger: Ledger, poses: Poses) -> None:
    """What must hold all along a piece."""
    scene, said, k = piece.scene, piece.said, piece.number
    for pair, witness in zip(said["separations"], piece.witnesses, strict=True):
        bodies = scene.moving[pair["moving_piece"]], scene.fixed[pair["fixed_piece"]]
        ledger.require("overlap", k, gaps(*bodies, *poses) + OVERLAP)
        ledger.require("separation", k, witness.least(poses) + ROUNDING)
    for name in said.get("leaving", ()):
        ledger.require(f"{name} not touched again", k, piece.scene.touch(name, [name]).value(*poses) + ROUNDING)
    ledger.require("contacts kept", k, ROUNDING - _apart(piece, said["state"], poses))
    _inside(piece, ledger, "held", said["state"], poses)
    if piece.made is not None:
        ledger.require("not made earlier", k, piece.touched(poses) + ROUNDING)


def _arrive(piece: Piece, ledger: Ledger, poses: Poses) -> None:
    """What must hold where a move ends."""
    goal = piece.said["goal_state"]
    ledger.require("contacts made", piece.number, ROUNDING - _apart(piece, goal, poses))
    _inside(piece, ledger, "made", goal, poses)


def _apart(piece: Piece, names: list[str], poses: Poses) -> Array:
    touches = [piece.scene.touch(name, names) for name in names]
    return np.max([np.abs(t.value(*poses)) for t in touches] or [np.zeros(len(poses[0]))], axis=0)


def _inside(piece: Piece, ledger: Ledger, role: str, names: list[str], poses: Poses) -> None:
    """Contacts inside their features; an end of an edge and the rim that it passes may take turns."""
    depths = {x: piece.scene.touches[x].depths(*poses) for x in names}
    waived = piece.waived(role, names)
    for vertex, side, edge, _ in waived:
        either = np.maximum(depths[vertex][:, side], depths[edge][:, :2].min(axis=1))
        ledger.require(f"{vertex} or {edge}", piece.number, either + ROUNDING)
    for vertex, side, edge, end in waived:
        depths[vertex][:, side] = depths[edge][:, end] = np.inf
    for entry in piece.said["contacts"]:
        if entry["role"] == role and entry["margin"] < NOTHING_BOUNDS:
            depth = depths[entry["id"]].min(axis=1) - entry["margin"]
            ledger.require(f"{entry['id']} inside", piece.number, depth + ROUNDING)
