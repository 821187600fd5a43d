"""The rig: trusted physics, the scene's pieces, batched rotations, and a plan carried out."""

import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fmopt.errors import SettingsError
from fmopt.execution.engines import mujoco_engine
from fmopt.execution.engines.engine import Bodies
from fmopt.execution.engines.mujoco_engine import MujocoEngine
from fmopt.execution.engines.physics import Physics
from fmopt.execution.engines.scene import compiled, engine, scene
from fmopt.execution.program import DONE, Program, Step, planned
from fmopt.execution.rig import Rig
from fmopt.execution.robot import Robot
from fmopt.execution.rotation import between, from_quaternions, product, quaternions
from fmopt.plan import Plan, parsed
from fmopt.spatial.se3 import Pose, exp, log
from fmopt.spatial.values import Array
from fmopt.task.problem import load
from fmopt.verify.reading.document import Body
from tests import PROBLEMS

# Positions and quaternions at which the tight 12 mm fit lies flat on one wall, 0.05 µm in it.
FLAT = np.array(
    [
        (-8.757421877290398e-05, -6.874586078955733e-05, -0.0007380913099237288),
        (-8.858741736431823e-05, -6.668607168408996e-05, -0.0006652056996825401),
    ]
)
TURNED = np.array(
    [
        (0.999999332707672, -0.0006894053366842274, -0.0009269866234212647, -5.40906617044579e-07),
        (0.9999987784595468, 0.0015525828004200617, -0.00018046052779051622, -2.4246046342709434e-07),
    ]
)


