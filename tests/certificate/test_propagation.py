"""The error step against executions on the true surfaces: all end in the goal set, and thinner sets are caught."""

from dataclasses import dataclass

import numpy as np
import pytest

from fmopt.certificate.assembly import contact_rows
from fmopt.certificate.claim import Claim, stepped
from fmopt.certificate.error_set import ErrorSet
from fmopt.certificate.propagation import advance
from fmopt.certificate.segment_linearisation import Piece
from fmopt.errors import InfeasibleError
from fmopt.spatial import ellipsoid
from fmopt.spatial.se3 import Pose, exp, length, log
from fmopt.spatial.values import Array
from tests.shared.parts.peg_pieces import START_BOX, TOLERANCE, Way, claims, moves, peg, pieces_of, settled

EXECUTIONS = 12
ROUNDING = 1e-10  # of a metre: how exactly an execution keeps its contacts, times the levers


@dataclass(frozen=True)
class Execution:
    """A sampled execution: its error (6,) at the end of each move about the nominal goal, and poses on the way."""

    errors: tuple[Array, ...]
    poses: tuple[tuple[int, Pose], ...]


def last_claims() -> list[Claim]:
    """The last piece of each move."""
    return [c for c in claims() if c.piece.last]


def run(rng: np.random.Generator, extreme: bool) -> Execution:
    """One execution of all moves: start error in the box, drift on its bounds, contacts kept, stopped as it touches."""
    box = np.array(START_BOX)
    error = box * (rng.choice([-1.0, 1.0], 6) if extreme else rng.uniform(-1.0, 1.0, 6))
    ends, poses = [], []
    for number, way in enumerate(moves()):
        error = move_through(number, way, error, rng, poses)
        ends.append(error)
    return Execution(tuple(ends), tuple(poses))


def move_through(number: int, way: Way, error: Array, rng: np.random.Generator, poses: list[tuple[int, Pose]]) -> Array:
    """The error about the move's goal, for an error about its start."""
    basis = last_claims()[number - 1].advance.basis if number else ()
    shift, turn = (part / length(part) for part in rng.normal(size=(2, 3)))
    cone = np.append(shift * TOLERANCE.velocity_error[0], turn * TOLERANCE.velocity_error[1] / TOLERANCE.rho)
    drifted = np.zeros(6)
    pieces = pieces_of(way, basis)
    made = way.made
    for start, goal, (_, done) in pieces:
        V = start.local(goal)
        far = length(V * ellipsoid.metric(TOLERANCE.rho))
        last = done >= 1.0

        def real(s: float, start: Pose = start, V: Array = V, far: float = far, drifted: Array = drifted) -> Pose:
            """The pose after a share of the piece (beyond 1: onwards), with held contacts kept."""
            nominal = Pose(start.p + s * V[:3], exp(s * V[3:]) @ start.R)
            free = nominal.moved(error + drifted + s * far * cone)
            if not basis:
                return free
            directions = np.array([b.direction for b in basis])
            return settled(free, [b.contact for b in basis], directions, way.held, about=nominal)

        poses += [(number, real(s)) for s in (0.0, 0.5)]
        stop = 1.0
        if made is not None:
            found = touch(made, way, real, 4.0 if last else 1.0)
            assert found is not None or not last
            if found is not None:
                stop, last = found, True
        if last:
            end = real(stop)
            poses.append((number, end))
            return np.concatenate([end.p - way.goal.p, log(end.R @ way.goal.R.T)])
        drifted = drifted + far * cone
    raise AssertionError("a move ends with its last piece")


def touch(made: object, way: Way, real: object, upto: float) -> float | None:
    """Where along a piece the contact being made is first met, None when it is not."""

    def f(s: float) -> float:
        return float(contact_rows(peg().assembly, [made], way.held, real(s)).f[0])  # type: ignore[list-item, operator]

    if f(upto) > 0.0:
        return None
    low, high, values = 0.0, upto, (f(0.0), f(upto))
    if values[0] <= 0.0:
        return 0.0
    for _ in range(60):
        # Regula falsi with bisection every third time.
        share = values[0] / (values[0] - values[1])
        middle = low + (high - low) * (share if _ % 3 else 0.5)
        value = f(middle)
        if abs(value) < 1e-15 or high - low < 1e-14:
            return middle
        low, high, values = (middle, high, (value, values[1])) if value > 0.0 else (low, middle, (values[0], value))
    return high


@pytest.fixture(scope="module")
def executions() -> list[Execution]:
    rng = np.random.default_rng(7)
    return [run(rng, k % 2 == 0) for k in range(EXECUTIONS)]


def directions(move: int) -> Array:
    """Rows (k, 6) to try: axes, contact rows (along which the set is thin), and random ones."""
    at = last_claims()[move]
    rows = contact_rows(peg().assembly, at.piece.goal_contacts, at.piece.goal_contacts, at.piece.goal).N
    rng = np.random.default_rng(move)
    random = rng.normal(size=(100, 6)) * np.array([1.0] * 3 + [TOLERANCE.rho] * 3)
    return np.vstack([np.eye(6), rows, random])


