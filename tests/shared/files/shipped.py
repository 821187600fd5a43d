"""Shipped problem and model files as texts, and their operands exchanged."""

from __future__ import annotations

from tests import ROOT


def shipped(name: str) -> str:
    """The text of a shipped problem, its models found from anywhere."""
    return (ROOT / "problems" / f"{name}.toml").read_text(encoding="utf-8").replace("../models", str(ROOT / "models"))


def swapped(text: str) -> str:
    """The same task with the hollow part in the hand."""
    a, b, c = (text.index(table) for table in ("[moving]", "[fixed]", "[goal]"))
    return text[:a] + text[b:c].replace("fixed", "moving") + text[a:b].replace("[moving]", "[fixed]") + text[c:]
