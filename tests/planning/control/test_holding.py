"""How surely contacts are held, and how that changes as poses are displaced: derivatives against differences."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from fmopt.certificate.assembly import Assembly
from fmopt.contact.c_surface import contact_point, contact_wrench
from fmopt.contact.primitive import PrimitiveContact, near_contacts
from fmopt.errors import InfeasibleError
from fmopt.planning.control.bias_wrench import GuardedMove, firmness, held_by, steadiness, turns
from fmopt.planning.control.holding import MoveDerivatives, _arms, _wrenches, hold_derivatives
from fmopt.planning.moves.moves import Move, onto_surfaces
from fmopt.planning.placement.sequence_program import state_rows
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array
from fmopt.task.problem import Specification, load
from tests import PROBLEMS

RHO = 0.014
SPECIFICATION = Specification(0.02, 20.0, 2.0, 0.2, 2.0)


def random_move(rng: np.random.Generator, turning: bool) -> GuardedMove | None:
    """A move along a few contacts that slides, or turns, to another contact; None where no bias holds them."""
    pose, m = Pose(0.01 * rng.normal(size=3), np.eye(3)), int(rng.integers(1, 5))
    arms, normals = 0.02 * rng.normal(size=(m + 1, 3)), rng.normal((0.0, 0.0, 2.0), size=(m + 1, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    wrenches = np.hstack([normals, np.cross(arms, normals)])
    twist = rng.normal(size=6) * [1.0, 1.0, 1.0, *[(1.0 / RHO if turning else 1e-3)] * 3]
    twist -= np.linalg.pinv(wrenches[:m]) @ (wrenches[:m] @ twist)
    twist *= -0.001 * np.sign(wrenches[m] @ twist) / max(np.linalg.norm(twist[:3]), 1e-9)
    move = GuardedMove(pose, twist, wrenches[:m], pose.p + arms[:m], wrenches[m:], 1e-4)
    found = held_by(move, RHO, SPECIFICATION)
    return move if turns(twist, RHO) == turning and found is not None and found.least > 0.05 else None


def changed(move: GuardedMove, changing: MoveDerivatives, step: float) -> GuardedMove:
    return replace(
        move,
        displacement=move.displacement + step * changing.displacement[0],
        held=move.held + step * changing.held[0],
        points=move.points + step * changing.arms[0],
        made=move.made + step * changing.made[0],
    )


@pytest.mark.parametrize("turning", [False, True])
def test_holds_change_with_the_move_as_differences_say(turning: bool) -> None:
    rng, seen, right = np.random.default_rng(7), 0, 0
    least = steadiness if turning else firmness
    while seen < 30:
        move = random_move(rng, turning)
        if move is None:
            continue
        m, scale = len(move.held), np.array([1.0, 1.0, 1.0, *[RHO] * 3])
        changing = MoveDerivatives(
            move.displacement * rng.normal(size=(1, 6)),
            rng.normal(size=(1, m, 6)) * scale,
            0.02 * rng.normal(size=(1, m, 3)),
            rng.normal(size=(1, 1, 6)) * scale,
        )
        found = held_by(move, RHO, SPECIFICATION)
        assert found.least / SPECIFICATION.contact_force == pytest.approx(least(move, RHO, SPECIFICATION))
        told = float(hold_derivatives(move, found, changing, RHO, SPECIFICATION)[0])
        ends = [least(changed(move, changing, step), RHO, SPECIFICATION) for step in (1e-6, 0.0, -1e-6)]
        slopes = [(ends[0] - ends[1]) / 1e-6, (ends[1] - ends[2]) / 1e-6]
        seen += 1
        # Where other rows bind on one side than on the other, one of them is told.
        right += min(abs(told - slope) for slope in slopes) <= 1e-3 * max(abs(told), 0.1)
    assert right >= 29


def state(assembly: Assembly, contact: PrimitiveContact, pose: Pose) -> tuple[Pose, Array]:
    """The nearest pose that makes a contact, and a basis of the displacements inside it."""
    move = Move(pose, pose, (contact,), ())
    at = onto_surfaces(assembly, pose, move)
    N = state_rows(assembly, move.held, at)
    return at, np.linalg.svd(N * assembly.units)[2][len(N) :] * assembly.units


def pushed(assembly: Assembly, contact: PrimitiveContact, pose: Pose) -> Array:
    """The wrench of a contact, and the arm at which it pushes: (9,)."""
    parts = assembly.moving.polyhedron, assembly.fixed.polyhedron
    point = contact_point(contact, *parts, pose) - pose.p
    return np.concatenate([contact_wrench(contact, *parts, pose), point])


@pytest.mark.parametrize(
    ("name", "exchanged", "kinds"),
    [
        ("square_peg", False, {"vertex-face", "edge-edge"}),
        ("square_peg", True, {"face-vertex", "edge-edge"}),
        ("ball_pin", False, {"ball-face"}),
    ],
)
def test_wrenches_and_arms_turn_with_the_part_as_differences_say(name: str, exchanged: bool, kinds: set[str]) -> None:
    problem = load(PROBLEMS / f"{name}.toml")
    moving, fixed = (problem.fixed, problem.moving) if exchanged else (problem.moving, problem.fixed)
    assembly = Assembly(moving, fixed, planar=False)
    rng, seen = np.random.default_rng(3), Counter[str]()
    for _ in range(4):
        pose = Pose.from_vector([*1e-3 * rng.normal(size=3), *0.15 * rng.normal(size=3)])
        for contact in near_contacts(moving.polyhedron, fixed.polyhedron, pose, 5e-3, 0.3)[::7]:
            try:
                at, free = state(assembly, contact, pose)
                told = pushed(assembly, contact, at)
            except InfeasibleError:
                continue
            w, dw = _wrenches(assembly, [contact], at)
            assert w[0] == pytest.approx(told[:6], abs=1e-9)
            said = np.hstack([dw[:, 0], _arms(assembly, [contact], at, w, dw)[:, 0]])
            for direction in free:
                ends = [state(assembly, contact, at.moved(sign * 1e-6 * direction))[0] for sign in (1.0, -1.0)]
                change = np.subtract(*(pushed(assembly, contact, end) for end in ends)) / 2e-6
                assert direction @ said == pytest.approx(change, abs=1e-5 * max(1.0, float(np.abs(change).max())))
            seen[contact.kind] += 1
    assert set(seen) >= kinds, seen
