"""Derives every number of an altered plan anew, so that nothing is wrong with it but what was altered.

The numbers come from the check's own derivation, as it compares them: where a plan states something else, what follows
is written in its place. Bounds of errors rest on themselves and are taken to their fixed point.
"""

import copy
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from fmopt.verify.arithmetic.rational import SLACK, ArithmeticRefusal, fixed, number
from fmopt.verify.certificate.chain import Broken, Chain, Stage
from fmopt.verify.certificate.claims import check_segment
from fmopt.verify.certificate.separating_plane import Known, WitnessError, apart
from fmopt.verify.control.recovery import check_recovery, lowest, underside
from fmopt.verify.control.strategy import check_strategy
from fmopt.verify.findings import Notes
from fmopt.verify.parts.assembly import PartPair
from fmopt.verify.reading.document import Segment, StatedContactClaim, StatedPlan, StatedSeparation, StatedWitness
from fmopt.verify.reading.parse import parse
from tests.shared.lies.restate_control import restated_axes, touching_names
from tests.shared.plans.table_plan import sealed

Document = dict[str, Any]
_ROUNDS = 40
_WEAKER = ("push", "stop", "none")
_FOLLOWS = re.compile(r"(?:entry (\d+) )?is stated as .*, but (?:follows as|up to) (\S+?)(?: follow)?$")


class Heard(Notes):
    """Notes that keep what the check derives, by what it says that it compares."""

    def __init__(self, segment: int | None) -> None:
        super().__init__(segment)
        self.values: dict[str, list[float]] = {}

    def equal(self, what: str, stated: Sequence[float], derived: Sequence[int], floor: float) -> None:
        self.values[what] = [number(x) for x in derived]
        super().equal(what, stated, derived, floor)

    def at_most(self, what: str, stated: float, derived: int) -> None:
        self.values[what] = [below(derived)]
        super().at_most(what, stated, derived)

    def at_least(self, what: str, stated: float, derived: int, allowance: int = 0) -> None:
        self.values[what] = [number(derived)]
        super().at_least(what, stated, derived, allowance)

    def about(self, what: str, stated: float, derived: int) -> None:
        self.values[what] = [below(derived)]
        super().about(what, stated, derived)


def below(x: int) -> float:
    """The greatest double that is not above a number in fixed point."""
    found = number(x)
    while fixed(found) > x:
        found = math.nextafter(found, -math.inf)
    return found


def restated(document: Document) -> Document:
    """The plan with every number that follows from others derived again, sealed.

    A plan whose parts the check refuses, or whose chain breaks, keeps its numbers from there on. The document is left
    as it is.

    Raises:
        PlanError: the alteration left no plan.
    """
    found: Document = copy.deepcopy(document)
    plan = parse(found)
    try:
        assembly = PartPair(plan)
    except ArithmeticRefusal:
        return sealed(found)
    if assembly.flaws:
        return sealed(found)
    stages = list(_motions(found, plan, assembly))
    if len(stages) == len(plan.segments):
        _strategies(found, assembly, stages)
        _recovery(found, parse(found), assembly)
    return sealed(found)


def _motions(document: Document, plan: StatedPlan, assembly: PartPair) -> Iterator[Stage]:
    """Restates the motions one after the other, as far as the chain holds."""
    chain = Chain(plan, assembly)
    for k, segment in enumerate(plan.segments):
        said = document["segments"][k]
        try:
            chain, stage = _settled(chain, segment, said)
            tube = stage.segment.tube
            said["tube"].update(theta_max=tube.theta, offset_box=list(tube.box), angle_box=list(tube.angles))
            stage = _witnessed(assembly, stage, said)
            notes = Heard(k)
            check_segment(assembly, stage, notes)
        except (Broken, ArithmeticRefusal):
            return
        _claims(said, stage, notes.values)
        yield stage


