"""What a plan tells of the search that its sequence of moves comes from, and how it is read."""

from __future__ import annotations

import re
from dataclasses import dataclass

from fmopt.verify.reading.reader import Fields, Reader, fields

_MOVE_NAME = re.compile(r"[+-]r?[xyz]|[a-z]{1,16}", re.ASCII)
_SEARCH = fields(
    "search",
    commentary="objective cost lower_bound gap states_expanded moves heading way",
    objects="states",
    optional=("states", "way"),
)
_STATE = fields("search.states[]", commentary="from moves contacts freedoms cost margin expanded")
SEARCH_FIELDS: tuple[Fields, ...] = (_SEARCH, _STATE)


@dataclass(frozen=True)
class SearchedState:
    """A contact state that the search came to.

    Attributes:
        origin: number of the state that it was come to from; None where a way to begin ends in it.
        moves: the freedoms of the moves from there.
        contacts: that are held in it.
        freedoms: that are taken away in it.
        cost: of the way to it; None where a margin on it is so short that no cost is told.
        margin: the least on it, m.
        expanded: whether moves were looked for from it.
    """

    origin: int | None
    moves: tuple[str, ...]
    contacts: tuple[str, ...]
    freedoms: int
    cost: float | None
    margin: float
    expanded: bool


@dataclass(frozen=True)
class Search:
    """How the sequence of moves was found.

    Attributes:
        objective: what its cost is made of.
        cost, lower_bound, gap: of the sequence, of any, and their difference.
        states_expanded: states looked at.
        moves: the freedom of each move, "approach" or an axis with its sign.
        heading: turn about z of the axes that moves go along and about, rad.
        states: all states that were come to, in that order, before the way to begin was varied and poses were placed.
        way: numbers of those that the sequence goes through.
    """

    objective: str
    cost: float
    lower_bound: float
    gap: float
    states_expanded: int
    moves: tuple[str, ...]
    heading: float
    states: tuple[SearchedState, ...] = ()
    way: tuple[int, ...] = ()


def read_search(place: Reader) -> Search:
    """How the sequence of moves was found."""
    place.only(_SEARCH)
    listed, way = place.maybe("states"), place.maybe("way")
    states = () if listed is None else tuple(_state(item, k) for k, item in enumerate(listed.items()))
    return Search(
        place.at("objective").text(),
        place.at("cost").number(),
        place.at("lower_bound").number(),
        place.at("gap").number(),
        place.at("states_expanded").integer(),
        _moves(place),
        place.at("heading").number(-4.0, 4.0),
        states,
        () if way is None else way.indices(len(states)),
    )


def _state(place: Reader, number: int) -> SearchedState:
    place.only(_STATE)
    origin, cost = place.filled("from"), place.filled("cost")
    return SearchedState(
        None if origin is None else origin.integer(number),
        _moves(place),
        tuple(item.label() for item in place.at("contacts").items()),
        place.at("freedoms").integer(7),
        None if cost is None else cost.number(),
        place.at("margin").number(),
        place.at("expanded").flag(),
    )


def _moves(place: Reader) -> tuple[str, ...]:
    return tuple(_move_name(item) for item in place.at("moves").items())


def _move_name(place: Reader) -> str:
    if _MOVE_NAME.fullmatch(place.text()) is None:
        raise place.fail("must be an axis with its sign, or a word")
    return str(place.value)
