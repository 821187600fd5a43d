"""From the chain of a model's solids and its mating features to the object tree.

A mating feature is made of the terms of its sign that it names, or through which its axis runs; what no mating feature
is made of becomes a feature of its own, which gives shape and takes no part in tasks. A body that two mating features
share is listed for each: A + A = A.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, count

from fmopt.errors import TaskError
from fmopt.geometry.csg import Solid, Union
from fmopt.geometry.mating_features import Feature as MatingFeature
from fmopt.spatial.se3 import Pose
from fmopt.task.object_model.axis import length, on_axis
from fmopt.task.object_model.tree import Chain, FeatureClass, ObjectTree, Sign, Term, TreeFeature, instances, moved

MADE = "a feature is made of instances of its own sign"
_HOLES, _PEGS = "holes", "pegs"
_PLURALS = {"box": "boxes", "body": "bodies"}


@dataclass(frozen=True)
class FeatureClaim:
    """What a model file says of a mating feature beyond its frame."""

    classification: str = ""  # name of its feature class; "" for holes or pegs, by its kind
    terms: tuple[str, ...] = ()  # names of the terms that it is made of; none to have them found on its axis


def object_tree(
    name: str, terms: Chain, mating: Sequence[MatingFeature], claims: Mapping[str, FeatureClaim]
) -> ObjectTree:
    """The tree of an object from its solids and its mating features, its frame the global reference frame.

    Raises:
        TaskError: a mating feature that no term makes up, or that does not own one it names.
    """
    left = list(terms)
    made: dict[int, tuple[str, TreeFeature]] = {}
    bodies: dict[int, tuple[Solid, ...]] = {}
    for feature in mating:
        claim = claims.get(feature.name, FeatureClaim())
        sign: Sign = "-" if feature.kind == "hollow" else "+"
        owned = _named(left, claim.terms, feature.name, sign) if claim.terms else _found(left, feature)
        # What features share counts once: bodies of bodies would double from each to the next.
        shared = tuple({id(one): one for t in owned for one in bodies.get(id(t), (t.body,))}.values())
        term = Term(sign, feature.name, shared[0] if len(shared) == 1 else Union(shared))
        left.insert(left.index(owned[0]), term)
        # A mating feature that this one is made of stays one: both have its body.
        left = [other for other in left if other not in owned or id(other) in made]
        group = claim.classification or (_HOLES if sign == "-" else _PEGS)
        whole = TreeFeature(feature.name, sign, feature.frame, term.body, feature.length, feature.through)
        made[id(term)], bodies[id(term)] = (group, whole), shared
    used = {feature.name for _, feature in made.values()}
    nodes = [made[id(term)] if id(term) in made else _bulk(term, used) for term in left]
    groups = dict.fromkeys(group for group, _ in nodes)
    classes = tuple(FeatureClass(name, tuple(f for group, f in nodes if group == name)) for name in groups)
    return ObjectTree(name, Pose.identity(), classes, tuple(feature.name for _, feature in nodes))


def _named(left: Sequence[Term], names: Sequence[str], feature: str, sign: Sign) -> list[Term]:
    owned = []
    for name in names:
        found = [term for term in left if term.name == name and term.sign == sign]
        if not found:
            free = ", ".join(term.name for term in left if term.sign == sign) or "none"
            message = f"feature {feature!r} names {name!r}, which is no term prefixed {sign} that is left"
            raise TaskError(message, feature, MADE, f"such terms: {free}")
        owned += found
    owned = [term for term in left if term in owned]
    # Nothing of the other sign may stand between them, so that they can be taken together.
    if strange := [term for term in left[left.index(owned[0]) : left.index(owned[-1])] if term.sign != sign]:
        message = f"feature {feature!r} is made of terms with {strange[0].name!r}, of the other sign, between them"
        raise TaskError(message, feature, MADE, "name them one after the other in the model, or make two features")
    return owned


def is_made(terms: Sequence[Term], feature: MatingFeature) -> bool:
    """Whether the feature's axis runs through a term of its sign, in the same frame, over some of its length."""
    return max(_shares(terms, feature).values(), default=0.0) > 0.0


def _shares(terms: Sequence[Term], feature: MatingFeature) -> dict[int, float]:
    """For each term of the feature's sign, by its number, the length in m of the feature's axis inside it."""
    hollow = feature.kind == "hollow"
    low, high = (-feature.length, 0.0) if hollow else (0.0, feature.length)
    into = feature.frame.inverse()
    own = [(number, term.body) for number, term in enumerate(terms) if (term.sign == "-") == hollow]
    return {number: length(on_axis(moved(body, into)), low, high) for number, body in own}


def _found(left: Sequence[Term], feature: MatingFeature) -> list[Term]:
    """The terms of the feature's sign through which its axis runs over its length, neighbours of the longest one."""
    if not is_made(left, feature):
        sign = "-" if feature.kind == "hollow" else "+"
        message = f"the z axis of feature {feature.name!r} runs through nothing that is prefixed {sign}"
        advice = "check the feature's frame, or model its shape as a solid of its own"
        raise TaskError(message, feature.name, MADE, advice)
    share = _shares(left, feature)
    first = last = max(share, key=lambda number: share[number])
    while share.get(first - 1, 0.0) > 0.0:  # terms of the other sign have none
        first -= 1
    while share.get(last + 1, 0.0) > 0.0:
        last += 1
    return list(left[first : last + 1])


def _bulk(term: Term, used: set[str]) -> tuple[str, TreeFeature]:
    """A feature that gives shape only, with its class; its frame is that of its first instance.

    Its name is added to those in use, with a number when another feature has it.
    """
    leaves = instances(term.body)
    kinds = {leaf.key for leaf in leaves}
    kind = kinds.pop() if len(kinds) == 1 else "body"
    name = next(name for name in chain([term.name], (f"{term.name}-{i}" for i in count(2))) if name not in used)
    used.add(name)
    group = _PLURALS.get(kind, f"{kind}s")
    return (group if term.sign == "+" else f"cut {group}"), TreeFeature(name, term.sign, leaves[0].pose, term.body)
