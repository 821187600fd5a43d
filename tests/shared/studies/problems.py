"""Problems that studies in tests are made of."""

import re
from pathlib import Path

from tests import ROOT


def straight(folder: Path) -> Path:
    """The rectangular fit with errors so small that the peg goes straight in, which is planned in a second."""
    text = (ROOT / "problems" / "factory_rect_8mm_tight_300um.toml").read_text(encoding="utf-8")
    changes = {r"\.\./models": f"{ROOT}/models", r"^([xy]) = 0\.3$": r"\1 = 0.01", r"^(r[xyz]) = .*$": r"\1 = 0.03"}
    for old, new in {**changes, r"^(translation|rotation) = .*$": r"\1 = 0.0005"}.items():
        text, count = re.subn(old, new, text, flags=re.MULTILINE)
        assert count >= 2
    path = folder / "base.toml"
    path.write_text(text, encoding="utf-8")
    return path
