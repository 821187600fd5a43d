"""Kills at random moments: nothing acknowledged is lost, doubled or torn; and a naive store would not pass."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.shared.studies.kills import JOBS, LONGEST_BATCH, LostError, killed


@pytest.mark.wide
def test_fifty_kills_lose_nothing(tmp_path: Path) -> None:
    found = killed(tmp_path, 50, 1)
    assert found.total >= 50
    assert min(found.counts.values()) >= 5
    assert (
        found.begun - found.needed
        <= LONGEST_BATCH * JOBS * (found.counts["parent"] + found.counts["group"]) + (found.counts["worker"])
    )


@pytest.mark.wide
def test_a_naive_store_is_found_out_within_fifty_kills(tmp_path: Path) -> None:
    with pytest.raises(LostError, match=r"torn|lost|does not resume"):
        killed(tmp_path, 50, 1, "naive")
