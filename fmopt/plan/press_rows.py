"""Rows of the presses of a plan: room on the way, the state to reach, largest friction, errors; nothing proves them."""

from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass

from fmopt.plan.field_types import FORM, HalfWidths, Index, Label, Many, NonNegative, Number, Six

FREE_OF_JAMS = 2.0  # friction beyond which none is looked for

Friction = Annotated[float, Field(strict=True, ge=-1.0, le=10.0, allow_inf_nan=False)]


@dataclass(frozen=True, config=FORM)
class PressRows:
    """What holds of one press, to first order along its way without errors.

    Attributes:
        margin: room on the way for every error, m; None where nothing but what the press slides along is near.
        contacts: that hold the part where the wrench leads without friction; none where it is not held.
        rank: of the axes that give way and are held.
        least_force: of these contacts, for all friction up to the greatest of the problem, N; None where it has no
            bound.
        holds: friction up to which each of these contacts is pressed; None without contacts.
        largest_friction: up to which the part jams on none of the sets of contacts that errors can reach short of that
            state, −1 where it rests on one without any; None where the twist leads the part.
        jams_on: contacts of the set that jams next.
        escape: twist (6,) that escapes from that set up to this friction, m and rad.
        sets, left_out: how many sets were looked at, and were not.
        error: half-widths (6,) of the box about the errors that are left, m and rad.
    """

    margin: Number | None
    contacts: Many[Label]
    rank: Annotated[Index, Field(le=6)]
    least_force: Number | None
    holds: Friction | None
    largest_friction: Friction | None
    jams_on: Many[Label]
    escape: Six
    sets: Index
    left_out: Index
    error: HalfWidths


@dataclass(frozen=True, config=FORM)
class DepthRow:
    """The largest friction without a jam at a depth of the tip, m, and where it would be for a plane peg (Whitney)."""

    depth: NonNegative
    friction: Friction
    whitney: NonNegative


@dataclass(frozen=True, config=FORM)
class PlacedAttempt:
    """Rows of the presses of an attempt that its trial without errors came to, and of going down.

    Attributes:
        datum: number of the press, in the attempt, from which on the rows show that the part comes to its goal.
        shown_friction: up to which they do.
    """

    presses: Many[PressRows]
    depths: Many[DepthRow] = ()
    datum: Index | None = None
    shown_friction: Friction | None = None
