# %% [markdown]
# # From plan to robot
#
# A plan is data: what a robot needs of it, how it fares in a physics engine, and how it is exported.

# %%
from pathlib import Path

import fmopt

problem = fmopt.load(fmopt.example("square_peg"))
plan = fmopt.solve(problem)
plan

# %% [markdown]
# ## What a controller is told
#
# Along the position axes it servoes position, along the force axes force; it presses with the bias wrench, and stops
# when the reaction along the termination wrench reaches a threshold.

# %%
plan.segments[4]

# %% [markdown]
# ## In a physics engine
#
# Trials under random errors: of the start inside the certified set, of the velocity, with friction and a noisy force
# sensor. The success comes with its 95 % interval, for a few trials say little; a thousand take minutes.

# %%
trials = plan.execute(trials=6, seed=0)
print(trials)

# %% [markdown]
# Every trial can be looked at.

# %%
{key: value for key, value in trials.records[0].items() if key in ("success", "seconds", "peak_force", "penetration")}

# %% [markdown]
# ## Exports
#
# For a robot the frame of the hole is given in the base of the robot: metres, and a rotation vector in rad. Its z
# points out of the hole, so that a hole open to the ceiling is not turned.

# %%
base = (0.4, -0.1, 0.2, 0.0, 0.0, 0.0)
(script,) = plan.export("urscript", "peg.script", base=base)
print("\n".join(Path(script).read_text().splitlines()[:40]))

# %%
(table,) = plan.export("csv", "samples.csv", rate=10.0)
print("\n".join(Path(table).read_text().splitlines()[:6]))
