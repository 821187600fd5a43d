"""Changes for the worse to a plan, each of which the check must notice."""

from __future__ import annotations

import copy
import random
from collections.abc import Callable, Iterator
from typing import Any

from table_plan import sealed

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
        for key in ("theta_max", "offset_max"):
            kinds.setdefault(key, []).append(((*base, "tube", key), segment["tube"][key], -1.0))
        for path, x in _leaves(segment["tube"]["offset_box"], (*base, "tube", "offset_box")):
            kinds.setdefault("offset_box", []).append((path, x, -1.0))
        for key in ("shape_start", "shape_goal", "growth_start", "growth_goal", "generators_start", "generators_goal"):
            for path, x in _leaves(segment["tube"][key], (*base, "tube", key)):
                generator = key.startswith("generators")
                if abs(x) > 2e-7 if generator else _noticeable(segment["tube"][key], path[-2], path[-1]):
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
        for path, x in _leaves(segment.get("hybrid", {}).get("velocity", []), (*base, "hybrid", "velocity")):
            if abs(x) > 0.05:
                kinds.setdefault("velocity", []).append((path, x, 1.0))
    pick = random.Random(seed)
    for kind, places in sorted(kinds.items()):
        for path, x, sign in pick.sample(places, min(count, len(places))):
            yield f"{kind} {path}", _put(plan, path, x + sign * STEP * abs(x))


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


def _noticeable(matrix: list[list[float]], a: int, b: int) -> bool:
    """Whether 1e-9 of an entry of a shape matrix stands out from the rounding of double arithmetic."""
    radii = [max(matrix[k][k], 0.0) ** 0.5 for k in range(6)]
    floor, skew = [1e-11] * 3 + [3e-9] * 3, [1e-17] * 3 + [1e-15] * 3
    noise = floor[a] * floor[b] + 1e-13 * radii[a] * radii[b] + skew[a] * radii[b] + skew[b] * radii[a]
    return STEP * abs(matrix[a][b]) > 2.0 * noise + 2e-10 * abs(matrix[a][b])


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
    yield "generator dropped", at(lambda s: s["tube"]["generators_goal"].pop())
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
    if "hybrid" in segment:
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
