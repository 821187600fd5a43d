"""What trials add up to: success with its interval, contacts as planned, forces, times, failures by first departure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from math import sqrt
from typing import Any

import numpy as np

_Z = 1.959963984540054  # normal quantile of 95 %


def wilson(successes: int, trials: int) -> tuple[float, float]:
    """95 % Wilson interval of a share; (0, 1) without trials."""
    if not trials:
        return 0.0, 1.0
    share, z2 = successes / trials, _Z**2
    centre = (share + z2 / (2 * trials)) / (1 + z2 / trials)
    half = _Z * sqrt(share * (1 - share) / trials + z2 / (4 * trials**2)) / (1 + z2 / trials)
    low = 0.0 if successes == 0 else centre - half
    return low, 1.0 if successes == trials else centre + half


def summary(records: Sequence[Any]) -> dict[str, Any]:
    """Inside and beyond the certified set, and the success by size of error, in boxes."""
    inside = [record for record in records if record["size"] <= 1.0]
    beyond = [record for record in records if record["size"] > 1.0]
    return {
        "inside": _share(inside),
        "beyond": _share(beyond),
        "by_size": _by_size(records),
        "failures": failures(records),
        "departures": dict(Counter(r["departures"][0] for r in inside if r["departures"]).most_common()),
    }


def failures(records: Sequence[Any]) -> list[dict[str, Any]]:
    """Groups of failures by their first departure from the plan, or else their reason, largest first."""
    groups: dict[str, list[int]] = {}
    for record in records:
        if not record["success"]:
            first = record["departures"][0] if record["departures"] else record["reasons"][0]
            groups.setdefault(first, []).append(record["trial"])
    ordered = sorted(groups.items(), key=lambda group: (-len(group[1]), group[0]))
    return [{"departure": first, "count": len(numbers), "trials": numbers} for first, numbers in ordered]


def _share(records: Sequence[Any]) -> dict[str, Any]:
    if not records:
        return {"trials": 0}
    successes = sum(record["success"] for record in records)
    low, high = wilson(successes, len(records))
    return {
        "trials": len(records),
        "successes": successes,
        "share": successes / len(records),
        "interval": [low, high],
        "without_recovery": _alone(records),
        "as_planned": sum(not record["departures"] for record in records) / len(records),
        "seconds": _spread([r["seconds"] for r in records if r["seconds"] is not None]),
        "peak_force": _spread([r["peak_force"] for r in records]),
        "impact_force": _spread([r["impact_force"] for r in records]),
        "penetration": _spread([r["penetration"] for r in records]),
    }


def _alone(records: Sequence[Any]) -> dict[str, Any]:
    """The success of those that never tried again; what tried again would have failed without."""
    successes = sum(record["success"] and not record["retries"] for record in records)
    return {"successes": successes, "interval": list(wilson(successes, len(records)))}


def _spread(values: Sequence[float]) -> dict[str, float]:
    """Median and largest."""
    return {"median": float(np.median(values)), "largest": float(np.max(values))} if len(values) else {}


def _by_size(records: Sequence[Any], width: float = 0.25) -> list[dict[str, Any]]:
    rows: dict[int, list[bool]] = {}
    for record in records:
        rows.setdefault(int(np.ceil(record["size"] / width)) - 1, []).append(record["success"])
    return [
        {"size": [width * k, width * (k + 1)], "trials": len(rows[k]), "share": sum(rows[k]) / len(rows[k])}
        for k in sorted(rows)
    ]


def _size(row: dict[str, Any]) -> str:
    low, high = row["size"]
    place = "inside" if high <= 1.0 else "beyond"
    return f"  errors of {low:.2f} to {high:.2f} boxes ({place}): {100 * row['share']:.1f} % of {row['trials']} seated"


def _in_words(share: float, interval: Sequence[float]) -> str:
    low, high = interval
    return f"{100 * share:.1f} % (95 % interval {100 * low:.1f} to {100 * high:.1f} %)"


def lines(found: dict[str, Any]) -> list[str]:
    """The summary for people."""
    told = []
    if (said := found.get("verdict", "CERTIFIED")) != "CERTIFIED":
        told.append(f"the plan is {said}: no set of errors is certified, trials are all that is known of it")
    told += [found["caution"]] if "caution" in found else []
    asked = f"; asked for {found['contact_force']:g} N of contact force"
    for name in ("inside", "beyond"):
        part = found[name]
        if part["trials"]:
            told.append(
                f"{name} the certified set: {part['successes']} of {part['trials']} seated, "
                f"{_in_words(part['share'], part['interval'])}, contacts as planned in {100 * part['as_planned']:.1f} %"
            )
            alone = part["without_recovery"]
            if alone["successes"] != part["successes"]:
                share = alone["successes"] / part["trials"]
                told.append(
                    f"  without trying again {alone['successes']} of {part['trials']}, "
                    f"{_in_words(share, alone['interval'])}"
                )
            told.append(
                f"  force up to {part['peak_force']['largest']:.1f} N filtered, impact "
                f"{part['impact_force']['largest']:.1f} N, penetration up to "
                f"{1e6 * part['penetration']['largest']:.1f} µm{asked}"
            )
    if found["beyond"]["trials"]:
        told += [_size(row) for row in found["by_size"]]
    for group in found["failures"]:
        told.append(f"  {group['count']} failed, first: {group['departure']}; such as trial {group['trials'][0]}")
    return told
