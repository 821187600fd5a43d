"""Figures: the same bytes every time, whole, legible, nothing clipped; outlines are those of the sets they show."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from fmopt.plan import StatedContact, parsed
from fmopt.plan.error_sets import PlanErrorSet
from fmopt.report.bodies import contact_place
from fmopt.report.drawing import Drawing, sheet
from fmopt.report.figures import catalogue, figures
from fmopt.report.views import budget_view, cut_view
from fmopt.report.views.cut_view import move_ends, sections
from fmopt.report.views.graph_view import graphs
from fmopt.report.views.tube_view import ends_words, error_sets, outline
from fmopt.spatial.se3 import Pose
from tests.shared.plans.report_plans import bare_plan, cube, cube_plan, diagnostics, with_graph

NAMES = ["cut", "states", "margin", "tube", "budget", "trajectory"]


@pytest.fixture(scope="module")
def drawings() -> dict[str, Drawing]:
    return catalogue(parsed(with_graph()))


def test_every_figure_of_a_whole_plan_is_there(drawings: dict[str, Drawing]) -> None:
    assert list(drawings) == NAMES
    assert all(figure.title and figure.alt for figure in drawings.values())
    assert list(figures(parsed(bare_plan()))) == ["cut", "states", "margin", "tube"]


@pytest.mark.parametrize("name", NAMES)
def test_a_figure_is_the_same_every_time_and_has_something_on_it(drawings: dict[str, Drawing], name: str) -> None:
    text = drawings[name].svg()
    root = ElementTree.fromstring(text)
    assert root.tag.endswith("svg")
    assert len(root.findall(".//{*}path")) > 10
    assert catalogue(parsed(with_graph()))[name].svg() == text
    assert "<dc:date>" not in text


def test_a_picture_is_a_png(drawings: dict[str, Drawing]) -> None:
    assert drawings["states"].png(40.0).startswith(b"\x89PNG")


def beyond_the_axes(paper: Any) -> Iterator[Any]:
    """Labels of marks outside an axis's limits, which are never drawn."""
    from matplotlib.axis import Axis

    for axis in paper.findobj(Axis):
        low, high = sorted(axis.get_view_interval())
        for tick in axis.get_major_ticks():
            if not low <= tick.get_loc() <= high:
                yield from (tick.label1, tick.label2)


@pytest.mark.parametrize("name", NAMES)
def test_letters_are_large_enough_and_on_the_sheet(drawings: dict[str, Drawing], name: str) -> None:
    from matplotlib.text import Text

    with sheet(drawings[name].size) as paper:
        drawings[name].paint(paper)
        paper.canvas.draw()
        unseen = set(beyond_the_axes(paper))
        for text in paper.findobj(Text):
            if isinstance(text, Text) and text.get_text().strip() and text not in unseen:
                assert text.get_fontsize() >= 8.0, text.get_text()
                box, whole = text.get_window_extent(), paper.bbox
                assert -2.0 < box.x0 < box.x1 < whole.x1 + 2.0, text.get_text()
                assert -2.0 < box.y0 < box.y1 < whole.y1 + 2.0, text.get_text()


def test_drawing_leaves_the_users_settings_alone() -> None:
    import matplotlib

    before = dict(matplotlib.rcParams)
    catalogue(cube())["states"].svg()
    assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize("growth", [np.zeros((2, 2)), np.diag([4e-4, 0.0]), np.array([[0.04, 0.01], [0.01, 0.03]])])
def test_the_outline_has_the_support_of_zonotope_plus_ellipsoid(growth: np.ndarray) -> None:
    rng = np.random.default_rng(5)
    generators = rng.normal(size=(4, 2))
    points = outline(generators, growth)
    for angle in rng.uniform(0.0, 2.0 * np.pi, 200):
        u = np.array([np.cos(angle), np.sin(angle)])
        support = np.sum(np.abs(generators @ u)) + np.sqrt(u @ growth @ u)
        reached = np.max(points @ u)
        assert support * (1.0 - 2e-3) <= reached <= support * (1.0 + 1e-9)


def test_the_outline_of_a_flat_set_is_flat() -> None:
    points = outline([[1.0, 2.0]], np.zeros((2, 2)))
    assert np.ptp(points @ np.array([2.0, -1.0])) < 1e-12
    assert outline(np.zeros((0, 2)), np.zeros((2, 2))).max() == 0.0


def test_half_widths_take_the_smaller_bound() -> None:
    sets = error_sets(cube())
    assert list(sets) == ["start", "move 1", "move 2"]
    np.testing.assert_allclose(sets["start"].half_widths(), [3e-4, 3e-4, 0.0, 0.0, 0.0, 5e-3], rtol=1e-12)
    core, none = np.diag([1e-4, 2e-4, 0, 0, 0, 0]), np.zeros((6, 6))
    found = PlanErrorSet(core, np.diag([4e-8] * 6), none, none, 1e-10 * np.eye(6))
    np.testing.assert_allclose(found.half_widths(), [1.1e-4, 2e-4, *[1e-5] * 4], rtol=1e-12)


