"""Changes for the worse to a plan, each of which the check must notice."""

import copy
import random
from collections.abc import Callable, Iterator
from typing import Any

from tests.shared.plans.table_plan import sealed

Plan = dict[str, Any]
STEP = 1e-9


def changed(plan: Plan, change: Callable[[Plan], None]) -> Plan:
    """A copy with a change, sealed again."""
    copied = copy.deepcopy(plan)
    change(copied)
    return sealed(copied)


def _put(plan: Plan, path: tuple[Any, ...], value: Any) -> Plan:
    def change(copied: Plan) -> None:
        place: Any = copied
        for key in path[:-1]:
            place = place[key]
        place[path[-1]] = value

    return changed(plan, change)


def _leaves(value: Any, path: tuple[Any, ...]) -> Iterator[tuple[tuple[Any, ...], float]]:
    if isinstance(value, dict):
        for key in sorted(value):
            yield from _leaves(value[key], (*path, key))
    elif isinstance(value, list):
        for k, item in enumerate(value):
            yield from _leaves(item, (*path, k))
    elif isinstance(value, float) and not isinstance(value, bool):
        yield path, value


def numbers(plan: Plan, count: int, seed: int = 1) -> Iterator[tuple[str, Plan]]:
    """Derived numbers of segments, up to `count` of each kind, each changed for the worse by 1e-9 of itself.

    Numbers so small that 1e-9 of them is less than the rounding of the double arithmetic that made them are left out.
    """
    kinds: dict[str, list[tuple[tuple[Any, ...], float, float]]] = {}
    for k, segment in enumerate(plan["segments"]):
        base = ("segments", k)
        for key in ("margin", "clearance"):
            kinds.setdefault(key, []).append(((*base, key), segment[key], 1.0))
        for key in ("theta_max", "offset_box", "angle_box"):
            for path, x in _leaves(segment["tube"][key], (*base, "tube", key)):
                if x > 1e-5:
                    kinds.setdefault(key, []).append((path, x, -1.0))
        for part in ("separations", "contacts"):
            for j, item in enumerate(segment[part]):
                kinds.setdefault(f"{part} margin", []).append(((*base, part, j, "margin"), item["margin"], 1.0))
        for j, item in enumerate(segment["contacts"]):
            if item["remainder"] > 1e-5:
                kinds.setdefault("remainder", []).append(((*base, "contacts", j, "remainder"), item["remainder"], -1.0))
            for path, x in _leaves(item["normal"], (*base, "contacts", j, "normal")):
                if abs(x) > 1e-4:
                    kinds.setdefault("normal", []).append((path, x, 1.0))
        for j, item in enumerate(segment["basis"]):
            for path, x in _leaves(item["direction"], (*base, "basis", j, "direction")):
                if abs(x) > 0.05:
                    kinds.setdefault("direction", []).append((path, x, 1.0))
        if "hybrid" in segment:
            for kind, path, x in _control(segment["hybrid"], (*base, "hybrid"), plan["uncertainty"]["rho"]):
                kinds.setdefault(kind, []).append((path, x, 1.0))
    pick = random.Random(seed)
    for kind, places in sorted(kinds.items()):
        for path, x, sign in pick.sample(places, min(count, len(places))):
            yield f"{kind} {path}", _put(plan, path, x + sign * STEP * abs(x))


def _control(hybrid: Any, base: tuple[Any, ...], rho: float) -> Iterator[tuple[str, tuple[Any, ...], float]]:
    """Numbers of a control strategy, as (kind, path, value), that stand out from zero in the metric of ρ."""
    twist, wrench = [1.0] * 3 + [rho] * 3, [1.0] * 3 + [1.0 / rho] * 3
    for key, scale, least in (
        ("position_axes", twist, 0.05),
        ("force_axes", wrench, 0.05),
        ("bias_wrench", wrench, 1.0),
    ):
        for path, x in _leaves(hybrid[key], (*base, key)):
            if abs(x * scale[path[-1]]) > least:
                yield key, path, x
    for path, x in _leaves(hybrid["velocity"], (*base, "velocity")):
        if abs(x * twist[path[-1]]) > 0.05:
            yield "velocity", path, x
    for path, x in _leaves(hybrid["termination"]["wrench"], (*base, "termination", "wrench")):
        if x:
            yield "termination wrench", path, x
    for key in ("threshold", "max_travel", "timeout"):
        yield key, (*base, "termination", key), hybrid["termination"][key]
    yield "speed", (*base, "speed"), hybrid["speed"]
    if hybrid["push"] > 1.0:
        yield "push", (*base, "push"), hybrid["push"]
    for j, item in enumerate(hybrid["normal_forces"]):
        if item["force"] > 1.0:
            yield "normal force", (*base, "normal_forces", j, "force"), item["force"]


