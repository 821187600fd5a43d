"""The four-level tree of an object: object, feature classes, features, instances, [LeeHuang1985] section 3.

Solid features are prefixed + and hollow ones −; a feature's body is made of instances of convex primitives, joined by
regularised + and −. Bodies are held in the object's frame, so that no coordinate is moved there and back.

Solids as chains A₁ op₁ A₂ op₂ … Aₙ of named terms, op ∈ {+, −} regularised, [LeeHuang1985] appendix A.

A chain is evaluated from left to right. Not every CSG tree is one: A + (B − C) is B − C + A, but A − (B − C) is not
A − B + C, and such a term keeps its own tree as its body.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import groupby
from typing import Literal, TypeAlias

from fmopt.errors import GeometryError, TaskError
from fmopt.geometry.clearance import deepest
from fmopt.geometry.convex_pieces import material
from fmopt.geometry.csg import Difference, Moved, Primitive, Solid, Union, operands
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Value

UNIQUE = "names are unique"
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
    """The chain of a CSG tree; terms are called after it, taken-away ones `name`-cut-1 and so on."""
    match solid:
        case Moved(inner, pose):
            return moved_chain(chain_of(inner, name), pose)
        case Union(parts):
            return _numbered(parts, name)
        case Difference(base, tools):
            return without(chain_of(base, name), _numbered(tools, f"{name}-cut") if tools else ())
        case _:
            return (Term("+", name, solid),)


def _numbered(solids: Sequence[Solid], name: str) -> Chain:
    return reduce(joined, [chain_of(solid, f"{name}-{i}") for i, solid in enumerate(solids, 1)])


def chain_solid(chain: Iterable[Term]) -> Solid:
    """The CSG tree of a chain; what is taken away before anything was added takes nothing.

    Raises:
        GeometryError: nothing is added.
    """
    solid: Solid | None = None
    # One body for each run of a sign: the tree is no deeper than it has to be.
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
    """The solid moved by a pose, placements composed."""
    if not pose.vector().any():
        return solid  # the object itself, with what is remembered of it
    return Moved(solid.solid, pose.compose(solid.pose)) if isinstance(solid, Moved) else Moved(solid, pose)


def moved_chain(chain: Chain, pose: Pose) -> Chain:
    """Every term of the chain moved by a pose."""
    return tuple(replace(term, body=moved(term.body, pose)) for term in chain)


def joined(first: Chain, second: Chain) -> Chain:
    """A chain of the union of two chains in one frame, neither of them empty.

    One is put behind the other where what the second takes away spares the first; else its tree becomes one term.
    """
    for head, tail in ((first, second), (second, first)):
        if _spares(tail, head):
            return head + tail
    return (*first, Term("+", second[0].name, chain_solid(second)))


def without(base: Chain, tools: Chain) -> Chain:
    """A chain of `base` less the solid of `tools`, not empty: one term where it takes something away itself."""
    if all(term.sign == "+" for term in tools):
        return base + tuple(replace(term, sign="-") for term in tools)
    return (*base, Term("-", tools[0].name, chain_solid(tools)))


def _spares(tail: Chain, head: Chain) -> bool:
    """Whether nothing that `tail` takes away is in the solid of `head`."""
    cuts = [term for term in tail if term.sign == "-"]
    if not cuts:
        return True
    stock = material(chain_solid(head))
    return all(deepest(material(cut.body), stock) <= _TOUCH for cut in cuts)


@dataclass(frozen=True, eq=False)
class Instance(Value):
    """A leaf of the tree: a convex primitive at a pose in the object's frame, added or taken away."""

    sign: Sign
    primitive: Primitive
    pose: Pose

    @property
    def key(self) -> str:
        """Key name of the primitive solid."""
        return type(self.primitive).__name__.lower()


def instances(body: Solid) -> tuple[Instance, ...]:
    """The leaves of a CSG tree, from left to right."""
    found = operands(body, Pose.identity())
    return tuple(Instance("-" if taken % 2 else "+", primitive, pose) for primitive, pose, taken in found)


