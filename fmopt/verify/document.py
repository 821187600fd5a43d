"""What the check takes from a plan file, and reading the file."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FORMAT = "fmopt.plan/1"
NOT_COVERED = (
    "friction, jamming and wedging beyond the choice of bias wrenches",
    "compliance and dynamics of the robot: that held contacts stay held under the bias wrench",
    "shape and size deviations of the parts other than those in the stated errors",
    "whether the real errors lie in the stated set, each fixed in the frame that is stated of it, apart from the "
    "velocity error",
)


class PlanError(ValueError):
    """A document that is no plan: says where in it, and what is wrong."""

    def __init__(self, path: str, message: str) -> None:
        super().__init__(f"{path or 'plan'}: {message}")
        self.path = path
        self.message = message

    def __reduce__(self) -> tuple[type[PlanError], tuple[str, str]]:
        return type(self), (self.path, self.message)


Numbers = tuple[float, ...]


@dataclass(frozen=True)
class Body:
    """A polyhedron as the plan states it: vertices and faces, each a tuple of vertex loops."""

    vertices: tuple[Numbers, ...]
    faces: tuple[tuple[tuple[int, ...], ...], ...]


@dataclass(frozen=True)
class Part:
    """A part: its surface and its convex pieces."""

    body: Body
    pieces: tuple[Body, ...]


@dataclass(frozen=True)
class Contact:
    """A primitive contact by vertex indices of the parts."""

    id: str
    kind: str
    moving: tuple[int, ...]
    fixed: tuple[int, ...]


@dataclass(frozen=True)
class Witness:
    """A plane between two pieces: vertex indices of the pieces, or normal and offset for kind "plane"."""

    kind: str
    moving: tuple[int, ...]
    fixed: tuple[int, ...]
    normal: Numbers
    offset: float


@dataclass(frozen=True)
class Separation:
    """What is claimed of a pair of pieces."""

    moving: int
    fixed: int
    witness: Witness
    margin: float


@dataclass(frozen=True)
class ContactClaim:
    """What is claimed of a contact of a segment."""

    id: str
    role: str
    normal: Numbers
    offset: float
    remainder: float
    margin: float


@dataclass(frozen=True)
class Tube:
    """What is claimed of the errors of a segment."""

    matrices: Mapping[str, tuple[Numbers, ...]]
    theta: float
    offset: float
    box: Numbers
    angles: Numbers


@dataclass(frozen=True)
class JamFree:
    """What is claimed of the directions of a segment's applied wrench.

    Attributes:
        push: along the motion, for which angles are stated.
        least_push: above which the push is not balanced; None where none is stated.
        angle: by which the wrench may turn in any direction.
        planes: how far it may turn from, and to, what the name says.
        twists: what proves it.
    """

    push: float
    least_push: float | None
    angle: float
    planes: tuple[tuple[str, tuple[float, float]], ...]
    twists: tuple[Numbers, ...]


@dataclass(frozen=True)
class Hybrid:
    """What is claimed of a segment's control.

    Attributes:
        frame: compliance frame, a pose in the B-frame.
        position_axes, force_axes: twists servoed in position and wrenches servoed in force, in its coordinates.
        velocity: unit twist of the reference point in axes of the B-frame.
        speed: m/s.
        bias: wrench applied to the moving part.
        push: size of its part along the motion.
        pressed: held contacts with the normal forces that balance the rest of it.
        felt: contacts that end the move.
        wrench, threshold, max_travel, timeout: when the move ends.
        jam_free: directions in which the bias cannot be balanced; None where nothing is claimed.
        impact: normal speed of the contact met for a unit twist, and its force; None where none is limited.
    """

    frame: Numbers
    position_axes: tuple[Numbers, ...]
    force_axes: tuple[Numbers, ...]
    velocity: Numbers
    speed: float
    bias: Numbers
    push: float
    pressed: tuple[tuple[str, float], ...]
    felt: tuple[str, ...]
    wrench: Numbers
    threshold: float
    max_travel: float
    timeout: float
    jam_free: JamFree | None = None
    impact: tuple[float, float] | None = None


@dataclass(frozen=True)
class Specification:
    """What forces and speeds were asked for: m/s, N, N·m, friction, N, and (N, kg, N/m) where impacts are limited."""

    speed: float
    contact_force: float
    torque_limit: float
    friction: float
    termination_force: float
    impact: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Segment:
    """A piece of motion with its claims."""

    critical_point: int
    move: int
    state: tuple[str, ...]
    goal_state: tuple[str, ...]
    progress: tuple[float, float]
    start: Numbers
    goal: Numbers
    clearance: float
    margin: float
    binding: str
    basis: tuple[tuple[str, Numbers, bool], ...]
    tube: Tube
    separations: tuple[Separation, ...]
    contacts: tuple[ContactClaim, ...]
    hybrid: Hybrid | None
    leaving: tuple[str, ...]


@dataclass(frozen=True)
class Plan:
    """Everything of a plan file that the check rests on."""

    problem: str
    digest_holds: bool
    moving: Part
    fixed: Part
    contacts: tuple[Contact, ...]
    segments: tuple[Segment, ...]
    start_box: Numbers
    velocity_error: Numbers
    rho: float
    sources: tuple[tuple[str, Numbers], ...]
    specification: Specification
    goal: Numbers
    touch: float
    not_covered: tuple[str, ...]


def load(path: str | Path) -> dict[str, Any]:
    """Reads a plan file, "-" for standard input; special numbers and repeated keys are refused.

    Raises:
        PlanError: the file cannot be read, or is no JSON object.
    """
    try:
        text = sys.stdin.read() if str(path) == "-" else Path(path).read_text(encoding="utf-8")
        document = json.loads(text, parse_constant=_no_constant, object_pairs_hook=_no_repetition)
    except PlanError:
        raise
    except (OSError, UnicodeDecodeError) as error:
        raise PlanError("", f"cannot be read: {error}") from error
    except ValueError as error:
        raise PlanError("", f"no JSON: {error}") from error
    except RecursionError as error:
        raise PlanError("", "nested too deeply") from error
    if not isinstance(document, dict):
        raise PlanError("", "must be a JSON object")
    return document


def _no_constant(name: str) -> float:
    raise PlanError("", f"holds {name}, which is no number")


def _no_repetition(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        keys = [key for key, _ in pairs]
        raise PlanError("", f"repeats the key {next(k for k in keys if keys.count(k) > 1)!r}")
    return found


def digest(document: Mapping[str, Any]) -> str:
    """SHA-256 of the document without its key `sha256`, in canonical JSON.

    Raises:
        PlanError: the document holds something that is not JSON.
    """
    bare = {key: value for key, value in document.items() if key != "sha256"}
    try:
        text = json.dumps(
            bare, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False, check_circular=False
        )
        return hashlib.sha256(text.encode()).hexdigest()
    except (TypeError, ValueError) as error:
        raise PlanError("", f"holds what is not JSON: {error}") from error
    except RecursionError as error:
        raise PlanError("", "nested too deeply") from error
