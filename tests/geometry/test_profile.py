"""Planar parts as solids: they touch and overlap when, and only when, the profiles do."""

import math
from itertools import product

import numpy as np
import pytest
import shapely

from fmopt.contact.c_surface import Surfaces
from fmopt.contact.primitive import Kind, near_contacts
from fmopt.errors import GeometryError
from fmopt.geometry.convex_pieces import pieces
from fmopt.geometry.part import Part, Profiles, convex, outline, part_of, ridge, slab, width
from fmopt.papers.basanez_suarez.contact import basic_contacts
from fmopt.papers.basanez_suarez.profile import Profile
from fmopt.papers.basanez_suarez.sources import Deviations
from fmopt.spatial.se3 import Pose, exp

PEG = [(-0.01, 0.0), (0.008, 0.0), (0.01, 0.002), (0.01, 0.05), (-0.01, 0.05)]
LEFT = [(-0.03, -0.04), (-0.0105, -0.04), (-0.0105, -0.004), (-0.0145, 0.0), (-0.03, 0.0)]
RIGHT = [(-x, z) for x, z in reversed(LEFT)]


def parts() -> tuple[Part, Part]:
    return part_of("peg", ridge(PEG)), part_of("slot", slab([LEFT, RIGHT]))


def pose(x: float, z: float, phi: float) -> Pose:
    return Pose(np.array([x, 0.0, z]), exp([0.0, -phi, 0.0]))


def test_the_section_in_the_plane_is_the_profile() -> None:
    peg, slot = parts()
    for part, loops in ((peg, [PEG]), (slot, [LEFT, RIGHT])):
        corners = {tuple(np.round(v, 12)) for loop in loops for v in np.asarray(loop, dtype=float).tolist()}
        flat = {tuple(np.round(v[[0, 2]], 12)) for v in part.polyhedron.vertices if part is slot or abs(v[1]) < 1e-12}
        assert flat == corners
    # Seen along y the ridge is no larger than its profile.
    seen = shapely.Polygon(PEG).buffer(1e-9)
    assert all(seen.covers(shapely.Point(v[[0, 2]])) for v in peg.polyhedron.vertices)
    assert len(pieces(ridge(PEG))) == 1


def test_solids_overlap_when_profiles_do() -> None:
    peg, slot = parts()
    fixed = [shapely.Polygon(LEFT), shapely.Polygon(RIGHT)]
    seen = {True: 0, False: 0}
    for x, z, phi in np.random.default_rng(8).uniform((-0.02, -0.04, -1.0), (0.02, 0.02, 1.0), (400, 3)).tolist():
        moved = shapely.affinity.translate(
            shapely.affinity.rotate(shapely.Polygon(PEG), phi, origin=(0, 0), use_radians=True), x, z
        )
        area = max(moved.intersection(side).area for side in fixed)
        if 0.0 < area < 1e-9:
            continue
        there = pose(x, z, phi)
        overlap = any(_overlap(peg.pieces[0], piece, there) for piece in slot.pieces)
        assert overlap is (area > 0.0)
        seen[overlap] += 1
    assert min(seen.values()) > 50


def _overlap(moving: object, fixed: object, there: Pose) -> bool:
    """Whether two convex polyhedra share interior: no separating plane among faces and pairs of edges."""
    normals, points = [], []
    for body, R in ((moving, there.R), (fixed, np.eye(3))):
        assert hasattr(body, "faces")
        normals.append(np.array([R @ face.normal for face in body.faces]))
        p = body.vertices @ R.T
        points.append(p + there.p if body is moving else p)
    edges = [
        np.array([p[b] - p[a] for a, b in (edge.vertices for edge in body.edges)])
        for p, body in zip(points, (moving, fixed), strict=True)
    ]
    crossed = np.array([np.cross(a, b) for a, b in product(*edges)])
    crossed = crossed[np.linalg.norm(crossed, axis=1) > 1e-12]
    axes = np.vstack([*normals, crossed / np.linalg.norm(crossed, axis=1)[:, None]])
    one, two = (p @ axes.T for p in points)
    gap = np.maximum(two.min(axis=0) - one.max(axis=0), one.min(axis=0) - two.max(axis=0))
    return bool(gap.max() < -1e-12)


