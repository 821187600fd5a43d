"""The report of a study: its numbers against other ways to the same, its page complete, offline and reproducible."""

import json
import math
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import polars
import pytest
from scipy import stats

from fmopt.errors import ResourceError
from fmopt.study.results import table
from fmopt.study.results.figures import _grid, binding, figures, title
from fmopt.study.results.page import page
from fmopt.study.results.shares import bins, rank_correlation, share, sobol_indices, trials
from fmopt.study.results.table import Results, Varied
from fmopt.study.results.view import View, ticks
from fmopt.study.running.store import Scalar
from fmopt.study.sampling import cube

X, Y, W = Varied("gap", "m", None, False), Varied("turn", "rad", None, False), Varied("how", "word", None, False)
COLUMNS = ("outcome", "reason", "verdict", "margin", "binding_contact", "binding_move")


@pytest.mark.parametrize(("good", "total"), [(0, 1), (0, 10), (3, 10), (10, 10), (997, 1000)])
def test_outside_of_an_interval_what_was_counted_is_as_rare_as_stated(good: int, total: int) -> None:
    found = share(good, total)
    assert found.value == good / total
    assert stats.binom.sf(good - 1, total, found.low) == pytest.approx(0.025 if good else 1.0, abs=1e-9)
    assert stats.binom.cdf(good, total, found.high) == pytest.approx(0.025 if good < total else 1.0, abs=1e-9)


def test_the_interval_of_a_share_covers_it() -> None:
    for p in (0.02, 0.3, 0.5, 0.9):
        weights = stats.binom.pmf(np.arange(51), 50, p)
        covered = sum(w for k, w in enumerate(weights) if share(k, 50).low <= p <= share(k, 50).high)
        assert covered >= 0.95


def test_a_share_of_nothing_is_refused() -> None:
    for good, total in ((0, 0), (3, 2), (-1, 2)):
        with pytest.raises(ValueError, match="is no share"):
            share(good, total)


def test_rank_correlation_agrees_and_sees_only_order() -> None:
    rng = np.random.default_rng(3)
    x = rng.integers(0, 12, 60).astype(float)
    y = x + rng.normal(0.0, 5.0, 60)
    found = rank_correlation(x, y)
    assert found.value == pytest.approx(float(stats.spearmanr(x, y).statistic), abs=1e-12)
    assert found.low < found.value < found.high
    assert rank_correlation(np.exp(x), y**3) == found
    falling = rank_correlation(x[:5] * 0 + np.arange(5.0), -np.arange(5.0))
    assert falling.low == falling.value == pytest.approx(-1.0)
    assert -0.5 < falling.high < 0.5
    assert rank_correlation(x, np.ones(60)) is None
    assert rank_correlation(x[:3], y[:3]) is None


def test_sobol_indices_of_ishigamis_function() -> None:
    """f = sin a + 7 sin² b + 0.1 c⁴ sin a over [−π, π]³, whose indices are known."""
    a, b, c = (math.pi * (2.0 * cube("saltelli", 3, 4096, 1) - 1.0)).T
    found = sobol_indices(np.sin(a) + 7.0 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a), 3)
    assert found is not None
    V1, V2, V13 = 0.5 * (1.0 + math.pi**4 / 50.0) ** 2, 49.0 / 8.0, 8.0 * math.pi**8 / 225.0 * 0.01
    V = V1 + V2 + V13
    first, total = (V1 / V, V2 / V, 0.0), ((V1 + V13) / V, V2 / V, V13 / V)
    assert [index.first.value for index in found] == pytest.approx(first, abs=0.02)
    assert [index.total.value for index in found] == pytest.approx(total, abs=0.02)
    for index, s, t in zip(found, first, total, strict=True):
        assert index.first.low - 0.01 <= s <= index.first.high + 0.01
        assert index.total.low - 0.01 <= t <= index.total.high + 0.01


def test_sobol_indices_do_without_rows_that_are_not_known() -> None:
    points = cube("saltelli", 2, 256, 1)
    values = points[:, 0] + 0.5 * points[:, 1]
    values[5] = np.nan
    found = sobol_indices(values, 2)
    assert found is not None
    assert [index.first.value for index in found] == pytest.approx([0.8, 0.2], abs=0.03)
    assert sobol_indices(np.ones(64), 2) is None
    assert sobol_indices(np.full(64, np.nan), 2) is None


def results(
    axes: Sequence[Varied], points: Sequence[tuple[Scalar, ...]], rows: Sequence[Mapping[str, Scalar]]
) -> Results:
    columns = ("number", *(axis.name for axis in axes), *COLUMNS)
    lines = []
    for number, (point, row) in enumerate(zip(points, rows, strict=True)):
        values = {"number": number, **dict(zip((axis.name for axis in axes), point, strict=True)), **row}
        lines.append({column: values.get(column) for column in columns})
    sampling = json.dumps({"method": "grid", "runs": None, "seed": None})
    facts = {"title": "A <study> & more", "problem": "../p.toml", "program": "0", "sampling": sampling}
    return Results(facts, tuple(axes), columns, tuple(lines))