def _settled(chain: Chain, segment: Segment, said: Document) -> tuple[Chain, Stage]:
    """The segment followed with bounds of errors that are their own consequence; where the chain is then."""
    segment = replace(segment, basis=_basis(chain, segment, said), contacts=_listed(segment, said))
    for _ in range(_ROUNDS):
        trial = copy.copy(chain)
        trial._legs = list(chain._legs)
        stage = trial.follow(segment, notes := Heard(None))
        made = stage.made
        if made is not None:
            said["basis"][-1]["direction"] = notes.values[f"direction of {made.id}"]
        half = [number(x) for x in stage.motion.half]
        tube = segment.tube
        if all(abs(x - y) <= 1e-15 for x, y in zip((*tube.box, *tube.angles), half, strict=True)):
            break
        box, angles = (half[0], half[1], half[2]), (half[3], half[4], half[5])
        segment = replace(segment, tube=replace(tube, box=box, angles=angles, theta=math.hypot(*angles)))
    return trial, stage


def _basis(chain: Chain, segment: Segment, said: Document) -> tuple[tuple[str, Any, bool], ...]:
    """The basis with the directions that earlier moves left."""
    found = []
    for entry, (name, direction, made) in zip(said["basis"], segment.basis, strict=True):
        known = [d for touch, d in chain.link.basis if touch.id == name] or [d for _, d in chain.link.basis]
        if known and not made:
            stated = [[number(x) for x in d] for d in known]
            direction = tuple(min(stated, key=lambda d: math.dist(d, direction)))
            entry["direction"] = list(direction)
        found.append((name, direction, made))
    return tuple(found)


def _listed(segment: Segment, said: Document) -> tuple[StatedContactClaim, ...]:
    """The claims of the contacts that the check expects."""
    new = [i for i in segment.goal_state if i not in segment.state] if segment.progress[1] == 1.0 else []
    expected = [(i, "held") for i in segment.state] + [(i, "made") for i in new]
    if [(c["id"], c["role"]) for c in said["contacts"]] != expected:
        said["contacts"] = [
            {"id": i, "role": role, "normal": [0.0] * 6, "offset": 0.0, "remainder": 0.0, "margin": 0.0}
            for i, role in expected
        ]
    return tuple(StatedContactClaim(i, role, (0.0,) * 6, 0.0, 0.0, 0.0) for i, role in expected)


def _witnessed(assembly: PartPair, stage: Stage, said: Document) -> Stage:
    """The segment with other witnesses where its own prove nothing."""
    hinge = assembly.hinge(stage.made, stage.state) if stage.made is not None else None
    known = Known(stage.facts, stage.made, hinge, stage.leaving, stage.coming_off)
    kept = []
    for entry, stated in zip(said["separations"], stage.segment.separations, strict=True):
        best = _margin(assembly, stage, stated, known)
        if best <= 0:
            for witness in _others(assembly, stated):
                margin = _margin(assembly, stage, replace(stated, witness=witness), known)
                if margin > best:
                    best, stated = margin, replace(stated, witness=witness)
                    entry["witness"] = {"kind": witness.kind, "moving": [*witness.moving], "fixed": [*witness.fixed]}
        kept.append(stated)
    return replace(stage, segment=replace(stage.segment, separations=tuple(kept)))


def _margin(assembly: PartPair, stage: Stage, stated: StatedSeparation, known: Known) -> int:
    try:
        M, F = assembly.moving_pieces[stated.moving], assembly.fixed_pieces[stated.fixed]
        return apart(assembly, M, F, stated.witness, stage.motion, known).margin
    except (WitnessError, ArithmeticRefusal):
        return -(1 << 300)


def _others(assembly: PartPair, stated: StatedSeparation) -> Iterator[StatedWitness]:
    for face in assembly.fixed_pieces[stated.fixed].faces:
        yield StatedWitness("fixed-face", (), face.loops[0], (0.0, 0.0, 0.0), 0.0)
    for face in assembly.moving_pieces[stated.moving].faces:
        yield StatedWitness("moving-face", face.loops[0], (), (0.0, 0.0, 0.0), 0.0)


