# %% [markdown]
# # A part of your own
#
# From a CAD program comes a mesh: STL or OBJ. (A STEP file is exported as STL first, finely where it is round.) Here
# we make two meshes as a CAD program would, a rectangular peg and a plate with a through hole, then forget where they
# came from.

# %%
from pathlib import Path

import trimesh

import fmopt

folder = Path("own_part")
folder.mkdir(exist_ok=True)
peg = trimesh.creation.box((12.0, 8.0, 30.0))  # in mm, as STL files are
plate = trimesh.creation.box((40.0, 30.0, 10.0))
hole = trimesh.creation.box((12.3, 8.3, 20.0))
for name, mesh in (("peg", peg), ("plate", trimesh.boolean.difference([plate, hole]))):
    mesh.export(folder / f"{name}.stl")

# %% [markdown]
# A model file says what a mesh does not: its unit, and where it mates. The frame of a peg stands in the centre of its
# leading face, z back into the part; that of a hole in the centre of its mouth, z out of it.

# %%
model = """name = "{name}"

[units]
length = "mm"
angle = "deg"

[mesh]
file = "{name}.stl"
unit = "mm"

[features.{feature}]
kind = "{kind}"
at = [0, 0, {height}]
length = {length}
"""
peg_model = model.format(name="peg", feature="shank", kind="solid", height=-15, length=30)
plate_model = model.format(name="plate", feature="slot", kind="hollow", height=5, length=10) + "through = true\n"
for name, text in (("peg", peg_model), ("plate", plate_model)):
    (folder / f"{name}.toml").write_text(text)

# %% [markdown]
# The problem file names both, the goal, and what is known of the errors. It is easiest to start from a shipped one:
# `fmopt examples --out trial` copies them.

# %%
file = folder / "problem.toml"
_ = file.write_text(
    """title = "Own peg into own plate"

[units]
length = "mm"
angle = "deg"
speed = "mm/s"

[moving]
model = "peg.toml"
feature = "shank"

[fixed]
model = "plate.toml"
feature = "slot"

[goal]
depth = "full"

[clearance]
x = 0.2
y = 0.15

[start]
height = 1

[uncertainty.start]
x = 0.03
y = 0.03
z = 0
rx = 0.05
ry = 0.05
rz = 0.05

[uncertainty.velocity]
translation = 0.001
rotation = 0.001

[specification]
speed = 20
contact_force = 20
torque_limit = 1
friction = 0.3
termination_force = 2

[settings]
max_tilt = 10
time_limit = 120
"""
)
problem = fmopt.load(file)
problem

# %% [markdown]
# Look at the line `clearance`: the drawing says 0.2 mm along x, the parts say 0.15 mm. The plan rests on the parts.
# Public data sets disagree with their own labels, too.

# %%
print("\n".join(line for line in problem.explain().splitlines() if "declared" in line or "measured" in line))

# %% [markdown]
# The errors fit into the clearance here, so that the peg can go straight in. Make them larger, `x = 0.3` say, and the
# plan becomes one of tilting and sliding; it takes longer to find.

# %%
plan = fmopt.solve(problem)
plan

# %% [markdown]
# Faults come all at once, each with file, line and advice.

# %%
text = file.read_text()
bad = text.replace('feature = "slot"', 'feature = "slott"').replace("x = 0.03", 'x = "4 deg"')
(folder / "bad.toml").write_text(bad)
try:
    fmopt.load(folder / "bad.toml")
except fmopt.InputError as error:
    print(error)
