"""Tests, in folders named after the rooms of the package: the house itself in `house`, what they share in `shared`."""

from pathlib import Path

ROOT = Path(__file__).parent.parent
PROBLEMS = ROOT / "problems"