def _claims(said: Document, stage: Stage, values: dict[str, list[float]]) -> None:
    """Writes margins, clearance, contacts, binding and velocity as they were derived."""
    named: dict[str, float] = {}
    for item in said["separations"]:
        name = f"pieces {item['moving_piece']}/{item['fixed_piece']}"
        item["margin"] = named[name] = values.get(name, [item["margin"]])[0]
    for item in said["contacts"]:
        name = item["id"]
        item["margin"] = named[name] = values.get(f"margin of {name}", [item["margin"]])[0]
        item["normal"] = values.get(f"normal of {name}", item["normal"])
        for key in ("offset", "remainder"):
            item[key] = values.get(f"{key} of {name}", [item[key]])[0]
    for key in ("margin", "clearance"):
        said[key] = values.get(key, [said[key]])[0]
    tightest = min(named, key=lambda name: named[name], default="")
    early = stage.made is not None and (not named or said["margin"] < named[tightest])
    said["binding_contact"] = f"{stage.made.id} too early" if early and stage.made is not None else tightest
    if "hybrid" in said:
        said["hybrid"]["velocity"] = values.get("velocity", said["hybrid"]["velocity"])


def _strategies(document: Document, assembly: PartPair, stages: Sequence[Stage]) -> None:
    """Restates control strategies until the check has nothing more to say that can be put right."""
    for _ in range(5):
        plan, changed = parse(document), False
        for stage, segment, said in zip(stages, plan.segments, document["segments"], strict=True):
            notes = Heard(None)
            stage = replace(stage, segment=segment)
            check_strategy(assembly, stage, plan.rho, plan.velocity_error, plan.specification, notes)
            check_segment(assembly, stage, axes := Heard(None))
            notes.found += [f for f in axes.found if f.what == "hybrid"]
            changed |= _mended(said["hybrid"], notes, assembly, stage, plan.rho)
        if not changed:
            return


def _mended(hybrid: Document, notes: Notes, assembly: PartPair, stage: Stage, rho: float) -> bool:
    """Puts right what the check found wrong with a strategy; whether there was anything."""
    changed = False
    for finding in notes.found:
        told = _FOLLOWS.match(finding.message)
        place, key = (hybrid, finding.what) if "." not in finding.what else (None, finding.what)
        if told is not None:
            value, changed = float(told.group(2)), True
            if place is None:
                outer, key = key.split(".", 1)
                place = hybrid[outer]
            if "[" in key:
                key, index = key[:-1].split("[")
                place[key][int(index)] = value
            elif told.group(1) is not None:
                place[key][int(told.group(1))] = value
            else:
                place[key] = value
        elif finding.what.startswith("jam_free"):
            changed |= hybrid.pop("jam_free", None) is not None
        elif finding.what in ("frame", "position_axes", "force_axes", "hybrid"):
            restated_axes(hybrid, assembly, stage, rho)
            changed = True
        elif finding.what == "stays" and hybrid["stays"] != _WEAKER[-1]:
            hybrid["stays"], changed = _WEAKER[_WEAKER.index(hybrid["stays"]) + 1], True
        elif finding.what in ("normal_forces", "termination.contacts"):
            changed |= touching_names(hybrid, assembly, stage)
    return changed


def _recovery(document: Document, plan: StatedPlan, assembly: PartPair) -> None:
    """Restates the room of every move, and how high lifts begin."""
    recovery = document.get("recovery")
    if recovery is None:
        return
    recovery["covers"][2:] = list(plan.start_box[2:])
    lift = recovery["lift"]
    if lift is None:
        return
    lift["above"] = max(lift["above"], math.nextafter(number(underside(assembly.fixed)), math.inf))
    above = fixed(lift["above"])
    for entry in recovery["moves"]:
        pieces = [s for s in plan.segments if s.move == entry["move"]]
        if pieces:
            room = min(lowest(assembly.moving, s, plan.rho) for s in pieces) - above - SLACK
            entry["room"] = min(entry["room"], below(room))
            entry["back_off"] = entry["room"] > 0.0
    check_recovery(parse(document), (assembly.moving, assembly.fixed), notes := Heard(None))
    if notes.found:
        # A plan may go without.
        del document["recovery"]
