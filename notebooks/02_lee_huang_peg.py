# %% [markdown]
# # Lee and Huang's peg, figure by figure
#
# [LeeHuang1985] derive a position/force trajectory from two parts, a goal and tolerances: a round peg into a round
# hole.
# We follow their figures. The paper gives no dimensions; ours are a peg of 20 mm and 0.25 mm of clearance a side.

# %%
import matplotlib.pyplot as plt
import numpy as np

import fmopt
from fmopt.papers.lee_huang.hand_position_force import position_force
from fmopt.plan.position_force import Decomposition, contact_forces

problem = fmopt.load(fmopt.example("lee_huang_peg"))
fmopt.show(problem, "parts")

# %% [markdown]
# ## Figure 1: objects as trees
#
# An object is a tree of four levels: object, feature class, feature, instances. Solid features add, hollow ones remove.

# %%
for tree in problem.trees:
    for group in tree.classes:
        for feature in group.features:
            instances = ", ".join(instance.key for instance in feature.instances)
            print(f"{tree.name:16} {group.name:10} {feature.sign} {feature.name:8} {instances}")

# %% [markdown]
# ## Figure 2: the task
#
# Five attributes make a task: operands, grasp, goal, attachment, specification. A cylindrical pair leaves the depth and
# the angle about the axis free; the knowledge base settles both.

# %%
nominal = fmopt.stages.nominal(problem)
answer = nominal.task
print(answer.task.moving, "into a", answer.task.attachment, "pair with", answer.task.fixed)
for settled in answer.settled:
    print(settled)

# %% [markdown]
# ## Cut-diagrams and their expansion
#
# Three planes cut operand 2, which gives G. Operand 1 shrinks to a line L while G expands to GE. Where L fits, the peg
# fits. The ball and the cone are what is uncertain of the position and of the direction of L.

# %%
fmopt.show(nominal.planes)

# %% [markdown]
# ## P(t) and S(t)
#
# The nominal trajectory P(t) leads the centre of the peg's face over the mouth and down. S(t) says of each axis whether
# the uncertain peg is stopped: 0 free, ±1 on one side, 2 on both.

# %%
nominal

# %% [markdown]
# ## Position and force over time
#
# Axes with S = 0 are servoed in position along Pa(t) = Γ(S, P), the others in force, Fa(t) = Ω(S). Once the peg is in
# the hole, C_ap is what the paper has: (0, 0, p_z, 0, 0, q_z).

# %%
for interval in nominal.freedoms:
    print(f"from {interval.start:.3f} s: S = {interval.s}, C_ap = {Decomposition(interval.s).written['C_ap']}")

# %%
rows = position_force(
    nominal.path, nominal.freedoms, contact_forces(problem.specification, problem.measured.half_diagonal)
)
figure, (above, below) = plt.subplots(2, 1, figsize=(7, 4.2), sharex=True, layout="constrained")
for axis, (name, dash) in enumerate(zip("xyz", ("-", "--", ":"), strict=True)):
    times = [t for row in rows for t in (row.start, row.end)]
    above.plot(times, [1e3 * p[axis] for row in rows for p in (row.pa_start, row.pa_end)], dash, label=f"Pa {name}")
    below.step(times, [row.fa[axis] for row in rows for _ in (0, 1)], dash, label=f"Fa {name}")
above.set_ylabel("position, mm")
below.set_ylabel("reaction, N")
below.set_xlabel("time, s")
for axes in (above, below):
    axes.legend(loc="center left", bbox_to_anchor=(1, 0.5))

# %% [markdown]
# ## Is S(t) so? Held against samples
#
# S(t) is for a ball and a cone of errors, which the problem states. Their corners, and random errors inside, are put on
# top of P(t). How far from the wall of the hole is the nearest point of the peg? S(t) may say "stopped" too early, by
# what its linear picture of curved contacts adds on the safe side, but never too late.

# %%
from itertools import product

from fmopt.spatial.se3 import Pose, exp

walls = [face for face in problem.fixed.polyhedron.faces if abs(face.normal[2]) < 1e-9 and -0.02 < face.offset < 0]
normals, offsets = np.array([face.normal for face in walls]), np.array([face.offset for face in walls])
corners = problem.moving.polyhedron.vertices
corners = corners[np.lexsort((np.arctan2(corners[:, 1], corners[:, 0]).round(9), corners[:, 2].round(9)))]
foot, top = np.split(corners, 2)
rng = np.random.default_rng(1985)
unit = np.vstack([np.array(list(product((-1.0, 1.0), repeat=6))), rng.uniform(-1, 1, (200, 6))])
ball, cone = problem.trapezoid
errors = unit * np.repeat([ball, cone], 3)


def nearest(t):
    """The least distance (m) from the wall, over all errors, of what is below the mouth."""
    pose, least = nominal.path.pose(t), np.inf
    for error in errors:
        placed = Pose(pose.p + error[:3], exp(error[3:]) @ pose.R)
        low, high = placed.apply(foot), placed.apply(top)
        at_mouth = low + (low[:, 2] / (low[:, 2] - high[:, 2]))[:, None] * (high - low)
        points = np.vstack([low, at_mouth])
        least = min(least, float((points[points[:, 2] < 1e-9] @ normals.T - offsets).min()))
    return least


switch = next(interval.start for interval in nominal.freedoms if interval.s[0] == 2)
times = np.linspace(switch - 0.2, switch + 0.3, 26)
distances = [1e6 * nearest(t) for t in times]
figure, axes = plt.subplots(figsize=(7, 2.8), layout="constrained")
axes.plot(times, distances, "o-", markersize=3, label="nearest point of the sampled peg")
axes.axvline(switch, color="#a34a00", linestyle="--", label="S(t) says stopped from here")
axes.axhline(0, color="black", linewidth=0.6)
axes.set_xlabel("time, s")
axes.set_ylabel("distance from the wall, µm")
axes.legend()
touch = float(np.interp(0, distances[::-1], times[::-1]))
print(f"S(t) switches at {switch:.3f} s, the first sample touches at {touch:.3f} s")
assert nearest(switch) > 0 > nearest(times[-1])