def test_the_engines_defaults_are_refused_with_every_reason(square_peg_plan: dict[str, Any]) -> None:
    of_mujoco = {"solref": (0.02, 1.0), "solimp": (0.9, 0.95, 0.001, 0.5, 2.0), "impratio": 1.0, "cone": "pyramidal"}
    with pytest.raises(SettingsError) as caught:
        scene(Bodies.of(parsed(square_peg_plan)), Physics(**of_mujoco), 1.0, 1e-3, 0.3)  # type: ignore[arg-type]
    for words in ("give way over 0.02 s", "impedance from 0.9", "impratio 1", "pyramidal friction cones"):
        assert words in caught.value.message
    assert caught.value.exit_code == 2


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"margin": 1e-4}, "eats the clearance"),
        ({"time_step": 0.002}, "time step 0.002"),
        ({"solref": (0.001, 0.5)}, "bounce"),
    ],
)
def test_each_setting_that_lies_is_refused(change: dict[str, Any], words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        replace(Physics(), **change).trusted()


def test_the_scene_has_the_plans_pieces_where_they_are(square_peg_plan: dict[str, Any]) -> None:
    mujoco = engine()

    model = compiled(scene(Bodies.of(parsed(square_peg_plan)), Physics(), 1.0, 1e-3, 0.3))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for side in ("fixed", "moving"):
        for i, piece in enumerate(square_peg_plan["parts"][side]["pieces"]):
            geom = model.geom(f"{side}{i}").id
            first, count = model.mesh_vertadr[model.geom_dataid[geom]], model.mesh_vertnum[model.geom_dataid[geom]]
            local = model.mesh_vert[first : first + count].astype(float)
            world = local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
            wanted = np.array(piece["vertices"])
            gaps = np.linalg.norm(world[:, None] - wanted[None], axis=2)
            assert count == len(wanted)
            assert gaps.min(axis=0).max() < 5e-9  # the engine keeps vertices in single precision


def test_rotations_of_many_agree_with_those_of_one() -> None:
    random = np.random.default_rng(0)
    r, s = random.normal(size=(2, 50, 3))
    R, S = from_quaternions(quaternions(r)), from_quaternions(quaternions(s))
    both = between(quaternions(r), quaternions(s))
    for k in range(50):
        assert np.abs(R[k] - exp(r[k])).max() < 1e-14
        assert np.abs(both[k] - log(R[k] @ S[k].T)).max() < 1e-12
        assert np.abs(from_quaternions(product(quaternions(r), quaternions(s)))[k] - R[k] @ S[k]).max() < 1e-14
    small = between(quaternions(1e-12 * r), quaternions(np.zeros_like(r)))
    assert np.abs(small - 1e-12 * r).max() < 1e-24


def test_half_the_step_has_the_same_contacts() -> None:
    whole, half = Physics(), Physics(0.5 * Physics().time_step)
    assert half.trusted().contact == whole.trusted().contact == (0.001, 1.0)
    assert Physics(0.001).trusted().contact == (0.002, 1.0)


@pytest.mark.parametrize("clearance", [0.0002, 0.0001, 0.000067, 0.00005, 0.00002])
def test_contacts_are_as_hard_as_the_clearance_asks_for_whatever_the_step(clearance: float) -> None:
    period = Robot().period
    physics = Physics.of_fit(clearance, period).trusted()
    assert physics.contact[0] <= 10.0 * clearance * (1 + 1e-12)
    assert period / physics.time_step == pytest.approx(round(period / physics.time_step), abs=1e-9)
    assert physics.contact[0] >= 2.0 * physics.time_step * (1 - 1e-12)
    half = Physics.of_fit(clearance, period, 0.5 * physics.time_step).trusted()
    assert half.contact == pytest.approx(physics.contact)


def test_a_velocity_error_is_a_share_of_the_speed_that_is_run(square_peg_plan: dict[str, Any]) -> None:
    """A free part that is led half a millimetre up drifts as far off its way at a quarter of the speed."""
    robot = Robot()
    program = planned(parsed(square_peg_plan), robot)
    error = 0.05 * program.speed * np.array([1.0, 0.0, 0.0, 0.0, 1.0 / program.rho, 0.0])
    off = {pace: _drifted(square_peg_plan, program, robot, pace, error) for pace in (1.0, 0.25)}
    for name, whole, part in zip("pr", off[1.0], off[0.25], strict=True):
        size = float(np.linalg.norm(whole))
        assert size > (2e-5 if name == "p" else 1e-3)
        assert np.linalg.norm(whole - part) < 0.1 * size


def _drifted(plan: dict[str, Any], program: Program, robot: Robot, pace: float, error: Array) -> tuple[Array, Array]:
    """How far (3,), m, and by what turn (3,), rad, a part ends beside its way, at a share of the plan's speed."""
    up = np.array([0.0, 0.0, pace * program.speed, 0.0, 0.0, 0.0])
    free = Step("up", 0, Pose.identity(), np.eye(6), up, np.zeros((2, 6)), 0.0005, 10.0, 20.0, DONE, DONE)
    alone = replace(program, steps=(free,))
    model = compiled(scene(Bodies.of(parsed(plan)), Physics(), robot.mass, robot.inertia, program.friction))
    start = program.start.vector()
    p, q = start[None, :3], quaternions(start[None, 3:])
    rig = Rig(MujocoEngine(model, (p, q)), alone, robot, error[None, None], lambda: np.zeros((1, 6)))
    while rig.running.any():
        rig.tick()
    return (rig.qpos[0, :3] - p[0]) * np.array([1.0, 1.0, 0.0]), between(rig.qpos[:, 3:], q)[0]


def _deepest(plan: Plan, p: Array, q: Array) -> Array:
    """Greatest penetration (n,), m, as the tight 12 mm fit, in place of a plan's parts, is let go at these poses."""
    problem, robot = load(PROBLEMS / "factory_rect_12mm_tight.toml"), Robot()
    fixed, moving = (
        tuple(Body(tuple(map(tuple, piece.vertices.tolist())), ()) for piece in part.pieces)
        for part in (problem.fixed, problem.moving)
    )
    parts = replace(plan, fixed=replace(plan.fixed, pieces=fixed), moving=replace(plan.moving, pieces=moving))
    model = compiled(scene(Bodies.of(parts), Physics.of_fit(6.87e-5, robot.period), robot.mass, robot.inertia, 0.3))
    up, n = np.array([0.0, 0.0, 0.02, 0.0, 0.0, 0.0]), len(p)
    step = Step("up", 0, Pose.identity(), np.eye(6), up, np.zeros((2, 6)), 1.0, 10.0, 0.0, DONE, DONE)
    program = Program("still", Pose.identity(), 0.01, 0.02, (step,), 0.0, (1e-9, 1e-9))
    rig = Rig(MujocoEngine(model, (p, q)), program, robot, np.zeros((1, n, 6)), lambda: np.zeros((n, 6)))
    rig.tick()
    return rig.depth


def test_contacts_that_the_engine_makes_up_throw_no_part(
    square_peg_plan: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = parsed(square_peg_plan)
    p, q = np.vstack([FLAT, FLAT + 1e-9]), np.vstack([TURNED, TURNED])
    assert (_deepest(plan, p, q) < 1e-6).all()
    monkeypatch.setattr(mujoco_engine, "_SHIFTS", ())
    assert np.flatnonzero(_deepest(plan, p, q) > 1e-4).tolist() == [0, 1]


@pytest.mark.parametrize(("stays", "share"), [("push", 1.0), ("stop", 0.0), ("none", 0.0)])
def test_no_more_pushes_than_is_felt_where_the_plan_says_that_its_push_would_pry(
    square_peg_plan: dict[str, Any], stays: str, share: float
) -> None:
    document, robot = copy.deepcopy(square_peg_plan), Robot()
    for segment in document["segments"]:
        segment["hybrid"]["stays"] = stays
    program = planned(parsed(document), robot)
    model = compiled(scene(Bodies.of(parsed(document)), Physics(), robot.mass, robot.inertia, program.friction))
    start = program.start.vector()
    moves = 1 + max(step.move for step in program.steps)
    starts = start[None, :3], quaternions(start[None, 3:])
    rig = Rig(MujocoEngine(model, starts), program, robot, np.zeros((moves, 1, 6)), lambda: np.zeros((1, 6)))
    k, step = next((k, step) for k, step in enumerate(program.steps) if step.touch > 0.0 and step.hold.any())
    rig.state.shown[:], rig.state.gone[:], rig.state.moving[:] = k, step.travel, 1.0
    assert rig._allowed(rig.state.shown)[0] == pytest.approx(max(share * step.push, step.touch))
    rig.state.gone[:] = 0.0
    assert step.due <= 0.0 or rig._allowed(rig.state.shown)[0] == pytest.approx(step.push)
