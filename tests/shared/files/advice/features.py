"""Advice on the features of model files, followed: where they are and what they are made of."""

from __future__ import annotations

from tests.shared.files.advice.case import Case
from tests.shared.files.advice.edits import edited, model
from tests.shared.files.advice.models import BAR, ON_IT, PROFILE, WHOLE, of_stl
from tests.shared.files.model_text import cuboid, difference, part, union


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
OWN = cuboid("slit", "5, 5, 40", "25, 0, 10")
CUTS = (
    cuboid("whole", "60, 60, 40"),
    cuboid("one", "20, 20, 20", "0, 0, 25"),
    cuboid("lid", "60, 60, 5", "0, 0, -5"),
    cuboid("other", "20, 20, 20", "0, 0, 10"),
    '[features.hole]\nkind = "hollow"\nat = [0, 0, 40]\n',
)
ONE, BOTH, OTHER = "length = 15\nsolids = ['one']\n", "length = 30\nsolids = ['one', 'other']\n", "solids = ['other']\n"
MORE = f'{ONE}[features.more]\nkind = "hollow"\nat = [0, 0, 30]\nlength = 20\n{OTHER}'
IN_TURN = part(
    "block",
    difference("block", "filled", "other"),
    union("filled", "cut", "lid"),
    difference("cut", "whole", "one"),
    *CUTS,
)
AT_ONCE = part("block", difference("block", "filled", "one", "other"), union("filled", "whole", "lid"), *CUTS)


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
