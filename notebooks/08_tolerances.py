# %% [markdown]
# # Tolerance allocation: which tolerances can be loosened?
#
# Tight tolerances cost money. A problem that states the sources of its errors, and a weight for each, make a question:
# what are the cheapest tolerances for which the motion is still certified, with some margin left?

# %%
from pathlib import Path

import matplotlib.pyplot as plt

import fmopt
from fmopt.study.allocation.allocation import allocate
from fmopt.study.allocation.tolerances import load_allocation

if not Path("trial").exists():
    fmopt.copy_examples("trial")
text = Path("trial/problems/lee_huang_peg.toml").read_text()
before, _, rest = text.partition("[uncertainty.start]")
_, _, after = rest.partition("\n\n")
sources = """[uncertainty.sources]
shape = 0.005 # manufacturing, of either part
configuration = { position = 0.01, angle = 0.005 } # fixture of the block
robot = { position = 0.005, angle = 0.005 }
grasp = { position = 0.005, angle = 0.01, height = 20 }

"""
file = Path("trial/problems/by_sources.toml")
_ = file.write_text(before + sources + after)
problem = fmopt.load(file)
print("\n".join(problem.explain().splitlines()[2:]))

# %% [markdown]
# ## The question
#
# Which tolerances may change, what each is worth, and which margin must be left. The cost of a tolerance is its weight,
# times the present value over the allowed one.

# %%
question_file = Path("trial/problems/tolerances.toml")
_ = question_file.write_text("""title = "Round peg: which tolerances can be loosened"
problem = "by_sources.toml"
margin = 0.005
gap = 0.05

[units]
length = "mm"
angle = "deg"

[[tolerances]]
name = "manufacturing"
sets = ["uncertainty.sources.shape"]
weight = 5

[[tolerances]]
name = "fixture_position"
sets = ["uncertainty.sources.configuration.position"]
weight = 2

[[tolerances]]
name = "fixture_angle"
sets = ["uncertainty.sources.configuration.angle"]

[[tolerances]]
name = "grasp_angle"
sets = ["uncertainty.sources.grasp.angle"]
weight = 3
""")
question = load_allocation(question_file)

# %% [markdown]
# ## The answer
#
# For a fixed motion the margins fall as tolerances grow, and the cheapest ones are found by convex programming, with
# tangents from true certificates. Then the motion is planned anew at the answer, which may allow for more.

# %%
answer = allocate(question)
print("\n".join(answer.words()))

# %%
names = [tolerance.name for tolerance in question.tolerances]
ratios = [value / tolerance.now for tolerance, value in zip(question.tolerances, answer.values, strict=True)]
figure, axes = plt.subplots(figsize=(7, 2.6), layout="constrained")
axes.barh(names[::-1], ratios[::-1], color="#b9c9de", edgecolor="#1b4f8a")
axes.axvline(1, color="black", linewidth=0.8)
_ = axes.set_xlabel("allowed tolerance, as a multiple of the present one")

# %% [markdown]
# What was promised holds: the independent check certifies the motion at the new tolerances, and leaves the margin.

# %%
assert answer.cost < answer.before
assert answer.document["verdict"] == "CERTIFIED"
assert answer.margin >= question.file.margin
print(f"margin left: {1e6 * answer.margin:.2f} µm; planned anew: {answer.replanned}")
