"""A search asks for the least margin alone: it is the same whether planes of all pairs are the best, or few are."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

import fmopt
from fmopt.certificate.assembly import Assembly
from fmopt.certificate.piece_pairs import FacingPairs
from fmopt.certificate.remainder import EndsBatch
from fmopt.certificate.separating_plane import Separation, counted_rows
from fmopt.errors import SearchError
from fmopt.planning.moves import moves
from fmopt.planning.moves.separating_planes import choose_separations, choose_tightest
from tests.shared.files.prisms import prism, regular
from tests.shared.parts import families

Planes = list[list[Separation | None]]
Call = tuple[Assembly, FacingPairs, EndsBatch]


def asked(problem: fmopt.Problem, monkeypatch: pytest.MonkeyPatch, seconds: float) -> list[Call]:
    """What a search of some seconds has planes chosen for."""
    calls = list[Call]()

    def noted(assembly: Assembly, facing: FacingPairs, course: EndsBatch) -> Planes:
        calls.append((assembly, facing, course))
        return choose_tightest(assembly, facing, course)

    monkeypatch.setattr(moves, "choose_tightest", noted)
    with suppress(SearchError):  # the calls are what is asked for
        fmopt.solve(problem.with_(settings_time_limit=f"{seconds} s"))
    return calls


@pytest.mark.parametrize("name", ["14-gon", "triangle", "L"])
def test_the_least_margin_is_that_of_best_planes(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = (
        prism(tmp_path, regular(14, 10.0), regular(14, 10.1))
        if name == "14-gon"
        else families.write_toml(families.pair(name, 1), tmp_path)
    )
    calls = asked(fmopt.load(path), monkeypatch, 4.0)
    fewer = 0
    for assembly, facing, course in calls[:: max(len(calls) // 60, 1)]:
        some, every = (choose(assembly, facing, course) for choose in (choose_tightest, choose_separations))
        if any(plane is None for planes in every for plane in planes):
            assert any(plane is None for planes in some for plane in planes)
            continue
        one, other = (np.array([[p.margin for p in planes if p] for planes in found]) for found in (some, every))
        assert one.min() == other.min()
        assert (one <= other).all()
        fewer += int((one < other).sum())
    assert fewer > 20  # pairs of which the best planes were not looked for


def test_planes_that_are_not_the_best_keep_what_they_say(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = asked(fmopt.load(prism(tmp_path, regular(14, 10.0), regular(14, 10.1))), monkeypatch, 3.0)
    seen = 0
    for assembly, facing, course in calls[:: max(len(calls) // 20, 1)]:
        for n, planes in enumerate(choose_tightest(assembly, facing, course)):
            for (_, _, pair), plane in zip(facing.listed, planes, strict=True):
                if plane is not None and plane.witness.kind != "edges":
                    rows = course.over(counted_rows(assembly, pair, plane.witness).forms)
                    assert rows.lower[n].min() == pytest.approx(plane.margin, abs=1e-13)
                    assert rows.f[:, n].min() == pytest.approx(plane.clearance, abs=1e-13)
                    seen += 1
    assert seen > 200