def test_a_set_that_does_not_follow_is_not_shown() -> None:
    plan = cube()
    broken = replace(plan, segments=(plan.segments[0], replace(plan.segments[1], start=plan.goal), plan.segments[2]))
    assert list(error_sets(broken)) == ["start", "move 1"]
    assert "no error at its end follows" in ends_words(broken)
    assert "tube" in figures(broken)


def test_a_plan_without_a_graph_shows_the_chain_of_its_states() -> None:
    (chain,) = graphs(cube())
    assert (chain.name, chain.dimensions, chain.sons, chain.chosen) == ("", (6, 5), ((1,), ()), (0, 1))
    (graph,) = graphs(parsed(with_graph()))
    assert (graph.name, graph.links) == ("mouth", ((0, 1), (0, 2), (1, 3), (2, 3)))


def test_the_cut_view_tells_the_gaps() -> None:
    assert cut_view.drawing(cube()).alt.endswith("Gaps in the goal pose: left in x–z 20 µm.")
    upright = cube_plan()
    upright["segments"][-1]["goal"][4] = 0.0
    assert cut_view.drawing(parsed(upright)).alt.endswith("left in x–z touching.")


@pytest.mark.parametrize("towards", [0.0, 0.3, 0.5 * np.pi, 2.0, 3.0])
def test_the_cut_is_in_the_plane_in_which_the_part_leans(towards: float) -> None:
    """Leaning by an angle in the plane of the cut, the part's flanks are drawn at that angle, wherever it leans."""
    document = cube_plan()
    lean = 0.2
    document["segments"][-1]["goal"][3:] = [-lean * np.sin(towards), lean * np.cos(towards), 0.0]
    plan = parsed(document)
    end = move_ends(plan)[-1]
    assert end.lean == pytest.approx(lean)
    assert np.sin(end.azimuth - towards) == pytest.approx(0.0, abs=1e-12)
    peg, block = sections(plan, end)
    sides = np.diff(np.array(peg.geoms[0].exterior.coords), axis=0)
    along = np.abs(np.arctan2(sides[:, 0], sides[:, 1])) % np.pi
    assert np.min(np.abs(np.minimum(along, np.pi - along) - lean)) < 1e-9
    assert not block.is_empty
    assert f"lean {np.degrees(lean):.1f}°" in cut_view.drawing(plan).alt


def test_a_contact_is_where_its_features_meet() -> None:
    plan = cube()
    end = Pose.from_vector(plan.segments[-1].goal)
    touching = contact_place(plan, "v0-f5", end)
    assert touching[0] == pytest.approx(-0.0051, abs=3e-5)
    plan = replace(plan, contacts=(*plan.contacts, StatedContact("e-e", "edge-edge", (0, 4), (2, 8))))
    a, b = end.apply(np.array([plan.moving.body.vertices[k] for k in (0, 4)]))
    c, d = (np.array(plan.fixed.body.vertices[k]) for k in (2, 8))
    at = contact_place(plan, "e-e", end)
    shares = np.linspace(0.0, 1.0, 2001)[:, None]
    gaps = [np.min(np.linalg.norm(np.cross(a + s * (b - a) - c, d - c), axis=-1)) for s in shares]
    assert np.linalg.norm(np.cross(at - c, d - c)) <= min(gaps) + 1e-12


def test_the_budget_adds_up_and_names_its_sources() -> None:
    boxes = {"robot": [3e-4, 3e-4, 1e-4, 0.01, 0.01, 0.01], "slide": [1e-4, 1e-4, 0.0, 0.0, 0.0, 0.0]}
    listed = [{"source": name, "symbol": "ε", "frame": "hole", "box": box} for name, box in boxes.items()]
    nothing = {"source": "nothing", "symbol": "", "frame": "hole", "box": [0.0] * 6}
    plan = cube(diagnostics=diagnostics(budget=[*listed, nothing]))
    assert [name for name, _ in budget_view.shares(plan)] == ["robot (ε)", "slide (ε)"]
    text = budget_view.drawing(budget_view.shares(plan)).alt
    assert "x, y  ±0.4 mm: robot (ε) 75 %, slide (ε) 25 %" in text
    assert "z  ±0.1 mm: robot (ε) 100 %" in text
    shown = budget_view.budget_table(plan)
    assert "0.3 (75 %)" in shown
    assert '<th scope="row">sum</th><td class="number">0.4</td>' in shown
    assert not budget_view.shares(cube())
    assert budget_view.budget_table(cube()) == ""
