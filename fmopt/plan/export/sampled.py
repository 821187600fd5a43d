"""The position/force trajectory Pₐ(t), Fₐ(t), S(t) of a plan, sampled at a rate, as CSV and JSON."""

import json
from dataclasses import dataclass

import numpy as np

from fmopt.errors import PlanFormatError
from fmopt.plan import Plan
from fmopt.plan.export.cautions import check_rate
from fmopt.plan.position_force import AXES
from fmopt.runtime.escape import csv_comment
from fmopt.spatial.values import Array, Value

FORMAT = "fmopt.samples/1"
COLUMNS = ("t", *(f"{name}_{axis}" for name in ("s", "pa", "fa") for axis in AXES))
_NOTES = (
    "units: s, m, rad, N, N m; S, Pa and Fa along and about the axes of the B-frame",
    "S: 0 free, 1 stopped in +, -1 stopped in -, 2 stopped both ways; Pa where S = 0, servoed in position",
    "Fa where S is not 0, servoed in force: the reaction of the fixed on the moving part, the controller applies -Fa",
    "not the motion to run, which is the plan's segments, but the nominal position/force trajectory",
)
_OF_MOVES = "it goes straight in, as if there were no errors; the formats for robots hold the segments"
_OF_PRESSES = "it is of the first attempt, carried out without errors in the middle of all intervals"


@dataclass(frozen=True, eq=False)
class Samples(Value, t=(None,), s=("t", 6), pa=("t", 6), fa=("t", 6), labels={"t": "times"}):
    """Times (n,), s; S (n, 6); Pₐ (n, 6), m and rad; Fₐ (n, 6), the reaction, N and N·m."""

    t: Array
    s: Array
    pa: Array
    fa: Array

    @property
    def table(self) -> Array:
        """Rows of `COLUMNS`, (n, 19)."""
        return np.hstack([self.t[:, None], self.s, self.pa, self.fa])


def samples(plan: Plan, rate: float) -> Samples:
    """Samples at a rate, Hz, from the start, and the end; where S jumps, the value that begins there.

    Raises:
        PlanFormatError: the plan holds no such trajectory, or the rate is no rate for it.
    """
    rows = plan.description.position_force
    if not rows:
        raise PlanFormatError("the plan holds no position/force trajectory", "solve the problem again")
    first, last = rows[0].start, rows[-1].end
    starts = np.array([row.start for row in rows])
    check_rate(rate, last - first)
    # A little less, that rounding does not bring the end twice: it is added by itself.
    count = int(np.floor((last - first) * rate * (1.0 - 1e-12))) + 1
    t = np.append(first + np.arange(count) / rate, last)
    inside = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, len(rows) - 1)
    begun, length = t - starts[inside], np.array([row.end - row.start for row in rows])[inside]
    share = np.divide(begun, length, out=np.ones(len(t)), where=length > 0.0)  # what lasts no time is at its end
    ends = np.array([[row.pa_start, row.pa_end] for row in rows])[inside]
    pa = ends[:, 0] + share[:, None] * (ends[:, 1] - ends[:, 0])
    return Samples(t, np.array([row.s for row in rows])[inside], pa, np.array([row.fa for row in rows])[inside])


def _notes(plan: Plan) -> tuple[str, ...]:
    return (*_NOTES, _OF_MOVES if plan.press_plan is None else _OF_PRESSES)


def csv_text(plan: Plan, rate: float, caution: str = "") -> str:
    """The samples, at a rate in Hz, as CSV: comment lines with `#`, one of names, numbers that read back exactly."""
    warned = (f"WARNING: {csv_comment(caution)}",) if caution else ()
    lines = [f"# {line}" for line in (FORMAT, f"plan {csv_comment(plan.sha256)}", *warned, *_notes(plan))]
    lines.append(",".join(COLUMNS))
    found = samples(plan, rate)
    for t, s, pa, fa in zip(found.t.tolist(), found.s.tolist(), found.pa.tolist(), found.fa.tolist(), strict=True):
        lines.append(",".join([repr(t), *(str(int(code)) for code in s), *(repr(value) for value in (*pa, *fa))]))
    return "\n".join(lines) + "\n"


def json_text(plan: Plan, rate: float, caution: str = "") -> str:
    """The samples as one JSON object; arguments as for `csv_text`."""
    found = samples(plan, rate)
    columns = [column.tolist() for column in (found.t, found.s.astype(int), found.pa, found.fa)]
    rows = [dict(zip(("t", "s", "pa", "fa"), row, strict=True)) for row in zip(*columns, strict=True)]
    notes = [*([f"WARNING: {caution}"] if caution else []), *_notes(plan)]
    head = {"format": FORMAT, "plan": plan.sha256, "notes": notes, "rate": rate, "fa_sign": "reaction"}
    return json.dumps({**head, "samples": rows}, indent=1, allow_nan=False) + "\n"
