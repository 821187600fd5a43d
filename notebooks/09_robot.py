# %% [markdown]
# # From plan to robot
#
# A plan is data: what a robot needs of it, and how it is exported.

# %%
from pathlib import Path

import fmopt

problem = fmopt.load(fmopt.example("lee_huang_peg"))
plan = fmopt.solve(problem)
plan

# %% [markdown]
# ## What a controller is told
#
# Along the position axes it servoes position, along the force axes force; it presses with the bias wrench, and stops
# when the reaction along the termination wrench reaches a threshold.

# %%
plan.segments[-1]

# %% [markdown]
# ## Exports
#
# For a robot the frame of the hole is given in the base of the robot: metres, and a rotation vector in rad.

# %%
base = (0.4, -0.1, 0.2, 0.0, 3.14159265, 0.0)
(script,) = plan.export("urscript", "peg.script", base=base)
print("\n".join(Path(script).read_text().splitlines()[:40]))

# %%
(table,) = plan.export("csv", "samples.csv", rate=10.0)
print("\n".join(Path(table).read_text().splitlines()[:6]))