def junk(plan: Plan, count: int, seed: int) -> Iterator[Plan]:
    """Copies with one value somewhere replaced by something else, sealed again where that is possible."""
    pick = random.Random(seed)
    values = [None, True, "", "x", -1, 0, 7, 1e308, -1e-308, 10**30, [], {}, [[]], [0.0] * 6, 0.5, 1e-3]
    for _ in range(count):
        copied = copy.deepcopy(plan)
        place: Any = copied
        while True:
            keys = sorted(place) if isinstance(place, dict) else range(len(place))
            key = pick.choice(list(keys))
            if not (isinstance(place[key], dict | list) and place[key]) or pick.random() < 0.1:
                break
            place = place[key]
        place[key] = pick.choice(values)
        yield sealed(copied)


def claims(plan: Plan) -> Iterator[tuple[str, Plan]]:
    """Changes of what is claimed: contacts, states, witnesses, order, identity."""
    last = len(plan["segments"]) - 1
    touching = [k for k, s in enumerate(plan["segments"]) if s["contacts"]]
    k = touching[-1]
    segment = plan["segments"][k]

    def at(change: Callable[[Any], Any], number: int = k) -> Plan:
        def on_segment(copied: Plan) -> None:
            change(copied["segments"][number])

        return changed(plan, on_segment)

    yield "contact dropped from the claims", at(lambda s: s["contacts"].pop())
    yield "contact dropped from the state", at(lambda s: s["state"].pop())
    yield "contact dropped from the goal state", at(lambda s: s["goal_state"].pop())
    yield "basis emptied", at(lambda s: s["basis"].clear())
    yield "normal swapped", at(lambda s: s["contacts"][0].update(normal=[-x for x in s["contacts"][0]["normal"]]))
    yield "role swapped", at(lambda s: s["contacts"][0].update(role="made"))
    wide = max(range(last + 1), key=lambda n: plan["segments"][n]["tube"]["theta_max"])
    yield "theta lowered", at(lambda s: s["tube"].update(theta_max=0.5 * s["tube"]["theta_max"]), wide)
    yield "theta raised", at(lambda s: s["tube"].update(theta_max=1.01 * s["tube"]["theta_max"]), wide)
    yield "separation missing", at(lambda s: s["separations"].pop())
    yield "separation twice", at(lambda s: s["separations"].append(s["separations"][-1]))
    yield "separations in another order", at(lambda s: s["separations"].reverse())
    yield "binding contact renamed", at(lambda s: s.update(binding_contact="pieces 7/7"))
    yield "progress cut", at(lambda s: s.update(progress=[s["progress"][0], 0.5 * sum(s["progress"])]))
    yield "move renumbered", at(lambda s: s.update(move=s["move"] + 1))
    yield "segment left out", changed(plan, lambda p: p["segments"].pop(k))
    yield "last segment left out", changed(plan, lambda p: p["segments"].pop(last))
    yield "first segment left out", changed(plan, lambda p: p["segments"].pop(0))
    yield "goal moved", changed(plan, lambda p: p["goal"].__setitem__(2, p["goal"][2] - 1e-9))
    yield "start pose moved", at(lambda s: s["start"].__setitem__(0, s["start"][0] + 1e-12))
    yield "goal pose moved", at(lambda s: s["goal"].__setitem__(2, s["goal"][2] - 1e-6))
    yield "start box widened", changed(plan, lambda p: p["uncertainty"]["start_box"].__setitem__(0, 4e-4))
    yield "velocity error raised", changed(plan, lambda p: p["uncertainty"].update(velocity_error=[0.011, 0.01]))
    yield "not covered shortened", changed(plan, lambda p: p["not_covered"].pop())
    if "hybrid" in segment:
        yield from _strategies(plan, at)
        yield "force axis left out", at(lambda s: s["hybrid"]["force_axes"].pop())
        yield "force axis turned", at(lambda s: s["hybrid"]["force_axes"][0].reverse())
        yield "velocity reversed", at(lambda s: s["hybrid"].update(velocity=[-x for x in s["hybrid"]["velocity"]]))
    for j, item in enumerate(segment["separations"]):
        if item["witness"]["kind"] == "fixed-face":
            n = len(plan["parts"]["fixed"]["pieces"][item["fixed_piece"]]["faces"])
            other = [
                f[0]
                for f in plan["parts"]["fixed"]["pieces"][item["fixed_piece"]]["faces"]
                if set(f[0]) != set(item["witness"]["fixed"])
            ]
            assert len(other) == n - 1

            def swap(s: Any, j: int = j, loop: list[int] = other[0]) -> None:
                s["separations"][j]["witness"]["fixed"] = loop

            yield f"witness {j} swapped", at(swap)


