"""What a plan tells besides its segments, as values: nominal trajectory, contact states on the way, recovery."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fmopt.verify.form import Numbers


@dataclass(frozen=True)
class Interval:
    """S(t) from `start` to `end` (s): −1, 0, 1 or 2 for each degree of freedom x, y, z, rx, ry, rz."""

    start: float
    end: float
    s: tuple[int, ...]


@dataclass(frozen=True)
class Nominal:
    """The nominal trajectory: poses (6,) at times (s), straight between, and S(t) along it."""

    nodes: tuple[Numbers, ...]
    times: Numbers
    intervals: tuple[Interval, ...]


@dataclass(frozen=True)
class PositionForce:
    """Pₐ(t), Pₙ(t) and Fₐ(t) on an interval on which P is straight and S constant.

    Attributes:
        interval: from when to when, and S.
        pa_start, pa_end: artificial position constraints (6,) at both ends, m and rad.
        pn_start, pn_end: natural ones likewise.
        fa: reaction (6,) on the moving part, N and N·m.
        applied: wrench (6,) applied to the moving part, −fa.
        either_sign: degrees whose reaction may have either sign.
    """

    interval: Interval
    pa_start: Numbers
    pa_end: Numbers
    pn_start: Numbers
    pn_end: Numbers
    fa: Numbers
    applied: Numbers
    either_sign: tuple[int, ...]


@dataclass(frozen=True)
class CriticalPoint:
    """A pose near which contact states were looked for.

    Attributes:
        name: what it is called.
        pose: (6,).
        contacts: ids of the primitive contacts possible near it.
        enumerated: whether all states near it were enumerated.
        states_by_dimension: how many states there are of each dimension.
        states_confirmed: how many of them were confirmed.
        states_by_verdict: how many came to which verdict.
    """

    name: str
    pose: Numbers
    contacts: tuple[str, ...]
    enumerated: bool
    states_by_dimension: Mapping[int, int]
    states_confirmed: int
    states_by_verdict: Mapping[str, int]


@dataclass(frozen=True)
class Search:
    """How the sequence of moves was found.

    Attributes:
        objective: what its cost is made of.
        cost, lower_bound, gap: of the sequence, of any, and their difference.
        states_expanded: states looked at.
        moves: the freedom of each move, "approach" or an axis with its sign.
        heading: turn about z of the axes that moves go along and about, rad.
    """

    objective: str
    cost: float
    lower_bound: float
    gap: float
    states_expanded: int
    moves: tuple[str, ...]
    heading: float


@dataclass(frozen=True)
class Lift:
    """How the part backs off, along z of the B-frame.

    Attributes:
        above: m in B; nothing new is touched while the part's lowest point lies above this.
        clear: m in B; height of the lowest point from which the part is turned and carried to a start.
        turn: rad; the furthest that it is turned then.
    """

    above: float
    clear: float
    turn: float


@dataclass(frozen=True)
class Foreseen:
    """A contact that larger errors would make first.

    Attributes:
        kind, moving, fixed: the contact, by vertex indices of the parts.
        factor: of the start errors, with which it is made.
        axis: the degree that makes it alone, empty where none does.
        axis_factor: of the start error of that degree alone; None where none does.
        wrench: of a unit reaction, (6,).
        angle: to the wrench of the contact wanted, rad; None where none is.
        told: whether it can be told from the contact wanted.
    """

    kind: str
    moving: tuple[int, ...]
    fixed: tuple[int, ...]
    factor: float
    axis: str
    axis_factor: float | None
    wrench: Numbers
    angle: float | None
    told: bool


@dataclass(frozen=True)
class MoveRecovery:
    """What to do when a move fails.

    Attributes:
        move: its number.
        back_off: whether the part may be lifted from anywhere in it.
        room: by how much its lowest point stays above what it could be lifted into, m; None without a lift.
        first: contacts that it does not plan and larger errors would make.
        early, late: retries in order, after something was felt that was not wanted, and after nothing was.
    """

    move: int
    back_off: bool
    room: float | None
    first: tuple[Foreseen, ...]
    early: tuple[int, ...]
    late: tuple[int, ...]


@dataclass(frozen=True)
class Recovery:
    """Backing off and trying again.

    Attributes:
        lift: how; None where the part cannot be lifted.
        why: why not, or why there are no retries; empty where there are.
        retries: shifts (6,) of the start, m and rad.
        covers: half-widths (6,) of the start errors that the plan covers with its retries.
        moves: of each move.
        not_covered: what this does not cover.
    """

    lift: Lift | None
    why: str
    retries: tuple[Numbers, ...]
    covers: Numbers
    moves: tuple[MoveRecovery, ...]
    not_covered: tuple[str, ...]