@pytest.mark.parametrize("move", range(len(moves())))
def test_executions_end_in_the_goal_set(move: int, executions: list[Execution]) -> None:
    N, goal = directions(move), last_claims()[move].advance.ends.goal_set
    reach = goal.support(N)
    for execution in executions:
        assert (np.abs(N @ execution.errors[move]) <= reach + ROUNDING).all()


@pytest.mark.parametrize("move", range(len(moves())))
def test_executions_stay_within_the_stated_bounds(move: int, executions: list[Execution]) -> None:
    extent = last_claims()[move].advance.ends.extent
    for execution in executions:
        error = execution.errors[move]
        assert length(error[3:]) <= extent.theta + ROUNDING
        assert (np.abs(error[:3]) <= extent.offset + ROUNDING).all()


def test_executions_never_enter_the_block(executions: list[Execution]) -> None:
    assembly = peg().assembly
    for execution in executions:
        for _, pose in execution.poses:
            world = pose.apply(assembly.moving.polyhedron.vertices)
            for piece in assembly.fixed.pieces:
                assert (world @ piece.normals.T - piece.offsets).max(axis=1).min() >= -1e-9


def test_a_set_without_thickness_is_caught(executions: list[Execution]) -> None:
    move = 2
    goal = last_claims()[move].advance.ends.goal_set
    assert goal.thick == 2
    core = goal.generators[: -goal.thick]
    thin = ErrorSet(goal.shape_root, core, goal.slide_root, goal.swing_root)
    at = last_claims()[move].piece
    N = contact_rows(peg().assembly, at.goal_contacts, at.goal_contacts, at.goal).N
    worst = max(np.max(np.abs(N @ e.errors[move]) - thin.support(N)) for e in executions)
    assert worst > 1e-7


def test_a_set_without_drift_is_caught() -> None:
    rng = np.random.default_rng(3)
    goal = last_claims()[0].advance.ends.goal_set
    slim = ErrorSet(goal.shape_root, goal.generators, np.zeros((6, 0)))
    way, poses = moves()[0], []
    N = np.eye(6)[:3]
    errors = [move_through(0, way, np.array(START_BOX) * rng.choice([-1.0, 1.0], 6), rng, poses) for _ in range(10)]
    assert max(np.max(np.abs(N @ e) - slim.support(N)) for e in errors) > 1e-7


def test_stated_bounds_are_a_fixed_point() -> None:
    for found in claims():
        ends = found.advance.ends
        start, goal = ends.start_set, ends.goal_set
        core = start.generators if ends.core is None else ends.core
        before = start.half_widths(core) + np.abs(ends.slack).sum(axis=1)
        half = np.maximum(before, goal.half_widths(goal.generators))
        assert (half[:3] <= ends.extent.offset).all()
        np.testing.assert_allclose(ends.extent.offset, half[:3], rtol=1e-10, atol=1e-18)
        assert length(half[3:]) <= ends.extent.theta <= length(half[3:]) * (1.0 + 1e-10)


def test_thickness_is_dropped_only_while_its_directions_give_way() -> None:
    found = [c for c in claims() if len(c.piece.basis) == 2][1]
    errors = found.advance.ends.start_set
    assert errors.thick == 2
    own = np.array([b.direction for b in found.piece.basis])
    core = len(errors.generators) - 2
    assert len(errors.core(own)) == core
    assert len(errors.core(own[:1])) == core + 2
    assert len(errors.core(own + 1e-12)) == core + 2
    assert len(found.advance.ends.goal_set.generators) == core + 2


def test_the_projected_core_keeps_the_contacts() -> None:
    for found in claims():
        piece = found.piece
        goal = found.advance.ends.goal_set
        contacts = [b.contact for b in (found.advance.basis if piece.last else piece.basis)]
        together = piece.goal_contacts if piece.last else piece.held
        N = contact_rows(peg().assembly, contacts, together, piece.goal).N
        core = goal.generators[: len(goal.generators) - len(contacts)]
        assert np.abs(core @ N.T).max(initial=0.0) < 1e-15
        for drift in (goal.slide_root, goal.swing_root):
            assert np.abs(N @ drift).max(initial=0.0) < 1e-15


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"velocity_error": (0.9, 0.9)}, "velocity error|too large|move away"),
        ({"box": 40.0}, "too thick|too large|move away"),
    ],
)
def test_errors_that_are_too_large_are_refused(change: dict[str, object], message: str) -> None:
    piece = claims()[2].piece
    errors = ErrorSet.from_box(np.array(START_BOX) * float(change.get("box", 1.0)))  # type: ignore[arg-type]
    tolerance = type(TOLERANCE)(change.get("velocity_error", TOLERANCE.velocity_error), TOLERANCE.rho)  # type: ignore[arg-type]
    with pytest.raises(InfeasibleError, match=message):
        stepped(peg().assembly, piece, errors, tolerance)


def test_a_motion_away_from_the_contact_is_refused() -> None:
    piece = claims()[1].piece
    back = Piece(piece.goal, piece.start, piece.held, piece.goal_contacts, piece.basis, piece.made, piece.progress)
    with pytest.raises(InfeasibleError, match="does not lead to contact"):
        advance(peg().assembly, back, ErrorSet.from_box(START_BOX), TOLERANCE)
