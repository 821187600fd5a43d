# %% [markdown]
# # A study, from file to heat map
#
# How hard must the part be pressed, for which friction? A study file names a base problem, axes over any of its
# parameters, and what to compute. It goes on where it was interrupted, on one machine or on a cluster.

# %%
from pathlib import Path

import fmopt

file = Path("friction.toml")
_ = file.write_text(
    f"""title = "Square peg: how firmly a bias holds the contacts, over friction and force"
problem = "{fmopt.example("square_peg").as_posix()}"
compute = ["bias"]

[units]
length = "mm"
angle = "deg"
time = "s"

[[axes]]
name = "friction"
low = 0.05
high = 0.6
steps = 12
sets = ["specification.friction"]

[[axes]]
name = "force"
values = [2, 5, 10, 20, 40]
sets = ["specification.contact_force"]

[limits]
time = 600
"""
)

# %% [markdown]
# Which paths are there? All numbers and choices of the problem, and the parameters of both models.

# %%
targets = fmopt.load(fmopt.example("square_peg")).targets
print("\n".join(path for path in targets if not path.startswith("uncertainty.sources")))

# %% [markdown]
# Carry it out. The motion does not depend on friction and force, so that it is searched once. The map shows the least
# normal force with which every held contact can be kept while the next one is felt, and, where there is one, the border
# beyond which no bias does it.

# %%
study = fmopt.study(file, "out/friction", jobs=1)
study

# %% [markdown]
# The same numbers as a data frame.

# %%
study.frame().select("friction", "force", "holds", "least_normal_force").head(8)

# %% [markdown]
# A second call finds everything done and computes nothing. The report is a page that opens offline.

# %%
fmopt.study(file, "out/friction", jobs=1).report()
