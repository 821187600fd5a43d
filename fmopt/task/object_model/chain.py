"""Solids as chains A₁ op₁ A₂ op₂ … Aₙ of named terms, op ∈ {+, −} regularised, [LeeHuang1985] appendix A.

A chain is evaluated from left to right. Not every CSG tree is one: A + (B − C) is B − C + A, but A − (B − C) is not
A − B + C, and such a term keeps its own tree as its body.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Literal, TypeAlias

from fmopt.errors import GeometryError
from fmopt.geometry.clearance import deepest
from fmopt.geometry.convex_pieces import pieces
from fmopt.geometry.csg import Difference, Placed, Solid, Union
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Value

Sign: TypeAlias = Literal["+", "-"]
_TOUCH = 1e-9  # m


@dataclass(frozen=True, eq=False)
class Term(Value):
    """A body that a chain adds (+) or takes away (−), in the frame of the chain."""

    sign: Sign
    name: str
    body: Solid


Chain: TypeAlias = tuple[Term, ...]


def chain_of(solid: Solid, name: str) -> Chain:
    """The chain of a CSG tree; terms are called after it, taken-away ones `name`-cut-1 and so on.

    Args:
        solid: any tree of it.
        name: what its one term is called, or its terms begin with.
    """
    match solid:
        case Placed(inner, pose):
            return moved_chain(chain_of(inner, name), pose)
        case Union(parts):
            return _numbered([(part, f"{name}-{i}") for i, part in enumerate(parts, 1)])
        case Difference(base, tools):
            cuts = _numbered([(tool, f"{name}-cut-{i}") for i, tool in enumerate(tools, 1)]) if tools else ()
            return without(chain_of(base, name), cuts)
        case _:
            return (Term("+", name, solid),)


def _numbered(parts: list[tuple[Solid, str]]) -> Chain:
    first, *others = (chain_of(part, name) for part, name in parts)
    for other in others:
        first = joined(first, other)
    return first


def chain_solid(chain: Iterable[Term]) -> Solid:
    """The CSG tree of a chain; what is taken away before anything was added takes nothing.

    Raises:
        GeometryError: nothing is added.
    """
    solid: Solid | None = None
    for sign, run in groupby(chain, key=lambda term: term.sign):
        bodies = tuple(term.body for term in run)
        if sign == "+":
            added = bodies if solid is None else (solid, *bodies)
            solid = added[0] if len(added) == 1 else Union(added)
        elif solid is not None:
            solid = Difference(solid, bodies)
    if solid is None:
        raise GeometryError("a chain without solid terms is empty", "prefix at least one feature with +")
    return solid


def moved(solid: Solid, pose: Pose) -> Solid:
    """The solid moved by a pose, placements composed.

    Args:
        solid: in any frame.
        pose: takes a point x of it to pose.apply(x).
    """
    if not pose.vector().any():
        return solid
    if isinstance(solid, Placed):
        return Placed(solid.solid, pose.compose(solid.pose))
    return Placed(solid, pose)


def moved_chain(chain: Chain, pose: Pose) -> Chain:
    """Every term of the chain moved by a pose.

    Args:
        chain, pose: as for `moved`.
    """
    return tuple(replace(term, body=moved(term.body, pose)) for term in chain)


def joined(first: Chain, second: Chain) -> Chain:
    """A chain of the union of two chains.

    One is put behind the other where what the second takes away spares the first; else its tree becomes one term.

    Args:
        first, second: in one frame, neither empty.
    """
    for head, tail in ((first, second), (second, first)):
        if _spares(tail, head):
            return head + tail
    return (*first, Term("+", second[0].name, chain_solid(second)))


def without(base: Chain, tools: Chain) -> Chain:
    """A chain of `base` less the solid of `tools`, which becomes one term when it takes something away itself.

    Args:
        base: not empty.
        tools: in the same frame, not empty.
    """
    if all(term.sign == "+" for term in tools):
        return base + tuple(replace(term, sign="-") for term in tools)
    return (*base, Term("-", tools[0].name, chain_solid(tools)))


def _spares(tail: Chain, head: Chain) -> bool:
    """Whether nothing that `tail` takes away is in the solid of `head`."""
    cuts = [term for term in tail if term.sign == "-"]
    if not cuts:
        return True
    material = pieces(chain_solid(head))
    return all(deepest(pieces(cut.body), material) <= _TOUCH for cut in cuts)
