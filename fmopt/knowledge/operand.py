"""Operands: a feature with its direct neighbours in the trees and across the links, [LeeHuang1985] section 3."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fmopt.geometry.csg import Solid, Union
from fmopt.knowledge.chain import moved
from fmopt.knowledge.tree import Feature
from fmopt.knowledge.workcell import Ref, Workcell
from fmopt.se3 import Pose
from fmopt.values import Value


@dataclass(frozen=True, eq=False)
class Operand(Value):
    """One side of an answer.

    Args:
        ref: the feature-operand.
        feature: the same, as the object's tree has it.
        members: the feature-operand and its direct neighbours in the trees and across the links.
        solid: their solid, in the feature-operand's frame.
        whole: the solid of all objects of this side with all their features, in the same frame.
        frame: of the feature-operand in the global reference frame at the start, H_ow.
    """

    ref: Ref
    feature: Feature
    members: tuple[Ref, ...]
    solid: Solid
    whole: Solid
    frame: Pose


def operand_of(workcell: Workcell, ref: Ref, group: tuple[str, ...], frame: Pose) -> Operand:
    """The operand of a feature.

    Args:
        workcell: where it is.
        ref: the feature-operand.
        group: the objects of its side, as they are linked.
        frame: of the operand in the global reference frame.
    """
    feature = workcell.object(ref.object).feature(ref.feature)
    others = frozenset(tree.name for tree in workcell.objects) - set(group)
    members = workcell.operand(ref, others)
    if not feature.hollow:
        # The moving operand keeps its solid neighbours only, [LeeHuang1985] appendix B: its operators are all +.
        members = tuple(r for r in members if not workcell.object(r.object).feature(r.feature).hollow)
    all_of = {name: frozenset(workcell.object(name).order) for name in group}
    some_of = {r.object: frozenset(m.feature for m in members if m.object == r.object) for r in members}
    whole = _together(workcell, all_of, frame.inverse())
    solid = whole if list(some_of.items()) == list(all_of.items()) else _together(workcell, some_of, frame.inverse())
    return Operand(ref, feature, members, solid, whole, frame)


def _together(workcell: Workcell, features: Mapping[str, frozenset[str]], into: Pose) -> Solid:
    """The solid of some features of some objects, in the frame that `into` leads to; no material, no object."""
    parts = [(workcell.object(name), names) for name, names in features.items()]
    solids = tuple(
        moved(tree.solid_of(names), into.compose(tree.frame))
        for tree, names in parts
        if any(not tree.feature(name).hollow for name in names)
    )
    return solids[0] if len(solids) == 1 else Union(solids)