def answer(margin: float, contact: str = "v0-f1") -> dict[str, Scalar]:
    verdict = "CERTIFIED" if margin > 0.0 else "NOT_PROVED"
    return {"outcome": "done", "verdict": verdict, "margin": margin, "binding_contact": contact, "binding_move": 1}


GRID = [(x, y) for x in (1e-4, 2e-4, 3e-4) for y in (0.001, 0.002)]
ROWS = [*(answer(1e-5 * k, f"v{k % 2}-f1") for k in (-2, -1, 1, 2)), {"outcome": "timeout", "reason": "overdue"}, {}]


def test_a_grid_becomes_maps_with_what_works_and_what_binds() -> None:
    view = View(results((X, Y), GRID, ROWS))
    drawn = figures(view)
    assert set(drawn) == {"margin", "verdict", "share", "binding"}
    assert figures(view) == drawn
    assert view.good.tolist() == [False, False, True, True, False, False]
    assert view.axis(X).tolist() == pytest.approx([0.1, 0.1, 0.2, 0.2, 0.3, 0.3])
    assert binding(view) == {"v0-f1": 2, "v1-f1": 2}
    assert [(b.low, b.high, b.good, b.total) for b in bins(view, X)] == [
        (pytest.approx(0.1), pytest.approx(0.1), 0, 2),
        (pytest.approx(0.2), pytest.approx(0.2), 2, 2),
    ]
    assert view.kinds == ("NOT_PROVED", "NOT_PROVED", "CERTIFIED", "CERTIFIED", "timeout", "not done yet")


def test_the_page_says_all_of_it_and_needs_nothing_from_outside() -> None:
    view = View(results((X, Y), GRID, ROWS))
    text = page(view, figures(view))
    assert text == page(view, figures(view))
    assert "6 runs: 4 with answers, 1 failed, 1 not done yet. 2 of 4 are certified: 50 (6.76 to 93.2) %." in text
    assert "A &lt;study&gt; &amp; more" in text
    for words in ("What matters", "Spearman", "overdue", "v1-f1", "gap, mm", "turn, deg"):
        assert words in text
    assert "Sobol" not in text
    outside = re.findall(r'(?:src|href)="(?!data:|#)[^"]*"|url\(|@import|https?://', re.sub(r'base64,[^"]*', "", text))
    assert outside == []


def test_what_binds_is_told_in_words_and_by_name() -> None:
    words = {"pieces 0/12": "against the +x side", "v1-f1": "bounds of v1-f1", "v2-f2": None}
    rows = [{**answer(1e-5, name), "binding_words": said} for name, said in words.items()] * 2
    found = results((X, Y), GRID, rows)
    lines = tuple({**line, **row} for line, row in zip(found.lines, rows, strict=True))
    view = View(replace(found, lines=lines))
    assert binding(view) == {"against the +x side (pieces 0/12)": 2, "bounds of v1-f1": 2, "v2-f2": 2}
    text = page(view, figures(view))
    assert re.search(r"against the \+x side \(pieces 0/12\)</th><td[^>]*>2</td><td[^>]*>0.1 to 0.2</td>", text)


def test_values_in_a_table_are_told_apart() -> None:
    axis = Varied("hole", "m", None, False)
    places = [(x, y) for x in (0.01, 0.01005, 0.0101) for y in (0.001, 0.002)]
    text = page(View(results((axis, Y), places, ROWS)), {})
    assert all(f">{value}</th>" in text for value in ("10", "10.05"))


def test_figures_explain_only_what_they_show() -> None:
    line = {**ROWS[2], "verdict": "CERTIFIED"}
    whole = View(results((X, Y), GRID, [{**line, "margin": 1e-6 * n} for n in range(1, 7)]))
    assert title(whole, "margin", "; hatched: not certified", "; ×: no value") == "least margin, µm"
    mixed = View(results((X, Y), GRID, ROWS))
    assert title(mixed, "margin", "; hatched: not certified", "; ×: no value").endswith("certified; ×: no value")


def test_one_axis_becomes_a_curve_and_words_an_axis_of_words() -> None:
    curve = View(results((X,), [(x,) for x in (1e-4, 2e-4, 3e-4, 4e-4)], ROWS[:4]))
    assert set(figures(curve)) == {"margin", "verdict", "share"}
    words = View(results((W, X), [(w, x) for w in ("a", "b") for x in (1e-4, 2e-4)], ROWS[:4]))
    assert words.axis(W).tolist() == [0.0, 0.0, 1.0, 1.0]
    assert "certified" in page(words, figures(words))


def test_ticks_are_as_long_as_tells_them_apart() -> None:
    assert ticks(np.array([10.0, 10.05, 10.1])) == ["10", "10.05", "10.1"]
    assert ticks(np.array([10.05])) == ["10.05"]
    assert ticks(np.array([-1.0, 10.05])) == ["−1", "10.1"]
    assert ticks(np.array([0.1, 0.2])) == ["0.1", "0.2"]
    assert len(set(ticks(1.0 + 1e-9 * np.arange(4)))) == 4