@dataclass(frozen=True, eq=False)
class TreeFeature(Value):
    """A feature: a body that the object has (+) or lacks (−), with its frame, both in the object's frame.

    Args:
        frame: with a length: z of a hollow feature out of the mouth, of a solid one from the leading end inwards.
        length: depth of a hole or length of a peg along z, m; None for a feature that only gives shape. Such a feature
            is never an operand.

    Raises:
        GeometryError: a length that is not positive, or a solid feature that is through.
    """

    name: str
    sign: Sign
    frame: Pose
    body: Solid
    length: float | None = None
    through: bool = False

    def __post_init__(self) -> None:
        if self.length is not None and not (math.isfinite(self.length) and self.length > 0.0):
            raise GeometryError(f"feature {self.name!r} has length {self.length} m", "make it positive")
        if self.sign == "+" and self.through:
            raise GeometryError(f"feature {self.name!r} is solid and cannot be through", "drop `through`")

    @property
    def hollow(self) -> bool:
        """Whether the feature is prefixed −."""
        return self.sign == "-"

    @property
    def instances(self) -> tuple[Instance, ...]:
        """The instances that the feature is made of."""
        return instances(self.body)


@dataclass(frozen=True, eq=False)
class FeatureClass(Value):
    """A feature classification of the second level, such as holes or cubes, with its features."""

    name: str
    features: tuple[TreeFeature, ...]


@dataclass(frozen=True, eq=False)
class ObjectTree(Value):
    """An object of the workcell.

    Args:
        frame: the object's frame in the global reference frame.
        order: names of all features in the order in which the object is combined from them, the first one solid.
            Not given: as the classes list them.

    Raises:
        TaskError: names that are not unique, or an order that is none.
    """

    name: str
    frame: Pose
    classes: tuple[FeatureClass, ...]
    order: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        names = [feature.name for group in self.classes for feature in group.features]
        for group in ([group.name for group in self.classes], names):
            if twice := [name for name in group if group.count(name) > 1]:
                raise TaskError(f"object {self.name!r} has {twice[0]!r} twice", twice[0], UNIQUE, "rename one")
        if not self.order:
            object.__setattr__(self, "order", tuple(names))
        if sorted(self.order) != sorted(names):
            wrong = sorted(set(self.order) ^ set(names)) or [name for name in self.order if self.order.count(name) > 1]
            message = f"the order of object {self.name!r} and its features differ in {', '.join(wrong)}"
            advice = "list the features of the object, each once"
            raise TaskError(message, wrong[0], "the order names every feature once", advice)
        if not names or self.feature(self.order[0]).hollow:
            message, name = f"object {self.name!r} does not begin with a solid feature", self.order[0] if names else ""
            raise TaskError(message, name, "an object begins with a solid feature", "put a feature prefixed + first")

    @property
    def features(self) -> tuple[TreeFeature, ...]:
        """The features in the order in which the object is combined from them."""
        return tuple(self.feature(name) for name in self.order)

    def feature(self, name: str) -> TreeFeature:
        """The feature of that name.

        Raises:
            TaskError: there is none.
        """
        found = {feature.name: feature for group in self.classes for feature in group.features}
        if name not in found:
            message = f"object {self.name!r} has no feature {name!r}"
            raise TaskError(message, name, "operands exist", f"its features: {', '.join(found)}")
        return found[name]

    @property
    def chain(self) -> Chain:
        """The object as the chain F₁ op₁ F₂ op₂ … of its features, in the object's frame."""
        return tuple(Term(feature.sign, feature.name, feature.body) for feature in self.features)

    @property
    def solid(self) -> Solid:
        """The solid of all features, in the object's frame."""
        return chain_solid(self.chain)

    def at(self, frame: Pose) -> "ObjectTree":
        """The object put elsewhere."""
        return replace(self, frame=frame)
