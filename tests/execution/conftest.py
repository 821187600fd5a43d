"""The plan that tests of presses share."""

import pytest

from fmopt.plan import Plan, parsed
from tests.shared.plans.press_plan import press_plan_document


@pytest.fixture(scope="session")
def plan() -> Plan:
    return parsed(press_plan_document())
