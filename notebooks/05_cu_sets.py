# %% [markdown]
# # Where planar contacts are possible: CU sets, with sliders
#
# In the plane, with deviations of shape, position and orientation bounded by circles and angles, [BasanezSuarez] derive
# the exact set of configurations in which two features may touch. Its boundary consists of arcs and segments; each
# figure says which circle a piece lies on.

# %%
from functools import partial

import numpy as np

import fmopt
from fmopt.papers.basanez_suarez.account import contact_sets, surface
from fmopt.papers.basanez_suarez.contact import CU, ContactType, Range
from fmopt.report.views import planar_view, surface_view

MM = 1e-3
whole = Range(-np.pi, np.pi)


def contact(kind, spread, radius):
    """A vertex 20 mm from the reference point, an edge 30 mm long; spread in rad, radius of the deviations in m."""
    edge = MM * np.array([[0.0, 0.0], [30.0, 0.0]])
    vertex = MM * np.array([0.0, -20.0])
    return CU(kind, 0, 0, edge, vertex, whole, whole, spread, radius)


def drawing(cu, phi):
    """The sets of a contact at an orientation φ, as a drawing."""
    sets = contact_sets(cu, phi, MM * np.array([15.0, 22.0]))
    title = f"{cu.name}: where the feature may be, and reference points that may touch"
    return fmopt.Drawing("sets", title, title, planar_view.sets_size(sets), paint=partial(planar_view.paint_sets, sets))


# %% [markdown]
# ## Type 1: a vertex of the grasped object on an edge
#
# Uv is where the vertex may be, CUv where the reference point may be when it touches one point of the edge, CUl when it
# touches the edge anywhere.

# %%
drawing(contact(ContactType.TYPE_1, 0.15, 1.5 * MM), 0.2)

# %% [markdown]
# The orientation on a slider. The set turns with φ, and keeps its shape.

# %%
one = contact(ContactType.TYPE_1, 0.15, 1.5 * MM)
fmopt.slider("φ", [(f"{np.degrees(phi):.0f}°", drawing(one, phi)) for phi in np.radians([-40, -20, 0, 20, 40])])

# %% [markdown]
# The uncertainty of the orientation on a slider: without any, CUl is a rectangle with round ends; the more there is,
# the longer the arcs.

# %%
spreads = np.radians([0.0, 4.0, 10.0, 20.0, 35.0])
fmopt.slider(
    "±ε_φ", [(f"{np.degrees(s):.0f}°", drawing(contact(ContactType.TYPE_1, s, 1.5 * MM), 0.2)) for s in spreads]
)

# %% [markdown]
# ## Type 2: an edge of the grasped object on a vertex
#
# The edge turns about the reference point, so that its set has two cases: either the edge passes the foot of the
# perpendicular while it turns, or it does not.

# %%
fmopt.slider(
    "±ε_φ", [(f"{np.degrees(s):.0f}°", drawing(contact(ContactType.TYPE_2, s, 1.5 * MM), 0.2)) for s in spreads]
)

# %% [markdown]
# ## Over all orientations
#
# Stacked over φ, the sets are a body around the nominal C-surface.

# %%
bodies = [surface(contact(kind, 0.15, 1.5 * MM)) for kind in (ContactType.TYPE_1, ContactType.TYPE_2)]
title = "CU of both types over φ"
fmopt.Drawing("surfaces", title, title, surface_view.paper(2), paint=partial(surface_view.paint_surfaces, bodies))

# %% [markdown]
# ## Is it so? A hundred thousand deviations
#
# Deviations drawn at random, on their bounds most of the time: none leads outside the set, and they fill it.

# %%
rng = np.random.default_rng(5)
n, phi = 100_000, 0.2
cu = contact(ContactType.TYPE_1, 0.15, 1.5 * MM)
k = rng.random((n, 1))
angle = phi + cu.spread * np.clip(rng.uniform(-1.3, 1.3, n), -1, 1)
way = rng.uniform(0, 2 * np.pi, n)
shift = cu.radius * np.minimum(rng.uniform(0, 1.5, n), 1.0)[:, None] * np.column_stack([np.cos(way), np.sin(way)])
swung = np.column_stack([-np.sin(angle), np.cos(angle)]) * cu.vertex[1]
touching = cu.edge[0] + k * (cu.edge[1] - cu.edge[0]) - swung + shift
gap = cu.gap(np.column_stack([touching, np.full(n, phi)]))
print(f"farthest outside: {1e6 * gap.max():.3g} µm; deepest inside: {1e3 * -gap.min():.2f} mm")
assert gap.max() < 1e-9
