"""The report page: verdict in words, nothing from outside, nothing unescaped, nothing called certified that is not."""

import subprocess
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fmopt.plan import parsed, sealed
from fmopt.report.control_tables import hybrid_table
from fmopt.report.figures import catalogue, figures
from fmopt.report.moves import move_words, moves, states, summary_rows, verdict
from fmopt.report.naming import binding_label, binding_words, combination, contact_words, quantity, spoken_axis
from fmopt.report.page import report_page
from fmopt.report.scene import scene
from tests.shared.pages.engine import Tree, walk, words
from tests.shared.plans.report_plans import bare_plan, cube, cube_plan, diagnostics, with_graph


def text_of(page: str) -> str:
    """The visible text."""
    return words(Tree(page).root)


def page_of(document: dict[str, Any], drawn: bool = False) -> str:
    plan = parsed(document)
    return report_page(plan, figures(plan) if drawn else {})


@pytest.fixture(scope="module")
def whole() -> str:
    return page_of(with_graph(), drawn=True)


def test_the_page_is_the_same_every_time() -> None:
    assert page_of(with_graph()) == page_of(with_graph())


def test_the_verdict_comes_first_and_in_words(whole: str) -> None:
    text = text_of(whole)
    assert text.index("Certified") < text.index("The motion") < text.index("What was not checked")
    for said in ("margin: 42 µm", "error is larger than the clearance", "no sequence is cheaper", "wedging beyond"):
        assert said in text


def test_chapters_come_in_the_order_in_which_people_ask() -> None:
    tolerated = {"factor": 1.5, "start_box": [1e-3] * 6, "sensitivities": []}
    plan = cube_plan(diagnostics={**with_graph()["description"]["diagnostics"], "tolerated": tolerated})
    heads = [node[1]["id"] for node in walk(Tree(page_of(plan, drawn=True)).root) if node[0] == "section"]
    wanted = "motion moves states margins budget trajectory hybrid tolerance limits asked provenance"
    assert heads == wanted.split()


def test_both_clearances_are_said_along_both_axes() -> None:
    plan = cube_plan()
    plan["parts"]["fixed"] |= {"declared_clearance": [1.1e-4, 0.9e-4], "measured_clearance": 0.8e-4}
    text = text_of(page_of(sealed(plan)))
    assert "declared 0.11 mm along x, 0.09 mm along y, measured 0.08 mm where it is least" in text
    plan["description"]["diagnostics"] = diagnostics(measured_clearance=[1.2e-4, 0.8e-4])
    text = text_of(page_of(sealed(plan)))
    assert text.count("measured 0.12 mm along x, 0.08 mm along y") == 1
    plan["description"]["diagnostics"] = diagnostics(measured_clearance=[1.2e-4, None])
    assert "measured 0.12 mm along x. Start error" in text_of(page_of(sealed(plan)))


def test_what_ends_the_tolerated_errors_is_said() -> None:
    found = {"factor": 1.5, "start_box": [1e-3] * 6, "sensitivities": []}
    for end, ending in (
        ({"move": 1, "binding": "v0-f5 too early", "reason": ""}, "What ends it is move 2: contact v0-f5 must not be"),
        ({"move": 0, "binding": "", "reason": "the tube misses the wall"}, "What ends it is move 1: the tube misses"),
    ):
        plan = cube_plan(diagnostics=diagnostics(tolerated={**found, "end": end}))
        assert ending in text_of(page_of(plan))


UNPROVED = {
    "not proved": cube_plan("NOT_PROVED"),
    "refuted": cube_plan("REFUTED"),
    "shortfall": cube_plan("CERTIFIED", margin=-1.2e-5),
    "zero": cube_plan("CERTIFIED", margin=0.0),
    "changed": {**cube_plan("CERTIFIED"), "goal": [0.0] * 6},
}


@pytest.mark.parametrize("name", UNPROVED)
def test_nothing_unproved_is_called_certified(name: str) -> None:
    plan = parsed(UNPROVED[name])
    words = [figure.alt for figure in catalogue(plan).values()]
    said = report_page(plan, {}) + scene(plan) + str(summary_rows(plan)) + str(words)
    assert not verdict(plan).proved
    assert "certified" not in said.lower()
    if name == "shortfall":
        assert "shortfall 12 µm" in said
    if name == "not proved":
        assert "computed margin, not proved: 42 µm" in said


def test_figures_of_an_unproved_plan_do_not_say_certified() -> None:
    from matplotlib.figure import Figure
    from matplotlib.text import Text

    for figure in catalogue(parsed(UNPROVED["shortfall"])).values():
        sheet = Figure(figsize=figure.size)
        figure.paint(sheet)
        assert not any("certified" in text.get_text().lower() for text in sheet.findobj(Text))


def test_a_bare_plan_has_a_page_too() -> None:
    page = page_of({**bare_plan(), "not_covered": []}, drawn=True)
    for said in ("Not proved", "The plan states no search", "The plan does not say what was not checked."):
        assert said in page


def test_moves_are_read_from_their_pieces() -> None:
    plan = cube()
    down, slide = moves(plan)
    assert (down.number, len(down.segments), slide.number, len(slide.segments)) == (1, 1, 2, 2)
    assert (slide.margin, slide.new) == (4.2e-5, ("v0-f5",))
    np.testing.assert_allclose([down.travel, slide.travel, slide.turn], [0.002, 0.0011, 0.004], rtol=1e-12)
    assert states(plan) == [((), 6), (("v0-f5",), 5)]
    assert move_words(plan, down) == "move freely 2.00 mm in −z"
    assert move_words(plan, slide) == (
        "move freely 1.10 mm in −x, turning 0.23° about y until leading corner v0 touches wall f5 (x = −5.1 mm)"
    )


