"""Trials on a robot of one's own: from a CSV file into the plan file, beside what the physics engine found."""

import csv
import hashlib
import io
import math
import statistics
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from fmopt import plan
from fmopt.errors import Fault, InputError, PlanFormatError
from fmopt.execution.confidence import lower_bound, success_interval
from fmopt.plan.description import OwnTrials
from fmopt.runtime.escape import one_line
from fmopt.task.toml.source import Place, read_bytes

_OUTCOMES = {"seated": True, "true": True, "1": True, "failed": False, "false": False, "0": False}
_MOST_BYTES = 1_000_000
_MOST_FAULTS = 20


def own_trials(file: Path) -> OwnTrials:
    """The trials of a file with a column `outcome` (seated or failed) and, if known, `seconds`.

    Raises:
        InputError: with the faults of the file.
    """
    start = Place(str(file))
    content = read_bytes(file, start, _MOST_BYTES)
    outcomes, seconds, faults = list[bool](), list[float](), list[Fault]()
    try:
        rows = csv.reader(io.StringIO(content.decode("utf-8-sig"), newline=""), strict=True)
        names = [name.strip().lower() for name in next(rows, [])]
        if "outcome" not in names:
            advice = "name the columns in the first line: outcome, and seconds where they are known"
            raise InputError(start.fault("missing-key", "there is no column 'outcome'", advice))
        for row in rows:
            cells = dict(zip(names, (cell.strip().lower() for cell in row), strict=False))
            if any(cells.values()):
                faults += _read(cells, Place(str(file), rows.line_num), outcomes, seconds)
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(start.fault("syntax", f"it is no CSV file: {error}", "write it in UTF-8")) from error
    if not outcomes and not faults:
        faults.append(start.fault("missing-key", "there are no trials", "write a line for each"))
    if faults:
        raise InputError(*faults[:_MOST_FAULTS])
    count, seated = len(outcomes), sum(outcomes)
    median = statistics.median(seconds) if seconds else None
    name, key = one_line(file.name), hashlib.sha256(content).hexdigest()
    return OwnTrials(name, key, count, seated, lower_bound(seated, count), *success_interval(seated, count), median)


def _read(cells: dict[str, str], place: Place, outcomes: list[bool], seconds: list[float]) -> Iterator[Fault]:
    """Takes a trial up, and says what is wrong with it."""
    if (outcome := cells.get("outcome", "")) not in _OUTCOMES:
        yield place.fault("bad-value", f"the outcome is {outcome!r}", "write seated or failed")
        return
    outcomes.append(_OUTCOMES[outcome])
    if text := cells.get("seconds", ""):
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not 0.0 <= value < math.inf:
            yield place.fault("bad-value", f"{text!r} are no seconds", "write a number, or nothing")
        elif outcomes[-1]:
            seconds.append(value)


def with_trials(file: Path, trials: Path) -> dict[str, Any]:
    """The plan of a file with trials of another one, sealed anew.

    Raises:
        InputError: the trials cannot be read, or are in the plan already.
        PlanFormatError: it is no plan, or was changed after it was sealed.
    """
    document, found = plan.read_document(file), own_trials(trials)
    whole = plan.parsed(document, str(file))
    if not whole.digest_holds:
        raise PlanFormatError(f"{file}: the plan was changed after it was sealed", "solve its problem again")
    if any(one.sha256 == found.sha256 for one in whole.description.own_trials):
        raise InputError(Place(str(trials)).fault("conflict", "the plan has these trials already", "add others"))
    simulated = whole.trials or whole.description.carried_out
    if simulated is not None and simulated.draws:
        low, high = success_interval(simulated.seated, simulated.draws)
        apart = not low <= found.seated / found.trials <= high
        apart &= not found.low <= simulated.seated / simulated.draws <= found.high
        found = replace(found, contradicts=apart)
    described = replace(whole.description, own_trials=(*whole.description.own_trials, found))
    return plan.sealed(plan.clean({**document, "description": described.record()}))
