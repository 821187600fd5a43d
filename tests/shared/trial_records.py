"""Records of trials that were never run."""

from typing import Any


def record(number: int, size: float, success: bool = True, departures: tuple[str, ...] = ()) -> dict[str, Any]:
    rest = {"seconds": 4.0, "peak_force": 10.0, "impact_force": 20.0, "penetration": 1e-5, "retries": []}
    reasons = [] if success else ["tilted"]
    return {"trial": number, "size": size, "success": success, "reasons": reasons, "departures": [*departures]} | rest
