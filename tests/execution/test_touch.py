"""When a contact counts as felt: signals as seen at contacts, at rattling faces and at parts that friction holds."""

from typing import Any

import numpy as np
import pytest

from fmopt.execution.rig import Signal, contact_told
from fmopt.execution.robot import Robot
from fmopt.execution.trials import Trials, run
from fmopt.plan import parsed

FORCE, SURE = 4.0, 12.0  # N
FREE = Signal(*(np.array([value]) for value in (0.3, 0.2, 1.0, 1.0, 1.0)))


@pytest.mark.parametrize(
    ("change", "felt"),
    [
        ({}, False),
        ({"sensed": 13.0, "slowly": 5.0, "brisk": 0.6, "pace": 0.8}, True),  # stopped dead
        ({"sensed": 16.0, "slowly": 7.0, "brisk": 0.8, "pace": 0.9}, False),  # a rattle
        ({"sensed": 11.0, "slowly": 9.0, "brisk": 1.0, "pace": 1.0}, True),  # the part pivots about it
        ({"sensed": 5.0, "slowly": 4.5, "brisk": 0.3, "pace": 0.5}, True),  # braked
        ({"sensed": 5.0, "slowly": 4.5, "brisk": 0.9, "pace": 0.9}, False),  # friction that grows
        ({"sensed": 2.5, "slowly": 2.2, "brisk": 0.0, "pace": 0.05, "effort": 3.5}, True),  # stands, though pushed
        ({"sensed": 2.5, "slowly": 2.2, "brisk": 0.0, "pace": 0.05, "effort": 1.5}, False),  # held by friction, yet
        ({"sensed": 1.0, "slowly": 0.9, "brisk": 0.0, "pace": 0.05, "effort": 3.5}, False),  # hardly a force
    ],
)
def test_what_counts_as_a_contact(change: dict[str, float], felt: bool) -> None:
    signal = FREE._replace(**{name: np.array([value]) for name, value in change.items()})
    assert contact_told(signal, np.array([FORCE]), np.array([SURE]), Robot()).tolist() == [felt]


def test_a_last_contact_that_the_part_pivots_about_is_felt(square_peg_plan: dict[str, Any]) -> None:
    """Trials in which the part once slipped past the wall that was to end its turn upright, and their neighbours."""
    records = run(parsed(square_peg_plan), Trials(100, seed=2211, recovery=False), [3, 4, 5, 64, 65, 66])
    assert all(record["success"] and not record["departures"] for record in records)