def test_a_value_of_an_axis_is_never_in_two_bins() -> None:
    places = [(0.001 * k, 0.1) for k in range(40) for _ in range(3)]
    view = View(results((X, Y), places, [answer(1e-5 * (20.5 - k)) for k in range(40) for _ in range(3)]))
    found = bins(view, X)
    assert 4 <= len(found) <= 8
    assert all(before.high < after.low for before, after in pairwise(found))
    assert sum(b.total for b in found) == 120
    assert sum(b.good for b in found) == 63
    few = View(results((X, Y), places[:36], [answer(1e-5)] * 36))
    assert [b.total for b in bins(few, X)] == [3] * 12


def test_logarithmic_axes_have_cells_and_ticks_of_their_own() -> None:
    axis = Varied("mu", "", None, True)
    points = [(mu, y) for mu in (0.001, 0.01, 0.1) for y in (0.001, 0.002)]
    view = View(results((axis, Y), points, ROWS))
    grid = _grid(view)
    assert grid.borders[0] == pytest.approx(10.0 ** np.array([-3.5, -2.5, -1.5, -0.5]))
    assert figures(view) != figures(View(results((replace(axis, log=False), Y), points, ROWS)))


def test_a_study_without_any_number_still_maps_what_became_of_its_runs() -> None:
    rows = [{"outcome": "done", "verdict": v} for v in ("CERTIFIED", "NOT_FOUND", "INFEASIBLE") for _ in range(2)]
    assert {"verdict", "share"} <= set(figures(View(results((X, Y), GRID, rows))))


def test_reasons_that_differ_in_numbers_alone_are_one() -> None:
    said = "the parts overlap by {}.5 µm at v3-f1"
    rows = [{"outcome": "done", "verdict": "INFEASIBLE", "reason": said.format(k)} for k in (1, 2, 1)]
    alone = {"outcome": "done", "verdict": "NOT_FOUND", "reason": "nothing among 30 states"}
    text = page(View(results((X, Y), GRID, [*rows, alone, {"outcome": "crash", "reason": "exit 7"}, {}])), {})
    assert "the parts overlap by … µm at" in text
    assert "nothing among 30 states" in text
    assert text.index("exit 7") < text.index("Runs without a motion") < text.index("the parts overlap")


def test_trials_are_pooled_with_their_interval() -> None:
    rows: list[dict[str, Scalar]] = [
        {"outcome": "done", "verdict": "CERTIFIED", "trials": 100, "successes": n, "success": n / 100}
        | {"success_low": share(n, 100).low, "success_high": share(n, 100).high}
        for n in (100, 99, 90, 80)
    ]
    found = results((X, Y), GRID[:4], rows)
    lines = tuple({**line, **row} for line, row in zip(found.lines, rows, strict=True))
    view = View(replace(found, columns=(*found.columns, *list(rows[0])[2:]), lines=lines))
    assert [(b.good, b.total) for b in trials(view, X)] == [(199, 200), (170, 200)]
    assert [b.share for b in trials(view, X)] == [share(199, 200), share(170, 200)]
    text = page(view, figures(view))
    assert "How often it succeeds" in text
    assert "99.5 (97.2 to 100)" in text
    curve = View(replace(view.results, axes=(X,)))
    assert "95 % interval" in page(curve, figures(curve))


def test_three_sampled_axes_become_clouds_with_their_indices() -> None:
    points = [tuple(point) for point in cube("saltelli", 3, 16, 4).tolist()]
    rows = [answer(1e-5 * (p[0] - 0.5 * p[1])) for p in points]
    found = results((X, Y, Varied("mu", "", None, True)), points, rows)
    found = replace(found, facts={**found.facts, "sampling": json.dumps({"method": "saltelli", "runs": 16, "seed": 4})})
    view = View(found)
    text = page(view, figures(view))
    assert "Sobol indices" in text
    assert "saltelli, 16 points, seed 4" in text


@pytest.mark.parametrize("rows", [[{}] * 6, [{"outcome": "crash", "reason": "x"}] * 6, [answer(1e-5)] * 6])
def test_studies_without_anything_to_draw_have_a_page(rows: list[Mapping[str, Scalar]]) -> None:
    view = View(results((X, Y), GRID, rows))
    assert "6 runs: " in page(view, figures(view))


def test_csv_and_parquet_and_the_frame_hold_the_same(tmp_path: Path) -> None:
    found = results((X, Y), GRID, ROWS)
    (tmp_path / "t.parquet").write_bytes(table.parquet(found))
    frame = polars.read_parquet(tmp_path / "t.parquet")
    assert frame.equals(table.frame(found))
    lines = table.csv_text(found).splitlines()
    assert lines[0].split(",") == frame.columns
    assert lines[3] == "2,0.0002,0.001,done,,CERTIFIED,1e-05,v1-f1,1"
    assert lines[6] == "5,0.0003,0.002,,,,,,"
    assert frame["margin"].to_list() == [-2e-5, -1e-5, 1e-5, 2e-5, None, None]


def test_a_frame_without_polars_is_refused_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "polars", None)
    with pytest.raises(ResourceError, match="install fmopt with its extra 'frame'"):
        table.frame(results((X, Y), GRID, ROWS))
