# %% [markdown]
# # First insertion, start to end
#
# A square peg is to go into a blind square hole. The clearance is 0.1 mm a side, the position of the peg is known to
# 0.3 mm only: pushed straight down it would stand on the rim. We ask for a motion that works for every error in the
# stated set, and for a proof.

# %%
import fmopt

problem = fmopt.load(fmopt.example("square_peg"))
problem

# %% [markdown]
# The parts can be looked at from all sides. The picture turns with the mouse or the arrow keys, and needs no network.

# %%
fmopt.show(problem.fixed, "scene")

# %% [markdown]
# Solving takes some seconds to minutes. What comes back says first whether it is proved.

# %%
plan = fmopt.solve(problem)
plan

# %% [markdown]
# The verdict is not the planner's word: a separate program, which shares no code with it, derives every inequality
# again from the geometry in the plan, in exact arithmetic.

# %%
plan.verify(problem)

# %% [markdown]
# What binds? The margin is what is left of the tightest inequality of each move.

# %%
fmopt.show(plan, "margin")

# %% [markdown]
# Each move presses the part against the contacts that it has, so that the error shrinks from contact to contact.

# %%
fmopt.show(plan, "tube")

# %% [markdown]
# A segment holds what a controller needs: which axes are servoed in position and which in force, with what bias, and
# when to stop.

# %%
plan.segments[4]

# %%
plan.to_dataframe().select("segment", "move", "goal_state", "margin", "push", "threshold", "max_travel")

# %% [markdown]
# Everything is written to one plan file, and to one page that opens offline.

# %%
plan.save("out/square_peg/plan.json"), plan.report("out/square_peg/report.html")

# %% [markdown]
# ## Half the clearance
#
# `with_` changes a problem by path, and `clearance` re-cuts the hole as well; the problem that we had stays as it is.

# %%
tighter = problem.with_(clearance="0.05 mm")
print(f"{1e3 * problem.measured.per_side:.3f} mm, then {1e3 * tighter.measured.per_side:.3f} mm a side")
tighter.source.data["fixed"]

# %% [markdown]
# The errors stay as large as they were, six times the clearance now. It is planned anew: a plan is of its own parts.

# %%
tight_plan = fmopt.solve(tighter)
for each in (plan, tight_plan):
    print(f"{each.verdict}: {len(each.moves)} moves, least margin {1e6 * each.margin:.0f} µm")

# %% [markdown]
# Less clearance is left to the contacts, and less of a margin.

# %%
fmopt.show(tight_plan, "margin")