def _strategies(plan: Plan, at: Callable[..., Plan]) -> Iterator[tuple[str, Plan]]:
    """Control strategies that would lose a contact, not make one, or stop at the wrong moment."""
    pressing = next(k for k, s in enumerate(plan["segments"]) if s["hybrid"]["normal_forces"])
    making = next(k for k, s in enumerate(plan["segments"]) if s["hybrid"]["termination"]["contacts"])

    def on(change: Callable[[Any], Any], number: int) -> Plan:
        return at(lambda s: change(s["hybrid"]), number)

    def end(number: int, **values: Any) -> Plan:
        return on(lambda h: h["termination"].update(values), number)

    hybrid = plan["segments"][making]["hybrid"]
    stop = hybrid["termination"]
    yield "bias reversed", on(lambda h: h.update(bias_wrench=[-x for x in h["bias_wrench"]]), pressing)
    yield "bias zero", on(lambda h: h.update(bias_wrench=[0.0] * 6), pressing)
    yield "bias of another segment", on(lambda h: h.update(bias_wrench=hybrid["bias_wrench"]), pressing)
    yield "contact not pressed", on(lambda h: h["normal_forces"].pop(), pressing)
    yield "contact pulled", on(lambda h: h["normal_forces"][0].update(force=-1.0), pressing)
    yield "push backwards", on(lambda h: h.update(push=-h["push"]), making)
    yield "termination reversed", end(making, wrench=[-x for x in stop["wrench"]])
    yield "termination at nothing", end(making, contacts=[])
    yield "travel cut", end(making, max_travel=0.5 * stop["max_travel"])
    yield "time cut", end(making, timeout=0.5 * stop["timeout"])
    yield "threshold zero", end(making, threshold=0.0)
    yield "speed zero", on(lambda h: h.update(speed=0.0), making)
    yield "speed doubled", on(lambda h: h.update(speed=2.0 * h["speed"]), making)
    yield "frame moved", on(lambda h: h["frame"].__setitem__(0, h["frame"][0] + 1e-6), pressing)
    yield "frame turned", on(lambda h: h["frame"].__setitem__(3, h["frame"][3] + 1e-6), pressing)
    yield from _ranges(plan, on)
    exchanged = {"position_axes": hybrid["force_axes"], "force_axes": hybrid["position_axes"]}
    yield "axes exchanged", on(lambda h: h.update(exchanged), making)


def _ranges(plan: Plan, on: Callable[..., Plan]) -> Iterator[tuple[str, Plan]]:
    """Jam-free ranges that say more than their twists prove, or twists that prove nothing, where a plan has any."""
    ranged = [k for k, s in enumerate(plan["segments"]) if s["hybrid"].get("jam_free", {}).get("angle")]
    if not ranged:
        return
    free = ranged[0]
    bound = max(range(len(plan["segments"])), key=lambda k: _least_push(plan["segments"][k]))

    def put(number: int, **values: Any) -> Plan:
        return on(lambda h: h["jam_free"].update(values), number)

    stated = plan["segments"][free]["hybrid"]["jam_free"]
    turned = [[-x for x in twist] for twist in stated["twists"]]
    wider = [{**plane, "angles": [min(x * (1.0 + 1e-6), 3.14) for x in plane["angles"]]} for plane in stated["planes"]]
    yield "jam-free angle widened", put(free, angle=stated["angle"] * (1.0 + 1e-6))
    yield "jam-free planes widened", put(free, planes=wider)
    yield "jam-free plane of nothing", put(free, planes=[{"towards": "nothing", "angles": [0.0, 0.0]}])
    yield "jam-free push of another move", put(free, push=stated["push"] + 1.0)
    yield "jam-free twists turned", put(free, twists=turned)
    yield "jam-free twists zero", put(free, twists=[[0.0] * 6])
    yield "jam-free without twists", put(free, twists=[])
    least = plan["segments"][bound]["hybrid"]["jam_free"]["least_push"]
    yield "least push lowered", put(bound, least_push=least * (1.0 - 1e-6))


def _least_push(segment: Any) -> float:
    return segment["hybrid"].get("jam_free", {}).get("least_push") or 0.0
