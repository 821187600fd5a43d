"""The scene of a plan as an MJCF file of its own, for simulators that know nothing of fmopt."""

from itertools import product

import numpy as np

from fmopt.execution.engines.engine import Bodies
from fmopt.execution.engines.physics import Physics
from fmopt.execution.engines.scene import numbers, scene
from fmopt.execution.press_controller import begun
from fmopt.execution.press_trials import SOFT
from fmopt.execution.robot import Robot
from fmopt.execution.rotation import quaternions
from fmopt.plan import Plan
from fmopt.plan.evidence import VERTICES
from fmopt.plan.guarded_moves import moves
from fmopt.plan.press import ALONE


def mjcf(plan: Plan) -> str:
    """Both parts as convex pieces, the fixed one in the world, whose frame is that of the hole; lengths are in m.

    Tool and obstacles are there, too, each in the body that it goes with, and collide as the parts do.

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
    cell = ALONE if presses is None else presses.cell
    text = scene(Bodies.of(plan), physics, robot.mass, robot.inertia, friction, cell)
    errors = np.vstack([np.zeros(6), np.array([*product((-1.0, 1.0), repeat=6)]) * box])
    names = ["start", *(f"vertex_{k}" for k in range(VERTICES))]
    poses = map(numbers, begun(start[None], errors).tolist())
    keys = "\n".join(f'    <key name="{name}" qpos="{q}"/>' for name, q in zip(names, poses, strict=True))
    goal = np.array(plan.goal)
    place = f'pos="{numbers(goal[:3].tolist())}" quat="{numbers(quaternions(goal[3:]).tolist())}"'
    site = f'    <site name="seat" {place} size="0.0005"/>\n'
    numeric = f'  <custom><numeric name="start_error" data="{numbers(box.tolist())}"/></custom>\n'
    custom = f"{numeric}  <keyframe>\n{keys}\n  </keyframe>\n"
    body, end = '    <body name="part">', "</mujoco>"
    return text.replace(body, site + body).replace(end, custom + end)
