"""What the check has to say: findings, the verdict, and both as text."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from fmopt.verify.arithmetic.rational import fixed, number
from fmopt.verify.reading.document import StatedEvidence

CERTIFIED = "CERTIFIED"
REFUTED = "REFUTED"
NOT_PROVED = "NOT_PROVED"
TESTED = "TESTED"  # of presses, whose evidence holds: nothing of them is proved
RELATIVE = 1e-10  # stated numbers must agree with re-derived ones to this share
MARGIN_FLOOR = 1e-12  # m: and margins to this absolute difference, on the safe side only
ALLOWANCE = fixed(4e-15)  # m and rad: added to every stated bound of errors before it is used
LEFT_ASIDE = (1e-10, 1e-9)  # m and rad a move: by how much its pieces may fail to share one twist, see `chain`
_OTHER_SIDE = 1e-16  # m: rounding allowed to numbers that nothing rests on


@dataclass(frozen=True)
class Finding:
    """One thing that keeps a plan from being certified.

    Its segment is None for the plan as a whole, its shortfall (m) 0 where that has no meaning.
    """

    segment: int | None
    what: str
    shortfall: float
    message: str

    def __str__(self) -> str:
        where = "plan" if self.segment is None else f"segment {self.segment}"
        return f"{where}: {self.what}: {self.message}"


@dataclass(frozen=True)
class Witness:
    """A pose at which two pieces certainly overlap."""

    segment: int
    pose: tuple[float, ...]
    error: tuple[float, ...]  # error (e, ε) on top of that nominal pose, zero for the nominal pose itself
    pair: tuple[int, int]
    depth: float  # certain depth of a common point in both pieces, m


@dataclass(frozen=True)
class Verdict:
    """The outcome of a check.

    The margin is the least re-derived one of all segments, m; None where one could not be re-derived. The stated
    verdict is the plan's own.
    """

    verdict: str
    findings: tuple[Finding, ...]
    witness: Witness | None
    segments: int
    margin: float | None
    not_covered: tuple[str, ...]
    stated: str = CERTIFIED
    taken: tuple[str, ...] = ()
    evidence: StatedEvidence | None = None

    def unless(self, differences: Sequence[str], remarks: Sequence[str] = ()) -> "Verdict":
        """The same, but not CERTIFIED where the plan differs from the problem that it is held against."""
        if remarks:
            return replace(self, taken=(*self.taken, *remarks)).unless(differences)
        if not differences:
            return self
        found = (*self.findings, *(Finding(None, "problem", 0.0, text) for text in differences))
        # A collision stays one, whatever problem the plan is of.
        return replace(self, verdict=self.verdict if self.verdict == REFUTED else NOT_PROVED, findings=found)

    def lines(self) -> list[str]:
        """The verdict as lines of text for people, with what it does not cover."""
        own = "" if self.stated == self.verdict else f"; the plan's own verdict is {self.stated}"
        if self.evidence is not None:
            return [f"verdict: {self.verdict} ({self.segments} presses){own}", *_tested_lines(self, self.evidence)]
        lines = [f"verdict: {self.verdict} ({self.segments} segments){own}"]
        if self.margin is not None and self.verdict == CERTIFIED:
            lines.append(f"least margin: {micrometres(self.margin)}")
        if (w := self.witness) is not None:
            lines += [
                f"collision: segment {w.segment}, moving piece {w.pair[0]} and fixed piece {w.pair[1]} overlap, a "
                f"common point lies {micrometres(w.depth)} inside both",
                "at pose (m, rad): " + " ".join(map(repr, w.pose)),
            ]
            if any(w.error):
                lines.append("with error (m, rad): " + " ".join(map(repr, w.error)))
        begun = "checked" if self.verdict == CERTIFIED else "asked, and not shown"
        return [
            *lines,
            *map(str, self.findings),
            f"{begun}: that for every error in the stated set the pieces of the parts stay apart up to the touch",
            "tolerance, and that every contact is made and held inside its facet, under the stated motion model",
            "not covered: that the pieces of a move share one twist exactly: executions that touch late or early may "
            f"leave the error set by up to {micrometres(LEFT_ASIDE[0])} and {LEFT_ASIDE[1] * 1e6:.9g} µrad a move",
            "not covered: friction, compliance, dynamics, and whether the real error lies in the stated set",
            "not read: the description, with S(t) of the nominal trajectory, contact states, and search costs",
            "not derived again: the measured clearance",
            *(f"taken as the planner has it: {text}" for text in self.taken),
            *(f"not covered, says the plan: {text}" for text in self.not_covered),
        ]


class Notes:
    """Collects findings on one segment, by its index, or on the plan (None)."""

    def __init__(self, segment: int | None) -> None:
        self.segment = segment
        self.found: list[Finding] = []

    def add(self, what: str, message: str, shortfall: float = 0.0) -> None:
        """Notes a finding, with its shortfall, m, 0 where that has no meaning."""
        self.found.append(Finding(self.segment, what, shortfall, message))

    def equal(self, what: str, stated: Sequence[float], derived: Sequence[int], floor: float) -> None:
        """Stated numbers must be the derived ones; a difference of `floor`, in their unit, always passes."""
        if len(stated) != len(derived):
            self.add(what, f"has {len(stated)} numbers where the check derives {len(derived)}")
            return
        for k, (x, y) in enumerate(zip(stated, derived, strict=True)):
            value = number(y)
            if abs(x - value) > RELATIVE * abs(value) + floor:
                self.add(what, f"entry {k} is stated as {x!r}, but follows as {value!r}")
                return

    def at_most(self, what: str, stated: float, derived: int) -> None:
        """A margin, m, must not exceed the derived one, and be it but for rounding."""
        value = number(derived)
        # Without any tolerance: the planner states margins a tenth of a picometre below what it has.
        if fixed(stated) > derived:
            self.add(what, f"{micrometres(stated)} are stated, only {micrometres(value)} follow", stated - value)
        elif value - stated > RELATIVE * abs(value) + MARGIN_FLOOR:
            self.add(what, f"{micrometres(stated)} are stated, but {micrometres(value)} follow")

    def at_least(self, what: str, stated: float, derived: int, allowance: int = 0) -> None:
        """A bound of errors, m or rad, must not be below the derived one, and be it but for rounding or allowance."""
        value = number(derived)
        if fixed(stated) + allowance < derived:
            self.add(what, f"is stated as {stated!r}, below the {value!r} that follow", value - stated)
        elif stated - value > RELATIVE * abs(value) + MARGIN_FLOOR:
            self.add(what, f"is stated as {stated!r}, above the {value!r} that follow")

    def about(self, what: str, stated: float, derived: int) -> None:
        """A clearance, m, that nothing rests on must not exceed the derived one but for rounding."""
        value = number(derived)
        if not -(RELATIVE * abs(value) + MARGIN_FLOOR) <= stated - value <= _OTHER_SIDE:
            self.add(what, f"{micrometres(stated)} are stated, but {micrometres(value)} follow", stated - value)

    def positive(self, what: str, derived: int) -> None:
        """A derived margin, m in fixed point, must be positive."""
        if derived <= 0:
            value = number(derived)
            self.add(what, f"short by {micrometres(-value)}", -value)


def _tested_lines(verdict: Verdict, evidence: StatedEvidence) -> list[str]:
    return [
        f"evidence: {evidence.seated} of {evidence.draws} draws seat, {evidence.first_tries} at the first attempt: a "
        f"rate of at least {evidence.bound:.4f} at {evidence.confidence:.1%} confidence; {evidence.vertices_seated} of "
        f"{evidence.vertices} vertices",
        *(str(finding) for finding in verdict.findings),
        "checked: counts against outcomes, the bound against the counts, the digest of what was carried out",
        "not checked: that the outcomes are those of the engine; fmopt execute --replay repeats any draw",
        "not covered: that the robot, the friction and the errors are as stated; nothing is proved of presses",
    ]


def micrometres(x: float) -> str:
    """A length in µm, with the digits that tell margins apart."""
    return f"{x * 1e6:.9g} µm"
