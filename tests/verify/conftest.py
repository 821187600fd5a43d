"""What tests of the check share: a peg in a pocket, of which contacts are to be held."""

import pytest

from fmopt.verify.parts.assembly import PartPair
from tests.shared.parts.held import assembled


@pytest.fixture
def assembly() -> PartPair:
    return assembled()
