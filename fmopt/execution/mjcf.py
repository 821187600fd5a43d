"""The scene of a plan as an MJCF file of its own, for simulators that know nothing of fmopt."""

from itertools import product

import numpy as np

from fmopt.execution.engines.engine import Bodies
from fmopt.execution.engines.physics import Physics
from fmopt.execution.engines.scene import scene
from fmopt.execution.press_trials import SOFT
from fmopt.execution.robot import Robot
from fmopt.execution.rotation import product as turned
from fmopt.execution.rotation import quaternions
from fmopt.plan import Plan
from fmopt.plan.guarded_moves import moves
from fmopt.spatial.values import Array


def mjcf(plan: Plan) -> str:
    """Both parts as convex pieces, the fixed one in the world, whose frame is that of the hole; lengths are in m.

    The moving part is the free body "part" about the centre of its leading face, with the apparent mass of the robot.
    The site "seat" is where it is seated. The key "start" has it at its nominal start, the keys "vertex_0" to
    "vertex_63" have it at the vertices of the start errors, and the numeric "start_error" holds their half-widths (6,),
    m and rad: other starts are drawn from these, a turn about the axes of the world after the nominal one.
    """
    presses, evidence = plan.press_plan, plan.trials
    robot = Robot() if presses is None else presses.robot
    start = moves(plan)[0].start.vector() if presses is None else np.array(presses.attempts[0].start)
    box = np.array(plan.start_box if evidence is None else evidence.conditions.start)
    friction = plan.specification.friction if evidence is None else float(np.mean(evidence.conditions.friction))
    clearance = plan.moving.measured_clearance
    physics = Physics.of_fit(clearance if presses is None else SOFT * clearance, robot.period)
    text = scene(Bodies.of(plan), physics, robot.mass, robot.inertia, friction)
    errors = {"start": np.zeros(6)}
    errors |= {f"vertex_{k}": np.array(signs) * box for k, signs in enumerate(product((-1.0, 1.0), repeat=6))}
    keys = "\n".join(f'    <key name="{name}" qpos="{_begun(start, error)}"/>' for name, error in errors.items())
    goal = np.array(plan.goal)
    site = f'    <site name="seat" pos="{_words(goal[:3])}" quat="{_words(quaternions(goal[3:]))}" size="0.0005"/>\n'
    custom = (
        f'  <custom><numeric name="start_error" data="{_words(box)}"/></custom>\n  <keyframe>\n{keys}\n  </keyframe>\n'
    )
    body, end = '    <body name="part">', "</mujoco>"
    return text.replace(body, site + body).replace(end, custom + end)


def _begun(start: Array, error: Array) -> str:
    q = turned(quaternions(error[3:]), quaternions(start[3:]))
    return _words(np.concatenate([start[:3] + error[:3], q]))


def _words(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)
