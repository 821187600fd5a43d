"""The workcell as a graph: objects and their features, linked by lower pairs, [LeeHuang1985] section 3.

Operands: a feature with its direct neighbours in the trees and across the links, [LeeHuang1985] section 3.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from fmopt.errors import TaskError
from fmopt.geometry.clearance import deepest
from fmopt.geometry.convex_pieces import pieces
from fmopt.geometry.csg import Difference, Solid, Union
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Value
from fmopt.task.object_model.tree import UNIQUE, ObjectTree, TreeFeature, chain_solid, moved

LowerPair: TypeAlias = Literal["cylindrical", "prismatic", "planar", "screw", "spherical", "revolute"]
LinkKind: TypeAlias = Literal["cylindrical", "prismatic", "planar", "screw", "spherical", "revolute", "attached"]

EXIST = "operands exist"
_TOUCH = 1e-9  # m


@dataclass(frozen=True)
class Ref:
    """A node of the graph: a feature of an object, or the object itself when `feature` is empty."""

    object: str
    feature: str = ""

    def __str__(self) -> str:
        return f"{self.object}.{self.feature}" if self.feature else self.object


@dataclass(frozen=True)
class Link:
    """An edge of the graph: the lower pair that joins two nodes, or "attached" for a rigid joint."""

    kind: LinkKind
    one: Ref
    other: Ref


@dataclass(frozen=True, eq=False)
class Workcell(Value):
    """All objects present, and the links between them or their features.

    Raises:
        TaskError: objects of one name, or a link to what is not there, to the same object, or given twice.
    """

    objects: tuple[ObjectTree, ...]
    links: tuple[Link, ...] = ()

    def __post_init__(self) -> None:
        names = [tree.name for tree in self.objects]
        if twice := [name for name in names if names.count(name) > 1]:
            raise TaskError(f"the workcell has two objects {twice[0]!r}", twice[0], UNIQUE, "rename one")
        pairs: set[frozenset[Ref]] = set()
        for link in self.links:
            self.resolve(link.one)
            self.resolve(link.other)
            pair = frozenset({link.one, link.other})
            if link.one.object == link.other.object or pair in pairs:
                message = f"the link of {link.one} and {link.other} joins an object to itself, or is there twice"
                raise TaskError(message, str(link.one), "a link joins two objects, once", "remove it")
            pairs.add(pair)

    def object(self, name: str) -> ObjectTree:
        """The object of that name.

        Raises:
            TaskError: there is none.
        """
        for tree in self.objects:
            if tree.name == name:
                return tree
        known = ", ".join(tree.name for tree in self.objects) or "none"
        raise TaskError(f"the workcell has no object {name!r}", name, EXIST, f"its objects: {known}")

    def resolve(self, ref: Ref) -> tuple[ObjectTree, TreeFeature | None]:
        """The object and feature of a node.

        Raises:
            TaskError: it is not there.
        """
        tree = self.object(ref.object)
        return tree, tree.feature(ref.feature) if ref.feature else None

    def frame(self, ref: Ref) -> Pose:
        """The frame of an object, or of its feature, in the global reference frame."""
        tree, feature = self.resolve(ref)
        return tree.frame if feature is None else tree.frame.compose(feature.frame)

    def connect(self, link: Link) -> "Workcell":
        """The workcell with one more link; a link of the same two nodes is replaced."""
        kept = tuple(old for old in self.links if {old.one, old.other} != {link.one, link.other})
        return replace(self, links=(*kept, link))

    def moved(self, names: Collection[str], move: Pose) -> "Workcell":
        """The workcell with the objects of some names moved: a global point at x goes to move.apply(x)."""
        there = (tree.at(move.compose(tree.frame)) if tree.name in names else tree for tree in self.objects)
        return replace(self, objects=tuple(there))

    def group(self, name: str, apart_from: str = "") -> tuple[str, ...]:
        """The objects that are linked to one, directly or through others, itself first."""
        self.object(name)
        found = [name]
        for reached in found:  # grows as it is walked
            for link in self.links:
                ends = (link.one.object, link.other.object)
                if reached in ends and set(ends) != {name, apart_from}:
                    found += [end for end in ends if end not in found]
        return tuple(found)

    def _across(self, ref: Ref) -> list[Ref]:
        ends = [pair for link in self.links for pair in ((link.one, link.other), (link.other, link.one))]
        return [far for near, far in ends if near.object == ref.object and near.feature in ("", ref.feature)]

    def operand(self, ref: Ref, apart_from: frozenset[str] = frozenset()) -> tuple[Ref, ...]:
        """The features of an operand: the feature-operand, those of its object that it touches, and across every link
        of one of these the linked feature with those that it touches in its own object.
        """
        own = (ref, *_touching(self.object(ref.object), ref.feature))
        found = list(own)
        for far in (far for near in own for far in self._across(near)):
            if far.object not in apart_from and far.object != ref.object:
                tree = self.object(far.object)
                names = [far.feature, *(near.feature for near in _touching(tree, far.feature))]
                found += [Ref(far.object, n) for n in (names if far.feature else tree.order)]
        return tuple(dict.fromkeys(found))


def _touching(tree: ObjectTree, name: str) -> tuple[Ref, ...]:
    """The other features of an object whose bodies overlap or touch that of one."""
    if not name:
        return ()
    body = tree.feature(name).body
    return tuple(Ref(tree.name, f.name) for f in tree.features if f.name != name and _touch(body, f.body))


def _touch(one: Solid, other: Solid) -> bool:
    # A body touches what is left of it, which may be in very many pieces.
    if any(isinstance(a, Difference) and a.base == b for a, b in ((one, other), (other, one))):
        return True
    return deepest(pieces(one), pieces(other)) >= -_TOUCH


@dataclass(frozen=True, eq=False)
class AnswerSide(Value):
    """One side of an answer.

    Args:
        solid: their solid, in the feature-operand's frame.
        true: the same less what takes away from it next to the feature-operand: filled in, a part that is not convex
            would not go into its hole.
        whole: the solid of all objects of this side with all their features, in the same frame.
        frame: of the feature-operand in the global reference frame at the start, H_ow.
    """

    ref: Ref
    feature: TreeFeature
    members: tuple[Ref, ...]
    solid: Solid
    true: Solid
    whole: Solid
    frame: Pose


def operand_of(workcell: Workcell, ref: Ref, group: tuple[str, ...], frame: Pose) -> AnswerSide:
    """The operand of a feature, whose frame is given in the global reference frame."""
    feature = workcell.object(ref.object).feature(ref.feature)
    around = members = workcell.operand(ref, frozenset(tree.name for tree in workcell.objects) - set(group))
    if not feature.hollow:
        # The moving operand keeps its solid neighbours only, [LeeHuang1985] appendix B: its operators are all +.
        members = tuple(r for r in members if not workcell.object(r.object).feature(r.feature).hollow)
    all_of = {name: frozenset(workcell.object(name).order) for name in group}
    some_of = {r.object: frozenset(m.feature for m in members if m.object == r.object) for r in members}
    true_of = {r.object: frozenset(m.feature for m in around if m.object == r.object) for r in members}
    into = frame.inverse()
    whole = _together(workcell, all_of, into)
    # One object where solids are the same, so that its pieces are found once.
    solid = whole if list(some_of.items()) == list(all_of.items()) else _together(workcell, some_of, into)
    true = solid if true_of == some_of else whole if true_of == all_of else _together(workcell, true_of, into)
    return AnswerSide(ref, feature, members, solid, true, whole, frame)


def _together(workcell: Workcell, features: Mapping[str, frozenset[str]], into: Pose) -> Solid:
    """The solid of some features of some objects, in the frame that `into` leads to; no material, no object."""
    parts = [(workcell.object(name), names) for name, names in features.items()]
    solids = tuple(
        moved(chain_solid(term for term in tree.chain if term.name in names), into.compose(tree.frame))
        for tree, names in parts
        if any(not tree.feature(name).hollow for name in names)
    )
    return solids[0] if len(solids) == 1 else Union(solids)
