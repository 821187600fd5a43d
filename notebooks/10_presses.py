# %% [markdown]
# # A plan of presses in a simulator of your own
#
# A press holds some axes, lets the others give way under a wrench, and ends when the part stands still. This notebook
# carries a plan of presses out in MuJoCo alone: the scene is a file, and `fmopt.press.Controller` says in each period
# what the robot is to do. The same loop fits an environment of robosuite or of a playground of yours.

# %%
import matplotlib.pyplot as plt
import mujoco
import numpy as np

import fmopt
import fmopt.press

problem = fmopt.load(fmopt.example("square_peg"))
tested = problem.with_({"settings.evidence": "tested"})
plan = fmopt.solve(tested)
plan.presses.attempts[0].presses[1]

# %% [markdown]
# ## The scene
#
# The frame of the world is that of the hole, its site `seat` is the goal. The keys are the nominal start and the
# vertices of the start errors.

# %%
(scene,) = plan.export("mjcf", "scene.xml", unverified=True)
model = mujoco.MjModel.from_xml_path(str(scene))
model.site("seat").pos, model.nkey, model.numeric("start_error").data

# %% [markdown]
# ## The loop
#
# Each part has its own draw of what is off: start, friction, stiffness, admittance, offset of the wrench, drift. They
# are drawn as those of the evidence are. The controller takes poses, wrenches of the contacts and velocities, and
# gives wrenches, with a damping that the simulator integrates implicitly.


# %%
def seated(friction: float, count: int, seed: int) -> np.ndarray:
    presses = plan.presses
    errors = fmopt.press.drawn_errors(plan.evidence.conditions, fmopt.press.count_presses(presses), seed, range(count))
    controller = fmopt.press.Controller(presses, count, errors=errors)
    models = [mujoco.MjModel.from_xml_path(str(scene)) for _ in range(count)]
    parts = [mujoco.MjData(one) for one in models]
    substeps = round(presses.robot.period / model.opt.timestep)
    for part, own, start in zip(parts, models, controller.starts, strict=True):
        own.geom_friction[:, 0], part.qpos[:] = friction, start
    reaction, axes = np.zeros((count, 6)), np.zeros(9)
    while not controller.done.all():
        poses, speeds = np.array([part.qpos for part in parts]), np.array([part.qvel for part in parts])
        command = controller.step(poses, reaction, speeds)
        for k in np.flatnonzero(~controller.done):
            part, own, force = parts[k], models[k], command.wrench[k]
            own.dof_damping[:3] = command.damping[k]
            mujoco.mju_quat2Mat(axes, part.qpos[3:])
            R, reaction[k] = axes.reshape(3, 3), 0.0
            part.qfrc_applied[:] = np.concatenate([force[:3], R.T @ force[3:]])  # MuJoCo has torques in the part's axes
            for _ in range(substeps):
                mujoco.mj_step(own, part)
                reaction[k] += part.qfrc_constraint / substeps
            reaction[k, 3:] = R @ reaction[k, 3:]
    return controller.seated


# %% [markdown]
# ## Rate against friction

# %%
frictions, count = (0.1, 0.5, 0.9, 1.3), 4
rates = [seated(friction, count, seed=7).mean() for friction in frictions]
figure, plot = plt.subplots(figsize=(5, 3))
plot.plot(frictions, rates, "o-")
plot.set(xlabel="coefficient of friction", ylabel=f"rate in {count} draws", ylim=(-0.05, 1.05))
plt.show()
