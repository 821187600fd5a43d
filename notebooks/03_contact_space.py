# %% [markdown]
# # The contact space of the square peg
#
# What can touch what? A primitive contact is a vertex on a face, a face on a vertex, or two edges that cross. Each is a
# surface f(X) = 0 in the space of poses X, and the contacts that are active together are a contact state.
# [DakinPopplestone1993] sections 2 and 3.

# %%
import matplotlib.pyplot as plt
import numpy as np

import fmopt
from fmopt.contact.c_surface import Surfaces, contact_wrench, symbolic_surface
from fmopt.contact.primitive import Kind
from fmopt.spatial.se3 import Pose

problem = fmopt.load(fmopt.example("square_peg"))
nominal = fmopt.stages.nominal(problem)
pose = nominal.critical[1].pose
print("at", nominal.critical[1].name, pose)

# %% [markdown]
# ## C-surfaces
#
# The signed distance of a contact as a formula: p is the position and R the rotation of the moving part, whose point v,
# normal n or edge through v along a meets the fixed part's plane n·x = c, point w or edge through q along e.

# %%
symbolic_surface(Kind.VERTEX_FACE)

# %%
symbolic_surface(Kind.FACE_VERTEX)

# %%
symbolic_surface(Kind.EDGE_EDGE)

# %% [markdown]
# At mid-depth, with the peg in the middle, 16 contacts are near, each one clearance away.

# %%
contacts = fmopt.stages.near_contacts(problem, pose)
surfaces = Surfaces.of(contacts, problem.moving.polyhedron, problem.fixed.polyhedron)
f, N = surfaces.values_and_rows(Pose.from_vector(pose))
for contact, value in zip(contacts, f, strict=True):
    print(f"{contact.id:8} {contact.kind.value:12} {1e3 * value:.4f} mm")

# %% [markdown]
# The surfaces are curved. A turn about y moves the corners of the peg along circles, the tangent moves them along
# lines. On the left the two can hardly be told apart; their difference is an eighth of the clearance at 3° and grows
# with the square of the angle: the linear picture is local.

# %%
angles = np.linspace(-0.05, 0.05, 101)
centre = Pose.from_vector(pose)
figure, (axes, beside) = plt.subplots(1, 2, figsize=(7.5, 3), layout="constrained")
bent = np.array([surfaces.values(centre.moved(np.array([0, 0, 0, 0, angle, 0]))) for angle in angles])
k = int(np.argmax(np.abs(N[:, 4])))
axes.plot(np.degrees(angles), 1e3 * bent[:, k], label=f"f of {contacts[k].id}")
axes.plot(np.degrees(angles), 1e3 * (f[k] + N[k, 4] * angles), "--", label="its tangent")
axes.axhline(0, color="black", linewidth=0.6)
axes.set_ylabel("distance, mm")
axes.legend()
beside.plot(np.degrees(angles), 1e6 * (bent[:, k] - f[k] - N[k, 4] * angles))
beside.set_ylabel("f less its tangent, µm")
for panel in (axes, beside):
    panel.set_xlabel("turn about y, °")
# %% [markdown]
# ## Contact states and their graph
#
# In the linear picture the free poses are a polyhedron, and its faces are the contact states: 3⁵ = 243 of them, with
# free space. Sliding along the axis is free in all of them.

# %%
graph = fmopt.stages.contact_graph(problem, pose)
graph

# %%
graph.count()

# %% [markdown]
# ## What a state feels like
#
# By virtual work, the gradient of f is the wrench with which the contact pushes. A state can be told from its
# neighbours by the wrenches that it can feel: non-negative combinations of those of its contacts.

# %%
state = next(s for s in graph.states if s.dimension == 4 and len(s.contacts) == 2)
body, fixed = problem.moving.polyhedron, problem.fixed.polyhedron
by_name = {contact.id: contact for contact in contacts}
print("state", state.id, "with", ", ".join(state.contacts))
for name in state.contacts:
    wrench = contact_wrench(by_name[name], body, fixed, centre)
    gradient = N[list(by_name).index(name)]
    print(f"{name:8} force {np.round(wrench[:3], 3)} torque {np.round(1e3 * wrench[3:], 2)} N·mm")
    assert np.allclose(wrench, gradient, atol=1e-9)

# %% [markdown]
# The neighbours of this state: one contact more, or one less.

# %%
number = graph.states.index(state)
print("breaking a contact leads to", [graph.states[i].contacts for i in graph.fathers[number]])
print("making one leads to", [graph.states[i].contacts for i in graph.sons[number]][:4], "…")
