"""Advice on the features of model files, followed: where they are and what they are made of."""

from __future__ import annotations

from tests.shared.files.advice.case import Case
from tests.shared.files.advice.edits import edited, model
from tests.shared.files.advice.models import BAR, ON_IT, PROFILE, WHOLE, of_stl


def hole(at: str, more: str = "length = 30", solids: str = WHOLE) -> str:
    """A block with the feature of its pocket stated."""
    return f'{solids}[features.hole]\nkind = "hollow"\n{at}\n{more}'


def peg(at: str, more: str = "") -> str:
    """A bar with the feature of its end stated."""
    return f'{BAR}[features.peg]\nkind = "solid"\nat = {at}\nlength = 50\n{more}'


def rod_end(at: str) -> str:
    """The unit of a mesh, and the feature of its end."""
    return f'unit = "mm"\n[features.peg]\nkind = "solid"\nat = {at}\nlength = 30'


CHECK = "check the feature's frame"
OWN = '[solids.slit]\nshape = "box"\nsize = [5, 5, 40]\nat = [25, 0, 10]'
CUTS = """[solids.whole]
shape = "box"
size = [60, 60, 40]
[solids.one]
shape = "box"
size = [20, 20, 20]
at = [0, 0, 25]
[solids.lid]
shape = "box"
size = [60, 60, 5]
at = [0, 0, -5]
[solids.other]
shape = "box"
size = [20, 20, 20]
at = [0, 0, 10]
[features.hole]
kind = "hollow"
at = [0, 0, 40]
"""
ONE, BOTH, OTHER = "length = 15\nsolids = ['one']\n", "length = 30\nsolids = ['one', 'other']\n", "solids = ['other']\n"
MORE = f'{ONE}[features.more]\nkind = "hollow"\nat = [0, 0, 30]\nlength = 20\n{OTHER}'
IN_TURN = f"""part = "block"
[solids.block]
shape = "difference"
of = "filled"
minus = ["other"]
[solids.filled]
shape = "union"
of = ["cut", "lid"]
[solids.cut]
shape = "difference"
of = "whole"
minus = ["one"]
{CUTS}"""
AT_ONCE = f"""part = "block"
[solids.block]
shape = "difference"
of = "filled"
minus = ["one", "other"]
[solids.filled]
shape = "union"
of = ["whole", "lid"]
{CUTS}"""


def of_solids(name: str) -> str:
    """A block with a feature that is made of a named solid."""
    return hole("at = [0, 0, 40]", f'length = 30\nsolids = ["{name}"]')


CASES: tuple[Case, ...] = (
    edited(
        "in the material",
        f"{CHECK}, or model its shape as a solid of its own",
        model,
        hole("at = [25, 0, 40]"),
        hole("at = [0, 0, 40]"),
        hole("at = [25, 0, 40]", f"length = 30\n{OWN}", WHOLE.replace('["pocket"]', '["pocket", "slit"]')),
    ),
    edited("beside a mesh", CHECK, of_stl, rod_end("[30, 0, 0]"), rod_end("[0, 0, 0]")),
    edited("a peg through", "remove 'through'", model, peg("[0, 0, 0]", "through = true"), peg("[0, 0, 0]")),
    edited("made of nothing", "solids: block, whole, pocket", model, of_solids("slit"), of_solids("pocket")),
    edited("made of a name misspelt", "did you mean 'pocket'?", model, of_solids("pockt"), of_solids("pocket")),
    edited("solids of a mesh", "leave 'solids' out", model, f'{PROFILE}{ON_IT}solids = ["peg"]', f"{PROFILE}{ON_IT}"),
    edited("made of the other sign", "such terms: pocket", model, of_solids("whole"), of_solids("pocket")),
    edited(
        "not one after the other",
        "name them one after the other in the model, or make two features",
        model,
        f"{IN_TURN}{BOTH}",
        f"{AT_ONCE}{BOTH}",
        f"{IN_TURN}{MORE}",
    ),
)
