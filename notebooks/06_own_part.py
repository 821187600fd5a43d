# %% [markdown]
# # A part of your own
#
# From a CAD program comes a mesh (STL, OBJ, PLY), or a STEP file. Here two shipped models are written as STL, as a CAD
# program would, and read back as if somebody else had made them: the rectangular peg and the plate of a public fit.

# %%
from importlib.util import find_spec
from pathlib import Path

import trimesh

import fmopt
from fmopt.geometry.polyhedron import triangulated

folder = Path("own_part")
folder.mkdir(exist_ok=True)
shipped = fmopt.load(fmopt.example("factory_rect_8mm_loose"))
for name, part in (("peg", shipped.moving), ("plate", shipped.fixed)):
    mesh = trimesh.Trimesh(1e3 * part.polyhedron.vertices, triangulated(part.polyhedron))  # in mm, as STL files are
    mesh.export(folder / f"{name}.stl")

# %% [markdown]
# A model file says what a mesh does not: its unit. Where it mates may be left out, as here: both parts tell it.
# (Or `[features.NAME]` says it: the frame of a peg stands in the centre of its leading face, z back into the part; that
# of a hole in the centre of its mouth, z out of it.)

# %%
model = """name = "{name}"

[units]
length = "mm"
angle = "deg"

[mesh]
file = "{name}.stl"
unit = "mm"
"""
for name in ("peg", "plate"):
    (folder / f"{name}.toml").write_text(model.format(name=name))

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
feature = "peg"

[fixed]
model = "plate.toml"
feature = "hole"

[goal]
depth = "full"

[clearance]
x = 0.15
y = 0.11

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
# Look at the lines `found`, which may be copied into the model and changed there, and at `clearance`: the drawing says
# 0.15 mm along x, the parts say 0.09 mm. The plan rests on the parts. Public data sets disagree with their own labels,
# too.

# %%
print("\n".join(line for line in problem.explain().splitlines() if "found:" in line or "measured" in line))

# %% [markdown]
# The errors fit into the clearance here, so that the peg can go straight in. Make them larger, `x = 0.3` say, and the
# plan becomes one of tilting and sliding; it takes longer to find.

# %%
plan = fmopt.solve(problem)
plan

# %% [markdown]
# ## STEP
#
# With the extra `step` a STEP file is read as it is: it says its unit, plane faces are exact, and curved ones are cut
# into facets that lie within `deviation` of them, which is added to the errors. Here Open CASCADE makes the plate.

# %%
if find_spec("OCP"):
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
    from OCP.gp import gp_Pnt
    from OCP.Message import Message
    from OCP.STEPControl import STEPControl_StepModelType, STEPControl_Writer

    messenger = Message.DefaultMessenger_s()
    for printer in list(messenger.Printers()):
        messenger.RemovePrinter(printer)  # it tells of every entity
    block = BRepPrimAPI_MakeBox(gp_Pnt(-20, -20, 0), gp_Pnt(20, 20, 8.9916)).Shape()
    hole = BRepPrimAPI_MakeBox(gp_Pnt(-4.0722, -3.567, -1), gp_Pnt(4.0722, 3.567, 10)).Shape()
    writer = STEPControl_Writer()
    writer.Transfer(BRepAlgoAPI_Cut(block, hole).Shape(), STEPControl_StepModelType.STEPControl_AsIs)
    writer.Write(str(folder / "plate.step"))
    step_model = model.format(name="step_plate").replace("step_plate.stl", "plate.step").replace('unit = "mm"\n', "")
    (folder / "step_plate.toml").write_text(step_model)
    (folder / "step.toml").write_text(file.read_text().replace("plate.toml", "step_plate.toml"))
    from_step = fmopt.load(folder / "step.toml")
    print("\n".join(line for line in from_step.explain().splitlines() if "found:" in line or "measured on" in line))
    print(fmopt.solve(from_step).verdict)
else:
    print("The extra step is not installed.")

# %% [markdown]
# ## What goes wrong first
#
# Faults come all at once, each with file, line and advice.

# %%
text = file.read_text()
bad = text.replace("height = 1", "heigth = 1").replace("x = 0.03", 'x = "4 deg"')
(folder / "bad.toml").write_text(bad)
try:
    fmopt.load(folder / "bad.toml")
except fmopt.InputError as error:
    print(error)

# %% [markdown]
# Of a mesh they name the triangle. A gap at the far end of a hole is closed, with a warning; in a wall it is refused.

# %%
plate = trimesh.load_mesh(folder / "plate.stl")
wall = [abs(corners[:, 0]).max() < 5 and corners[:, 2].min() < -1 for corners in plate.triangles]
plate.update_faces([i != wall.index(True) for i in range(len(wall))])
plate.export(folder / "plate.stl")
try:
    fmopt.load(file)
except fmopt.InputError as error:
    print(error)
