"""The part of a plan that the check judges, as values: read once, by `parse`."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from fmopt.verify.reading.reader import Numbers


@dataclass(frozen=True)
class Body:
    """A polyhedron as the plan states it: vertices and faces, each a tuple of vertex loops.

    `exact` has the vertices whose coordinates are no floats, each as integers (x, y, z, w) for (x, y, z)/w. `balls` are
    (vertex, radius in m): the vertex, of no face, is the centre of a ball of the body.
    """

    vertices: tuple[Numbers, ...]
    faces: tuple[tuple[tuple[int, ...], ...], ...]
    exact: Mapping[int, tuple[int, int, int, int]] = field(default_factory=dict)
    balls: tuple[tuple[int, float], ...] = ()


@dataclass(frozen=True)
class Found:
    """How a part mates, where its files do not say it: which side of the problem it is and by which feature.

    `frame` is that of the feature in the model's frame (position, rotation vector), None where the model states it.
    """

    side: str
    feature: str
    frame: Numbers | None


@dataclass(frozen=True)
class StatedPart:
    """A part: its surface, its convex pieces, its name, and the clearance a side declared (in x, y) and measured, m.

    No clearance is declared where the problem declares none; `found` says how the part mates where that was found.
    `balls` come after the pieces, each a body with its centre for a vertex. `form` is its tolerance of form, m: how far
    the surface of the real part may lie from its own.
    """

    body: Body
    pieces: tuple[Body, ...]
    name: str
    declared_clearance: tuple[float, float] | None
    measured_clearance: float
    found: Found | None = None
    balls: tuple[Body, ...] = ()
    form: float = 0.0


@dataclass(frozen=True)
class StatedContact:
    """A primitive contact by vertex indices of the parts."""

    id: str
    kind: str
    moving: tuple[int, ...]
    fixed: tuple[int, ...]


@dataclass(frozen=True)
class StatedWitness:
    """A plane between two pieces: vertex indices of the pieces, or normal and offset for kind "plane"."""

    kind: str
    moving: tuple[int, ...]
    fixed: tuple[int, ...]
    normal: Numbers
    offset: float


@dataclass(frozen=True)
class StatedSeparation:
    """What is claimed of a pair of pieces."""

    moving: int
    fixed: int
    witness: StatedWitness
    margin: float


@dataclass(frozen=True)
class StatedContactClaim:
    """What is claimed of a contact of a segment."""

    id: str
    role: str
    normal: Numbers
    offset: float
    remainder: float
    margin: float


@dataclass(frozen=True)
class Tube:
    """Bounds of the errors of a segment: angle |ε|, half-widths (3,) of e and of ε, m and rad."""

    theta: float
    box: Numbers
    angles: Numbers


@dataclass(frozen=True)
class JamFree:
    """What is claimed of the directions of a segment's applied wrench."""

    push: float  # along the motion, for which angles are stated
    least_push: float | None  # above which the push is not balanced; None where none is stated
    angle: float  # by which the wrench may turn in any direction
    planes: tuple[tuple[str, tuple[float, float]], ...]  # how far it may turn from, and to, what the name says
    twists: tuple[Numbers, ...]  # what proves it


@dataclass(frozen=True)
class Hybrid:
    """What is claimed of a segment's control."""

    frame: Numbers  # compliance frame, a pose in the B-frame
    # position_axes, force_axes: twists servoed in position and wrenches servoed in force, in its coordinates
    position_axes: tuple[Numbers, ...]
    force_axes: tuple[Numbers, ...]
    velocity: Numbers  # unit twist of the reference point in axes of the B-frame
    speed: float
    bias: Numbers  # wrench applied to the moving part
    push: float  # size of its part along the motion
    pressed: tuple[tuple[str, float], ...]  # held contacts with the normal forces that balance the rest of it
    felt: tuple[str, ...]
    # wrench, threshold, max_travel, timeout: when the move ends
    wrench: Numbers
    threshold: float
    max_travel: float
    timeout: float
    stays: str  # what the held contacts stay closed under: "push", "stop" or "none"
    jam_free: JamFree | None = None  # directions in which the bias cannot be balanced; None where nothing is claimed
    # Normal speed of the contact met for a unit twist, and its force; None where none is limited
    impact: tuple[float, float] | None = None