def test_labels_of_figures_say_which_side() -> None:
    plan = cube()
    for binding in ("pieces 0/0", "v0-f1 too early", "v0-f1", ""):
        label = binding_label(plan, binding)
        assert label
        assert "pieces" not in label


def test_summary_rows_have_a_cell_for_each_head() -> None:
    rows = summary_rows(cube())
    assert [len(row) for row in rows] == [7, 7, 7]
    assert rows[0][5] == "certified margin"
    assert summary_rows(parsed(UNPROVED["not proved"]))[0][5] == "computed margin, not proved"
    assert rows[2][0] == "2"
    assert rows[2][5:] == ("42 µm", "cube against bracket piece 1 (x −15 to −5.1 mm)")


def test_words_for_bindings() -> None:
    plan = cube()
    plan = replace(plan, fixed=replace(plan.fixed, pieces=(plan.fixed.body,) * 2))
    assert binding_words(plan, "pieces 0/1") == "cube against bracket piece 1 (x −15 to 15 mm)"
    assert binding_words(plan, "0-0") == "cube against bracket piece 0 (x −15 to 15 mm)"
    assert binding_words(plan, "v0-f5 too early") == "contact v0-f5 must not be made too early"
    assert binding_words(plan, "v0-f5") == "bounds of contact v0-f5"
    assert binding_words(plan, "") == "–"
    assert contact_words(plan, "v9-f9") == "contact v9-f9 is made"


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        (quantity(3.1e-5), "31 µm"),
        (quantity(-7.47e-4), "−747 µm"),
        (quantity(0.00112), "1.12 mm"),
        (quantity(0.0), "0 µm"),
        (quantity(7e-17), "below 0.001 µm"),
        (spoken_axis(np.array([0.0, 0.0, -2.0]), always_signed=True), "−z"),
        (spoken_axis(np.array([-1.0, 1.1, 0.0])), "+y and −x"),
        (spoken_axis(np.zeros(3)), "none"),
        (combination([0, -5, 0, 0, 0.1, 0], "N", "N·m"), "−5 N y + 0.1 N·m ry"),
        (combination([1, 0, 0, 0, 0, 0]), "x"),
        (combination([0] * 6), "none"),
    ],
)
def test_words_for_quantities(said: str, expected: str) -> None:
    assert said == expected


def test_a_plan_for_a_share_of_the_errors_says_so() -> None:
    reduced = {"share": 0.6, "stated_start_box": [0.03, 0.0, 0.0, 0.0, 0.09, 0.0], "short": "nothing was found"}
    text = text_of(page_of(cube_plan("NOT_PROVED", diagnostics=diagnostics(reduced=reduced))))
    for said in ("start error that the problem states", "the plan is for 60% of it", "nothing was found"):
        assert said in text


def test_hybrid_strategies_of_alike_pieces_share_a_row(whole: str) -> None:
    plan = cube()
    down, near, touch = plan.segments
    text = text_of(hybrid_table(replace(plan, segments=(down, near, near, touch))))
    assert (text.count("pieces 1–2"), text.count("goes on after")) == (1, 1)
    text = text_of(whole)
    assert text.count("reaction along x reaches 2 N") == 1
    assert "−x at 20 mm/s" in text
    assert "turning at" not in text
    turned = replace(touch, hybrid=replace(near.hybrid, velocity=(-0.6, 0.0, 0.0, 0.0, 80.0, 0.0)))
    text = text_of(hybrid_table(replace(plan, segments=(turned,))))
    assert "at 20 mm/s, turning at 1.6 rad/s" in text


def test_ends_are_told_from_limits(whole: str) -> None:
    plan = cube()
    _, near, touch = plan.segments
    text = text_of(whole)
    assert "goes on after 500 µm; a contact felt before ends the move" in text
    assert "reaction along x reaches 2 N, nominally after 600 µm; a fault beyond 1.3 mm or 3 s" in text
    pieces = [replace(piece, hybrid=replace(piece.hybrid, felt=(), wrench=(0.0,) * 6)) for piece in (near, touch)]
    text = text_of(hybrid_table(replace(plan, segments=tuple(pieces))))
    assert "goes on after 500 µm" in text
    assert "felt" not in text
    assert "ends after 600 µm; a fault beyond 1.3 mm or 3 s" in text


def test_what_ends_a_move_without_a_contact_is_said(whole: str) -> None:
    text = text_of(whole)
    assert "Move 1 makes no contact: it ends after its travel, with nothing to feel. With every error" in text
    assert "no contact says that the part has arrived" not in text
    plan = cube_plan()
    plan["segments"] = plan["segments"][:1]
    text = text_of(page_of(sealed(plan)))
    assert "The last move is one of them: no contact says that the part has arrived. It begins at" in text
    text = text_of(page_of(UNPROVED["not proved"]))
    assert "nothing but what is held is touched up to there is not proved" in text


def test_importing_the_report_loads_no_plotting_library() -> None:
    code = "import sys, fmopt.report.page; print(sorted({'matplotlib', 'shapely', 'manifold3d'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
