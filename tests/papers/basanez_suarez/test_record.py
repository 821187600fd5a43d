"""Planar sets as data and as figures, and what they say of a plan in the plane."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from fmopt.papers.basanez_suarez.account import (
    PlanarPath,
    PlanarWay,
    account,
    contact_sets,
    in_plane,
    reach_of,
    surface,
)
from fmopt.papers.basanez_suarez.c_obstacle import PossibleContacts
from fmopt.papers.basanez_suarez.contact import CU, ContactType, Range
from fmopt.papers.basanez_suarez.profile import Profile
from fmopt.papers.basanez_suarez.sources import Deviations
from fmopt.plan import Plan
from fmopt.plan.description import Description
from fmopt.plan.diagnostics import Boundary, Planar
from fmopt.report.drawing import drawn
from fmopt.report.figures import catalogue
from fmopt.report.page import possible_contacts
from fmopt.report.views import planar_view, surface_view
from tests.shared.plans.report_plans import cube, diagnostics

RANGE, SURE = Range(-0.6, 0.9), Range(-0.4, 0.7)
EDGE = {"1": [[0.02, 0.0], [-0.02, 0.005]], "A": [[-0.015, -0.02], [0.025, -0.02]], "B": [[0.01, -0.02], [0.04, -0.02]]}
PEG = [(-0.01, 0.0), (0.01, 0.0), (0.01, 0.05), (-0.01, 0.05)]
LEFT = [(-0.03, -0.04), (-0.0105, -0.04), (-0.0105, 0.0), (-0.03, 0.0)]
RIGHT = [(0.0105, -0.04), (0.03, -0.04), (0.03, 0.0), (0.0105, 0.0)]


def contact(name: str) -> CU:
    kind = ContactType.TYPE_1 if name == "1" else ContactType.TYPE_2
    return CU(kind, 0, 1, EDGE[name], [0.03, -0.01], RANGE, SURE, 0.25, 0.003)


def points(found: Boundary) -> np.ndarray:
    return np.vstack([planar_view.piece_points(piece) for loop in found.loops for piece in loop])


@pytest.mark.parametrize("name", EDGE)
def test_sets_draw_the_boundary(name: str) -> None:
    cu, phi = contact(name), 0.3
    sets = contact_sets(cu, phi, (0.1, 0.2))
    shape = cu.at(phi)
    assert np.abs(shape.core_distance(points(sets[-1])) - shape.radius).max() <= 1e-9 * shape.size
    # The curves run on from one another, and round what is possible without deviations.
    for found in sets:
        for loop in found.loops:
            ends = [planar_view.piece_points(piece)[[0, -1]] for piece in loop]
            for (_, last), (first, _) in zip(ends, [*ends[1:], ends[0]], strict=True):
                assert np.hypot(*(last - first)) <= 1e-9
        assert found.nominal
    assert shape.core_distance(np.array(sets[-1].nominal)).max() <= 1e-12
    expected = {"1": ["Uv", "CUv", "CUl"], "A": ["Ul", "CUl"], "B": ["Ul", "CUl"]}
    assert [found.name.split()[0] for found in sets] == expected[name]
    if name != "1":
        assert sets[0].name.endswith(f"case {name}")
        assert ("n" in {piece.on for loop in sets[0].loops for piece in loop}) is (name == "A")


def test_uv_lies_about_the_vertex() -> None:
    cu = contact("1")
    held = contact_sets(cu, 0.3, (0.1, 0.2))[0]
    c, s = math.cos(0.3), math.sin(0.3)
    vertex = np.array([0.1, 0.2]) + np.array([[c, -s], [s, c]]) @ cu.vertex
    assert np.array(held.nominal) == pytest.approx(vertex[None], abs=1e-15)


def test_surfaces_hold_their_nominal_surface_where_it_exists() -> None:
    cu = contact("A")
    found = surface(cu, 16)
    assert [part.phi for part in found.slices] == pytest.approx(np.linspace(-0.6, 0.9, 16))
    for part in found.slices:
        assert bool(part.boundary.nominal) is bool(SURE.contains(part.phi))
        shape = cu.at(part.phi)
        assert np.abs(shape.core_distance(points(part.boundary)) - shape.radius).max() <= 1e-9 * shape.size


def test_figures_are_drawn_in_the_colours_of_the_circles() -> None:
    sets = tuple(one for name in EDGE for one in contact_sets(contact(name), 0.3, (0.0, 0.0)))
    picture = drawn(partial(planar_view.paint_sets, sets), planar_view.sets_size(sets)).decode()
    used = {piece.on for found in sets for loop in found.loops for piece in loop}
    assert used == set(planar_view.CARRIERS)
    for colour, _, _ in planar_view.CARRIERS.values():
        assert colour in picture
    surfaces = tuple(surface(contact(name), 6) for name in ("1", "A"))
    assert surface_view.drawing(surfaces).svg().startswith("<?xml")
    found = catalogue(described(replace(told(), sets=sets, surfaces=surfaces)))
    assert "Ul of edge 0, case A" in found["sets"].alt
    assert "type-2, φ from -34.38 to 51.57°" in found["surfaces"].alt
    assert not {"sets", "surfaces"} & set(catalogue(cube()))


def described(planar: Planar) -> Plan:
    """A plan that is described by the account."""
    found = cube(diagnostics=diagnostics())
    assert found.description.diagnostics is not None
    return replace(found, description=Description(diagnostics=replace(found.description.diagnostics, planar=planar)))


def told(aside: float = 2e-3, stopped_from: float = 1.0) -> Planar:
    """The account of a peg that goes straight down into a slot 1 mm wider than it is."""
    nominal = PlanarPath([(0.0, 0.01, 0.0), (0.0, -0.03, 0.0)], [0.0, 4.0], ((stopped_from, 4.0, True),))
    run = [
        PlanarWay([(0.0, 0.01, 0.0), (0.0, -0.001, 0.0)], aside, 0.01),
        PlanarWay([(0.0, -0.001, 0.0), (0.0, -0.03, 0.0)], 1e-4, 0.0),
    ]
    return account(PEG, [LEFT, RIGHT], nominal, run)


def test_account_of_an_insertion() -> None:
    found = told()
    first, second = found.segments
    assert first.phases[0].kind == "gross"
    # The tip meets the mouth's corners when the disc of 2 mm and the swing of 0.1 mm reach down to it.
    assert first.kind == "fine"
    at = next(phase.start for phase in first.phases if phase.kind == "fine")
    height = 0.01 - 0.011 * at
    assert 1.9e-3 <= height <= 2.2e-3
    assert second.kind == "gross"
    possible = PossibleContacts.between(Profile.of(PEG), Profile.of(LEFT, RIGHT), Deviations(np.zeros(8), 2e-3, 0.01))
    below = possible.gaps([[0.0, height - 1e-4, 0.0]])[0]
    names = {cu.name for cu, gap in zip(possible.sets, below, strict=True) if gap <= 0.0}
    assert names
    assert names <= {name for phase in first.phases for name in phase.contacts}
    assert {"Uv", "CUv", "CUl", "Ul"} == {one.name.split()[0] for one in found.sets}


def test_account_compares_with_s() -> None:
    assert told().agreement.agrees
    early = told(stopped_from=0.2).agreement
    assert not early.agrees
    assert early.only_stopped == pytest.approx(0.6, abs=0.05)
    late = told(stopped_from=2.0).agreement
    assert late.agrees
    assert late.only_possible > 1.0
    assert "disc around the box" in late.words
    assert late.both + late.neither + late.only_possible + late.only_stopped == pytest.approx(4.0)


def test_account_tells_how_high_to_carry() -> None:
    assert told().height == 0.0
    high = told(aside=0.012).height
    assert high is not None
    # 10 mm above the mouth, off by 12 mm and a swing.
    assert 2e-3 <= high <= 2.5e-3


def test_the_chapter_names_contacts_and_the_agreement() -> None:
    page = possible_contacts(described(told()))
    for said in ("S(t) stops motions only where the sets allow a contact", "by up to 2 mm", "meets nothing", "v0-e"):
        assert said in page
    assert possible_contacts(cube()) == ""
    lifted = possible_contacts(described(told(aside=0.012)))
    assert "it has to be lifted by 2." in lifted


def test_poses_in_the_plane() -> None:
    assert in_plane([1.0, 0.0, 2.0, 0.0, 0.3, 0.0]) == pytest.approx([1.0, 2.0, -0.3])
    assert reach_of([3e-3, 9.0, 4e-3, 9.0, 0.1, 9.0]) == pytest.approx((5e-3, 0.1))
