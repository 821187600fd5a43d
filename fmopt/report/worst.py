"""A search for trials of presses that fail, in words: the region that holds them, and the limits beside it."""

import math
from collections.abc import Mapping
from typing import Any

_LEAST = 0.1  # of an interval, below which a limit of it is no advice
_MAX_KINDS = 5


def worst_lines(found: Mapping[str, Any]) -> list[str]:
    """The summary of a search for people."""
    (uniform, draws), (inside, placed) = found["uniform"], found["in_region"]
    lines = [found["caution"]] if "caution" in found else []
    lines += [
        f"{found['failures']} of {found['trials']} trials of a search fail, seed {found['seed']}; of the {draws} among "
        f"them that are uniform draws {uniform}. A search finds failures, and bounds nothing"
    ]
    lines += [f"  {count} × {kind}" for kind, count in [*found["kinds"].items()][:_MAX_KINDS]]
    if not found["unknowns"]:
        return [*lines, "no region: too few trials fail, or what fails is spread over all intervals"]
    share = f"{100.0 * found['region_share']:.2g} % of all that is drawn"
    lines += [f"in this region, {share}, {inside} of {placed} uniform draws fail:"]
    return lines + [_unknown_words(**row) for row in found["unknowns"]]


def _unknown_words(name: str, drawn: list[float], region: list[float], without_failure: list[float]) -> str:
    """Where an unknown lies in four of five failing trials, and the limit within which no trial fails."""
    scale, unit = 1.0, {"force": " N", "torque": " N m"}.get(name.split()[0], "")
    if name.startswith("start"):
        scale, unit = (math.degrees(1.0), "°") if "about" in name else (1e3, " mm")

    def words(value: float) -> str:
        return f"{scale * value:.3g}".replace("-", "−") + unit

    low, high = without_failure
    if high - low < _LEAST * (drawn[1] - drawn[0]):
        limit = "trials fail wherever it is"
    else:
        ends = f"within ±{words(high)}" if low == -high else f"up to {words(high)}" if low == drawn[0] else None
        limit = f"no trial of the search fails {ends or f'from {words(low)} on'}"
    return f"  {name} from {words(region[0])} to {words(region[1])}, drawn up to {words(drawn[1])}: {limit}"