@dataclass(frozen=True)
class StatedSpecification:
    """What forces and speeds were asked for: m/s, N, N·m, friction, N, and (N, kg, N/m) where impacts are limited."""

    speed: float
    contact_force: float
    torque_limit: float
    friction: float
    termination_force: float
    impact: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Segment:
    """A piece of motion with its claims."""

    move: int
    state: tuple[str, ...]
    goal_state: tuple[str, ...]
    progress: tuple[float, float]
    start: Numbers
    goal: Numbers
    clearance: float
    margin: float
    binding: str
    basis: tuple[tuple[str, Numbers, bool], ...]
    tube: Tube
    separations: tuple[StatedSeparation, ...]
    contacts: tuple[StatedContactClaim, ...]
    hybrid: Hybrid
    leaving: tuple[str, ...]


@dataclass(frozen=True)
class StatedEvidence:
    """What a plan of presses states of its trials."""

    # draws, seated, first_tries: uniform draws, how many seat, and how many at the first attempt
    draws: int
    seated: int
    first_tries: int
    # confidence, bound, min_rate: of the rate with which draws seat, and the rate asked for
    confidence: float
    bound: float
    min_rate: float
    # vertices, vertices_seated: of the start box
    vertices: int
    vertices_seated: int
    subject: str
    tested: bool  # whether it says that the rate asked for is reached
    start: Numbers  # half-widths (6,) of the start errors that are drawn from, m and rad
    # outcomes, vertex_outcomes: for each the attempt at which it seats, from 0; −1 where it does not, or touches
    outcomes: tuple[int, ...]
    vertex_outcomes: tuple[int, ...]
    seconds: tuple[float, ...]  # that each of the draws took
    max_time: float | None  # s, within which 95 % of the draws that seat are through; None where that was not asked for


@dataclass(frozen=True)
class StatedPlan:
    """A plan without its description."""

    verdict: str
    # title, problem: of the problem that it is for, and that problem's SHA-256
    title: str
    problem: str
    version: str
    # sha256, digest_holds: its seal, and whether it is that of the document
    sha256: str
    digest_holds: bool
    moving: StatedPart
    fixed: StatedPart
    contacts: tuple[StatedContact, ...]
    segments: tuple[Segment, ...]
    start_box: Numbers  # half-widths (6,) of the start errors, m and rad
    velocity_error: Numbers  # shares of translation and of rotation
    rho: float  # characteristic length, m
    # Boxes of the start errors by the frame that they are fixed in; none where all are in the world
    sources: tuple[tuple[str, Numbers], ...]
    specification: StatedSpecification
    goal: Numbers
    touch: float  # how far apart parts are taken to touch, m
    not_covered: tuple[str, ...]
    recovery: "StatedRecovery | None" = None
    presses: int = 0  # number of segments that are presses: all or none
    evidence: StatedEvidence | None = None
    subject: str = ""  # SHA-256 of what evidence is of: parts, presses and goal

    @property
    def parts(self) -> dict[str, StatedPart]:
        """The parts by side, "moving" and "fixed"."""
        return {"moving": self.moving, "fixed": self.fixed}


@dataclass(frozen=True)
class Lift:
    """How the part backs off, along z of the B-frame."""

    above: float  # m in B; nothing new is touched while the part's lowest point lies above this
    clear: float  # m in B; height of the lowest point from which the part is turned and carried to a start
    turn: float  # rad; the furthest that it is turned then


@dataclass(frozen=True)
class MoveRecovery:
    """What to do when a move fails."""

    move: int
    back_off: bool  # whether the part may be lifted from anywhere in it
    room: float | None  # by how much its lowest point stays above what it could be lifted into, m; None without a lift
    # early, late: retries in order, after something was felt that was not wanted, and after nothing was
    early: tuple[int, ...]
    late: tuple[int, ...]


@dataclass(frozen=True)
class StatedRecovery:
    """Backing off and trying again."""

    lift: Lift | None  # how; None where the part cannot be lifted
    why: str  # why not, or why there are no retries; empty where there are
    retries: tuple[Numbers, ...]  # shifts (6,) of the start, m and rad
    covers: Numbers  # half-widths (6,) of the start errors that the plan covers with its retries
    moves: tuple[MoveRecovery, ...]
    not_covered: tuple[str, ...]
