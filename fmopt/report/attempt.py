"""Where there is no plan: how far the closest motion came, what it lacks, and what would work, as data and page."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from fmopt.plan import Numbers, StatedContact, StatedPart
from fmopt.report.drawing import Drawing
from fmopt.report.naming import binding_words, box_words, contact_words, degrees, pose_words, quantity
from fmopt.report.scene import resource
from fmopt.report.shell import bullets, chaptered, figure, page, paragraph, table
from fmopt.report.views.cut_view import attempt_drawing, ends_of

_TITLE = "The closest attempt: both parts cut through the mating axis, at every move's end in the plane of the lean"


@dataclass(frozen=True)
class AttemptStep:
    """A move of an attempt between poses (6,), m and rad, and the least certified of it, m; None where nothing is."""

    name: str
    start: Numbers
    goal: Numbers
    made: tuple[str, ...]
    margin: float | None


@dataclass(frozen=True)
class Lack:
    """What an attempt lacks, in the move of a number from 1, one more than there are where none leads on.

    It has the name of that move's freedom, and the contact that it makes or that binds. Where a margin is short,
    `binding` is what it is of, as a plan names it, else `words` say what is wrong. `short` is by how much, m; None
    where that is not a length.
    """

    move: int
    name: str
    words: str
    binding: str
    contact: str
    short: float | None


@dataclass(frozen=True)
class Nearest:
    """The nearest problem that does work: the same with a share of all start errors, its plan's least margin in m.

    `box` has the half-widths (6,) of what is stated of the start error then, m and rad, `velocity` the errors of
    velocity in translation and rotation, as fractions; None where they are as stated.
    """

    share: float
    box: Numbers
    margin: float
    velocity: tuple[float, float] | None = None

    def record(self) -> dict[str, Any]:
        """The facts as plain values: m, rad."""
        velocity = None if self.velocity is None else list(self.velocity)
        box, margin = list(self.box), self.margin
        return {"share": round(self.share, 9), "start_box": box, "velocity_error": velocity, "margin": margin}

    @property
    def words(self) -> str:
        """Its errors, in words."""
        found = box_words(self.box)
        if self.velocity is not None:
            along, about = (100.0 * value for value in self.velocity)
            found += f", of velocity ±{along:.3g} % in translation, ±{about:.3g} % in rotation"
        return found


@dataclass(frozen=True)
class Failure:
    """Why there is no plan; `box` has the half-widths (6,) of the start error that was asked for, m and rad."""

    title: str
    stage: str
    message: str
    late: bool
    lack: Lack | None
    steps: tuple[AttemptStep, ...]
    box: Numbers
    rho: float
    nearest: Nearest | None
    advice: tuple[str, ...]
    moving: StatedPart
    fixed: StatedPart
    contacts: tuple[StatedContact, ...]

    @property
    def reason(self) -> str:
        """What is missing, in words: in which move, of what, by how much."""
        lack = self.lack
        if lack is None:
            return f"no motion could begin: {self.message}"
        where = f"move {lack.move} ({lack.name})" if lack.move <= len(self.steps) else f"after move {lack.move - 1}"
        if lack.move > len(self.steps) and lack.name:
            where += f", going on with {lack.name}"
        what = lack.words or binding_words(self, lack.binding)
        if lack.short is None:
            return f"{where}: {what}"
        angle = degrees(lack.short / self.rho)
        much = f"{quantity(lack.short)} short, as a turn {angle}° at the part's characteristic length"
        return f"{where}: {what}: {much}"

    def record(self) -> dict[str, Any]:
        """The facts as plain values: m, rad."""
        lack, near = self.lack, self.nearest
        short = None if lack is None else lack.short
        return {
            "stage": self.stage,
            "message": self.message,
            "late": self.late,
            "reason": self.reason,
            **{name: (getattr(lack, name, None) or None) for name in ("move", "contact", "binding")},
            "short": short,
            "short_angle": None if short is None else short / self.rho,
            "start_box": list(self.box),
            "nearest": near and near.record(),
            "advice": list(self.advice),
            "moves": [asdict(step) for step in self.steps],
        }

    @property
    def figures(self) -> Mapping[str, Drawing]:
        """The closest attempt, by name; none where no motion could begin."""
        if not self.steps:
            return {}
        ends = ends_of(self.steps[0].start, [(step.goal, step.made) for step in self.steps])
        return {"attempt": attempt_drawing("attempt", _TITLE, self, ends)}

    def page(self) -> str:
        """One page of HTML that holds everything and opens offline."""
        return failure_page(self, {name: figure.svg() for name, figure in self.figures.items()})


def failure_page(failure: Failure, svgs: Mapping[str, str]) -> str:
    """The page: what is missing first, then the closest attempt, what would work, and what was asked."""
    drawn = "".join(figure(svgs[name], d.alt, d.title, d.size) for name, d in failure.figures.items())
    none = "" if failure.nearest else "No share of the start errors was found to have a certified plan."
    works = paragraph(none) + bullets(map(_sentence, failure.advice))
    chapters = [
        ("attempt", "The closest attempt", drawn + _moves(failure)),
        ("works", "What does work", works),
        ("asked", "What was asked", paragraph(f"Start errors: {box_words(failure.box)}.")),
    ]
    limit = "The time limit ended this. " if failure.late else ""
    lead = '<div class="verdict unproved">\n<p class="word">No plan</p>\n'
    stage = f"Stage: {failure.stage}. {limit}{_sentence(failure.message)}"
    caution = "That no motion was found does not prove that there is none."
    lead += f"{paragraph(_sentence(failure.reason), stage, caution)}</div>\n"
    title = failure.title or "insertion"
    return page(f"{title}: no plan", resource("page.css"), chaptered("No insertion plan", title, chapters, lead))


def _moves(failure: Failure) -> str:
    rows = []
    for number, step in enumerate(failure.steps, start=1):
        made = "; ".join(contact_words(failure, name) for name in step.made)
        margin = "not certified" if step.margin is None else quantity(step.margin)
        rows.append((str(number), step.name, pose_words(step.goal), made or "none", margin))
    # No row is brought out where what is missing lies after the last move.
    worst = -1 if failure.lack is None or failure.lack.move > len(rows) else failure.lack.move - 1
    head = ("move", "along or about", "ends at", "contacts made", "certified margin")
    return table("The moves of the closest attempt", head, rows, "n....", worst)


def _sentence(words: str) -> str:
    return words[:1].upper() + words[1:] + ("" if words.endswith(".") else ".")
