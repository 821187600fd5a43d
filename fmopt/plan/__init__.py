"""The plan file `fmopt.plan/2`: one self-contained JSON document, where makers and users of plans meet.

All values are SI. Same input, same machine, same bytes: keys are sorted, numbers are the shortest that read back
exactly, and the document ends with a digest of itself. The check judges all of it but the part `description`.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fmopt.errors import PlanFormatError, ResourceError
from fmopt.runtime import output
from fmopt.verify.reading import document as proof
from fmopt.verify.reading.document import (
    Body,
    Hybrid,
    JamFree,
    MoveRecovery,
    Segment,
    StatedContact,
    StatedPart,
    StatedRecovery,
)
from fmopt.verify.reading.parse import parse
from fmopt.verify.reading.reader import (
    FORMAT,
    FRAMES,
    LONGEST,
    NOT_COVERED,
    NOT_COVERED_OFF_FORM,
    NOT_COVERED_PRESSES,
    UNITS,
    UNSEEN,
    Numbers,
    PlanError,
    content,
    decoded,
)

if TYPE_CHECKING:
    from fmopt.plan.description import Description
    from fmopt.plan.diagnostics import Diagnostics
    from fmopt.plan.error_sets import PlanErrorSet
    from fmopt.plan.evidence import Evidence
    from fmopt.plan.press import PressPlan

__all__ = [
    "FORMAT", "FRAMES", "NOT_COVERED", "NOT_COVERED_OFF_FORM", "NOT_COVERED_PRESSES", "STDIO", "UNITS", "Body",
    "Hybrid", "JamFree", "MoveRecovery", "Numbers", "Plan", "Segment", "StatedContact", "StatedPart",
    "StatedRecovery", "canonical", "clean", "digest", "line", "parsed", "read", "read_document", "rounded_down",
    "sealed", "write",
]  # fmt: skip

STDIO = Path("-")  # standard input or output, in place of a file
_ROUNDING = 1e-13  # m: what floating point may leave of a margin


@dataclass(frozen=True)
class Plan(proof.StatedPlan):
    """A plan: the part that the check judges, and the description.

    The description says how the motion was found, and what surrounds it; presses come with their evidence in full.
    """

    description: Description = field(kw_only=True)
    press_plan: PressPlan | None = field(default=None, kw_only=True)
    trials: Evidence | None = field(default=None, kw_only=True)

    @cached_property
    def error_sets(self) -> tuple[PlanErrorSet, ...]:
        """The error set at the start and at the end of each segment, as far as the check can derive them."""
        from fmopt.plan.error_sets import error_sets

        return error_sets(self)

    @cached_property
    def diagnostics(self) -> Diagnostics:
        """How the plan was found; empty where it does not say."""
        from fmopt.plan.diagnostics import Diagnostics

        return self.description.diagnostics or Diagnostics((), (), (), (), (), (None, None))


def canonical(document: Mapping[str, Any]) -> str:
    """The document as canonical JSON text: sorted keys, no spaces, no special numbers.

    Raises:
        PlanFormatError: a number is not finite.
    """
    try:
        return json.dumps(
            document, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False, check_circular=False
        )
    except ValueError as error:
        raise PlanFormatError(f"the plan holds a number that JSON cannot: {error}", "keep numbers finite") from error


def digest(document: Mapping[str, Any]) -> str:
    """SHA-256 (hex) of the canonical text without the key `sha256`."""
    bare = {key: value for key, value in document.items() if key != "sha256"}
    return hashlib.sha256(canonical(bare).encode()).hexdigest()


def sealed(document: Mapping[str, Any]) -> dict[str, Any]:
    """The document with its digest."""
    return {**document, "sha256": digest(document)}


def clean(value: Any) -> Any:
    """Numbers, arrays and tuples as plain JSON values; minus zero becomes zero."""
    if value is None or isinstance(value, (str, int)):
        return value
    if isinstance(value, (list, tuple)):
        # By type, as NumPy's numbers are floats as well, and become plain ones by `tolist`.
        return [item + 0.0 if type(item) is float else clean(item) for item in value]
    if hasattr(value, "tolist"):
        return clean(value.tolist())
    if isinstance(value, Mapping):
        return {key: item + 0.0 if type(item) is float else clean(item) for key, item in value.items()}
    return value + 0.0 if isinstance(value, float) else value


def line(words: str) -> str:
    """Words as a plan may hold them: one line without unseen characters, no longer than its reader takes."""
    return UNSEEN.sub("\N{REPLACEMENT CHARACTER}", " ".join(words.split()))[:LONGEST]


def write(document: Mapping[str, Any], path: Path) -> None:
    """Writes a plan, whole or not at all.

    Raises:
        ResourceError: the file cannot be written.
    """
    # Laid out for people to read; the digest is of the canonical text, whatever the layout.
    text = json.dumps(document, sort_keys=True, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    output.save(text.encode(), path)


def read(path: Path) -> Plan:
    """Reads a plan file, "-" for standard input.

    Raises:
        ResourceError: the file cannot be read.
        PlanFormatError: it is no plan of this format; says where in it, and what is wrong.
    """
    return parsed(read_document(path), str(path))


def parsed(document: Any, name: str = "") -> Plan:
    """The plan of a JSON document.

    Raises:
        PlanFormatError: it is none.
    """
    from fmopt.plan.description import Description

    try:
        judged = parse(document)
        description = Description.parsed(document.get("description", {}))
        for one in () if description.diagnostics is None else description.diagnostics.unplanned:
            if max(one.moving) >= len(judged.moving.body.vertices) or max(one.fixed) >= len(judged.fixed.body.vertices):
                raise PlanError("description.diagnostics.unplanned", "names a vertex that its part does not have")
        presses, trials = None, None
        if judged.presses:
            from fmopt.plan.evidence import evidence_of
            from fmopt.plan.press import press_plan_of

            presses = press_plan_of(document)
            counts = [len(attempt.presses) for attempt in presses.attempts]
            trials = evidence_of(document["evidence"], counts) if judged.evidence is not None else None
            if any(one.press >= counts[0] for one in description.trace):
                raise PlanError("description.trace", "names a press that the first attempt does not have")
        return Plan(**vars(judged), description=description, press_plan=presses, trials=trials)
    except PlanError as error:
        # The reader of plans stands alone, as the check does; this error has advice and an exit code.
        raise _refused(name, error) from error


def read_document(path: Path) -> dict[str, Any]:
    """Reads a plan file as the JSON object that it is, "-" for standard input.

    Raises:
        ResourceError: the file cannot be read.
        PlanFormatError: it is no JSON object.
    """
    try:
        return decoded(content(path))
    except PlanError as error:
        raise _refused(str(path), error) from error
    except OSError as error:
        raise ResourceError(f"{path}: {error.strerror or error}", "give the plan.json of a solved problem") from error


def _refused(name: str, error: PlanError) -> PlanFormatError:
    return PlanFormatError(f"{name}: {error}" if name else str(error), "give a plan.json that fmopt solve wrote")


def rounded_down(value: float) -> float:
    """A little less than `value` (m): what may be stated of a margin that was computed in floating point.

    Between edges rounding of coordinates is divided by the sine of the angle at which they cross: 3.5 fm were met on a
    part of 100 mm, where they cross at 10°.
    """
    # Where nothing is near no margin is finite, and a file cannot say so; what is no number stays none, and is refused.
    return 1.0 if value == math.inf else value - _ROUNDING - 1e-12 * abs(value)