def test_every_planar_contact_is_one_contact_in_space() -> None:
    peg, slot = parts()
    body, fixed = peg.polyhedron, slot.polyhedron
    moving, static = Profile.of(PEG), Profile.of(*outline([LEFT, RIGHT]))
    none = Deviations(np.zeros(len(static.vertices)), 0.0, 0.0)
    exact = [cu for cu in basic_contacts(moving, static, none) if cu.nominal]
    rng, tried = np.random.default_rng(9), set()
    for _ in range(300):
        cu = exact[rng.integers(len(exact))]
        phi = cu.nominal.low + rng.uniform(0.2, 0.8) * (cu.nominal.high - cu.nominal.low) if cu.nominal else 0.0
        if abs(math.remainder(phi, 2 * math.pi)) > 1.2:
            continue
        curve = cu.at(phi).boundary()[0][0].curve
        x, z = curve.point(0.2 + 0.6 * rng.uniform())
        there = pose(float(x), float(z), phi)
        near = near_contacts(body, fixed, there, 1e-5, 1e-4)
        f = Surfaces.of(near, body, fixed).values(there)
        touching = [c for c, value in zip(near, f, strict=True) if abs(value) < 1e-9]
        wanted = Kind.VERTEX_FACE if cu.kind == "type-1" else Kind.EDGE_EDGE
        assert [c.kind for c in touching] == [wanted], cu.name
        tried.add(cu.name)
    assert len(tried) > 8


def test_drift_out_of_the_plane_moves_no_contact_to_first_order() -> None:
    peg, slot = parts()
    # Corner 0 on the left wall, the right side on the right mouth's lower corner: rows of both kinds.
    there = pose(0.0, -0.02, -0.02)
    near = near_contacts(peg.polyhedron, slot.polyhedron, there, 2e-3, 1e-3)
    _, N = Surfaces.of(near, peg.polyhedron, slot.polyhedron).values_and_rows(there)
    middle = np.abs(peg.polyhedron.vertices[:, 1]) < 1e-12
    level = [k for k, c in enumerate(near) if middle[list(c.moving)].all() and c.kind is not Kind.FACE_VERTEX]
    assert {near[k].kind for k in level} == {Kind.VERTEX_FACE, Kind.EDGE_EDGE}
    assert np.abs(N[level][:, [1, 3, 5]]).max() <= 1e-15


def test_outlines_join_what_touches() -> None:
    floor = [(-0.03, -0.05), (0.03, -0.05), (0.03, -0.04), (-0.03, -0.04)]
    (whole,) = outline([LEFT, RIGHT, floor])
    assert shapely.Polygon(whole).area == pytest.approx(
        sum(shapely.Polygon(p).area for p in (LEFT, RIGHT, floor)), rel=1e-12
    )
    assert shapely.LinearRing(whole).is_ccw
    assert len(outline([LEFT, RIGHT])) == 2
    ring = [[(0, 0), (3, 0), (3, 1), (0, 1)], [(2, 1), (3, 1), (3, 3), (2, 3)], [(0, 1), (1, 1), (1, 3), (0, 3)]]
    outer, inner = outline([*ring, [(0, 3), (3, 3), (3, 4), (0, 4)]])
    assert shapely.LinearRing(outer).is_ccw
    assert not shapely.LinearRing(inner).is_ccw
    assert Profiles(PEG, (outer,)).moving.flags.writeable is False


@pytest.mark.parametrize(
    "polygon",
    [
        [(0, 0), (1, 0)],
        [(0, 0), (0, 1), (1, 0)],
        [(0, 0), (2, 0), (1, 0.5), (0, 2)],
        [(0, 0), (1, 0), (2, 0), (0, 1)],
        [(0, 0), (1, 0), (1, 0), (0, 1)],
        [(math.cos(0.8 * math.pi * k), math.sin(0.8 * math.pi * k)) for k in range(5)],
    ],
    ids=["two", "clockwise", "reflex", "straight", "repeated", "star"],
)
def test_polygons_that_are_not_convex_are_refused(polygon: list[tuple[float, float]]) -> None:
    with pytest.raises(GeometryError, match=r"at least three|does not turn left"):
        convex(polygon)


def test_width() -> None:
    assert width(convex([(0, 0), (3, 0), (3, 4), (0, 4)])) == pytest.approx(3.0)
    assert width(convex([(0, 0), (3, 0), (0, 4)])) == pytest.approx(2.4)
