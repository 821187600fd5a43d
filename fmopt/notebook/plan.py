"""Plans from Python: made, read, checked, carried out, exported, tabulated."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import InitVar, dataclass, field, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fmopt import plan as files
from fmopt.errors import ChoiceError, InfeasibleError, PlanFormatError, ResourceError, SearchError
from fmopt.planning.same_problem import REMARK, differences
from fmopt.report.moves import MoveWords, moves, smallest_margin
from fmopt.report.moves import verdict as spoken
from fmopt.report.presses import timing_words
from fmopt.runtime import output
from fmopt.spatial.se3 import Pose
from fmopt.task import problem as task
from fmopt.verify import PlanError, Verdict, verify

if TYPE_CHECKING:
    import polars

    from fmopt.execution.trials import Trials as Wanted
    from fmopt.notebook.placing import Placing
    from fmopt.notebook.trials import Trials
    from fmopt.plan.evidence import Evidence
    from fmopt.plan.position_force import Stretch
    from fmopt.plan.press import PressPlan
    from fmopt.plan.press_rows import PlacedAttempt
    from fmopt.report.drawing import Drawing


@dataclass(frozen=True, eq=False)
class Segment:
    """One piece of a plan's motion: the part goes straight, and turns at a constant rate, while it keeps its contacts.

    >>> segment = fmopt.read("out/square_peg/plan.json").segments[0]
    >>> segment.move, segment.state, segment.margin > 0.0
    (1, (), True)

    `number` counts from 0 through the plan, `move` from 1. Poses are nominal ones of the moving part in the frame of
    the hole; `margin`, `clearance` and the characteristic length `rho` are in m. `hybrid` has the control strategy,
    `record` all that the plan file holds of it, SI units.
    """

    number: int
    move: int
    start: Pose
    goal: Pose
    state: tuple[str, ...]
    goal_state: tuple[str, ...]
    leaving: tuple[str, ...]
    margin: float
    clearance: float
    binds: str
    hybrid: files.Hybrid
    rho: float
    record: files.Segment

    def _repr_html_(self) -> str:
        from fmopt.notebook.sheets import segment_sheet

        return segment_sheet(self)


@dataclass(frozen=True, eq=False)
class Plan:
    """A plan: the motion, its certificate and its control strategies, as the plan file holds them.

    >>> plan = fmopt.read("out/square_peg/plan.json")
    >>> print(plan)
    Square peg in a blind square hole, 0.1 mm clearance a side: CERTIFIED, ... moves, least margin ... µm

    Args:
        document: the plan file, `fmopt.plan/2`. It is sealed: once something in it is changed, nothing is proved.
        seconds: how long the stages took, by name; empty for a plan that was read.

    Raises:
        PlanFormatError: the document is no plan; says where in it, and what is wrong.
    """

    document: Mapping[str, Any]
    seconds: Mapping[str, float] = field(default_factory=dict)
    name: InitVar[str] = ""
    stated: files.Plan = field(init=False)

    def __post_init__(self, name: str) -> None:
        object.__setattr__(self, "stated", files.parsed(self.document, name))

    @property
    def verdict(self) -> str:
        """CERTIFIED, TESTED, REFUTED or NOT_PROVED, as the plan says; `verify` checks it."""
        return self.stated.verdict

    @property
    def proved(self) -> bool:
        """Whether the plan says CERTIFIED, is as it was sealed, and states positive margins only."""
        return spoken(self.stated).proved

    @property
    def margin(self) -> float:
        """Least margin of all segments, m."""
        return smallest_margin(self.stated)

    @property
    def presses(self) -> PressPlan | None:
        """The presses, attempt by attempt, with the robot that carries them out; None in a plan of guarded moves."""
        return self.stated.press_plan

    @property
    def placed(self) -> tuple[PlacedAttempt, ...]:
        """Rows of the presses of each attempt: room, contacts, friction, errors that are left."""
        return self.stated.description.placed

    @property
    def evidence(self) -> Evidence | None:
        """What trials of the presses came to: draws, bound, vertices, every outcome."""
        return self.stated.trials

    @cached_property
    def segments(self) -> tuple[Segment, ...]:
        """The pieces of the motion, in order."""
        from fmopt.report.naming import binding_words

        alike = ("state", "goal_state", "leaving", "margin", "clearance", "hybrid")
        return tuple(
            Segment(
                number=number,
                move=move,
                start=Pose.from_vector(piece.start),
                goal=Pose.from_vector(piece.goal),
                binds=binding_words(self.stated, piece.binding),
                rho=self.stated.rho,
                record=piece,
                **{name: getattr(piece, name) for name in alike},
            )
            for number, (move, piece) in enumerate((m.number, piece) for m in self.moves for piece in m.segments)
        )

    @cached_property
    def moves(self) -> tuple[MoveWords, ...]:
        """The moves, in order; a move that turns far has several segments."""
        return moves(self.stated)

    @cached_property
    def stretches(self) -> tuple[Stretch, ...]:
        """S, Pₐ and Fₐ of the motion, [LeeHuang1985], move by move, beside S(t) of the nominal trajectory.

        >>> plan = fmopt.read("out/square_peg/plan.json")
        >>> plan.stretches[0].s, plan.stretches[-1].move
        ((0, 0, 0, 0, 0, 0), None)
        """
        from fmopt.plan.position_force import stretches

        return stretches(self.stated)

    def verify(self, problem: task.Problem | None = None) -> Verdict:
        """Checks the certificate from the plan's own geometry, in exact arithmetic, without the planner.

        Where a problem is given, the plan must be of that one, too.

        >>> plan = fmopt.read("out/square_peg/plan.json")
        >>> print("\\n".join(plan.verify().lines()[:1]))
        verdict: CERTIFIED (... segments)
        >>> plan.verify(fmopt.load(fmopt.example("lee_huang_peg"))).verdict
        'NOT_PROVED'

        Raises:
            PlanFormatError: the document is no plan that can be checked.
        """
        try:
            found = verify(dict(self.document))
        except PlanError as error:
            raise PlanFormatError(str(error), "solve the problem with this version") from error
        return found if problem is None else found.unless(differences(self.stated, problem), (REMARK,))

    def placement(self, problem: task.Problem, radius: float | None = None) -> Placing:
        """The cone program that places the goal poses of this plan, as a CVXPY problem to be changed and solved.

        Poses may move by `radius`, m, turns at the characteristic length; else by a tenth of the clearance. It needs
        the extra `cvxpy`.

        >>> problem = fmopt.load(fmopt.example("square_peg"))
        >>> placing = fmopt.read("out/square_peg/plan.json").placement(problem)
        >>> placing.shift.shape[1]
        6

        Raises:
            ChoiceError: the plan is of another problem.
            ResourceError: CVXPY is not installed.
        """
        from fmopt.notebook.placing import placing

        if others := differences(self.stated, problem):
            raise ChoiceError(others[0], "give the problem that the plan was made for")
        return placing(self.stated, problem, radius)

    def execute(
        self,
        trials: int | Wanted = 100,
        seed: int = 0,
        *,
        unverified: bool = False,
        folder: str | PathLike[str] | None = None,
        workers: int | None = None,
    ) -> Trials:
        """Carries the plan out in a physics engine, under errors drawn at random.

        Args:
            trials: how many, with errors inside the certified set; or all that is to be run, a `fmopt.Trials`, which
                has further trials with errors beyond the set, recovery, method, engine, friction and others.
            unverified: whether to take a plan that the check does not certify, without asking it.
            folder: for the results, what is there of the same trials is used; out/trials-… when not given.

        Raises:
            ValueError: there is no such engine or method.
            SettingsError: a number is out of range.
            UnprovedError: the check does not certify the plan.
            ResourceError: the engine of the extra `drake` is not installed, or results cannot be written.
        """
        from fmopt.execution.engines.catalogue import ENGINES
        from fmopt.execution.execute import TrialSettings, execute
        from fmopt.execution.trials import METHODS
        from fmopt.execution.trials import Trials as Wanted
        from fmopt.notebook.checking import admitted
        from fmopt.notebook.trials import Trials

        wanted = trials if isinstance(trials, Wanted) else Wanted(trials, seed=seed)
        for what, given, known in (("engine", wanted.engine, ENGINES), ("method", wanted.method, METHODS)):
            if given not in known:
                raise ValueError(f"{what} {given!r} is none of {', '.join(known)}")
        other = "" if wanted.engine == Wanted.engine else f"-{wanted.engine}"  # of the class: the usual engine
        there = Path(folder if folder is not None else f"out/trials-{self.stated.sha256[:12]}{other}")
        plan = files.parsed(self.document)
        caution = admitted(plan, unverified)
        files.write(self.document, there / "plan.json")
        return Trials(execute(plan, wanted, TrialSettings(there, workers), caution), there)

    def export(
        self,
        to: str,
        path: str | PathLike[str],
        base: Pose | tuple[float, float, float, float, float, float] | None = None,
        rate: float = 100.0,
        *,
        unverified: bool = False,
    ) -> tuple[Path, ...]:
        """Writes the plan as a robot or a table takes it, and gives the files and folders that were written.

        >>> plan = fmopt.read("out/square_peg/plan.json")
        >>> [path.name for path in plan.export("urscript", "peg.script", base=(0.4, -0.1, 0.2, 0, 0, 0))]
        ['peg.script']

        Args:
            to: "urscript", "ros2", "csv", "json" or "mjcf".
            path: the file; for "ros2" a folder.
            base: pose of the hole's frame, whose z points out of the hole, in the robot's base, m and rotation vector
                in rad; for robots.
            unverified: whether to take a plan that the check does not certify, without asking it, and say so in it.

        Raises:
            ValueError: the format is unknown, or it is for robots and `base` is missing or in other units.
            UnprovedError: the check does not certify the plan.
            FmoptError: the plan cannot be exported so, or the file not be written.
        """
        from fmopt.notebook.checking import admitted
        from fmopt.plan.export.write import Form, exported

        frame = base.vector() if isinstance(base, Pose) else base
        form = Form(to, None if frame is None else tuple(map(float, frame)), rate)
        plan = files.parsed(self.document)
        form = replace(form, caution=admitted(plan, unverified))
        if to == "mjcf":
            from fmopt.execution.mjcf import mjcf

            form = replace(form, scene=mjcf)
        return exported(plan, form, Path(path))

    def to_dataframe(self) -> polars.DataFrame:
        """The segments as a data frame, a line each: poses, margins and forces in SI units.

        >>> frame = fmopt.read("out/square_peg/plan.json").to_dataframe()
        >>> frame.columns[:4], len(frame) > 7
        (['segment', 'move', 'state', 'goal_state'], True)

        Raises:
            ResourceError: polars, of the extra `frame`, is not installed.
        """
        from fmopt.notebook.sheets import segment_row

        try:
            import polars
        except ImportError as error:
            raise ResourceError("polars is not installed", "install fmopt[frame]") from error
        return polars.DataFrame([segment_row(segment) for segment in self.segments], infer_schema_length=None)

    @property
    def figures(self) -> Mapping[str, Drawing]:
        """The figures of the plan's report by name, each with title, description, `svg()` and `png()`."""
        from fmopt.report.figures import catalogue

        return catalogue(self.stated)

    def scene(self) -> Drawing:
        """The motion in three dimensions, to be turned and played, offline."""
        from fmopt.notebook.drawing import show

        return show(self, "scene")

    def save(self, path: str | PathLike[str]) -> Path:
        """Writes the plan file, whole or not at all.

        Raises:
            ResourceError: the file cannot be written.
        """
        files.write(self.document, Path(path))
        return Path(path)

    def report(self, path: str | PathLike[str]) -> Path:
        """Writes the report: one page of HTML that opens offline.

        Raises:
            ResourceError: the file cannot be written.
        """
        from fmopt.report.figures import figures
        from fmopt.report.page import report_page

        output.save(report_page(self.stated, figures(self.stated)).encode(), Path(path))
        return Path(path)

    def __str__(self) -> str:
        said = f"{self.stated.title}: {self.verdict}, "
        if self.evidence is not None:
            found = self.evidence
            return f"{said}{found.seated} of {found.draws} draws seat{timing_words(found.cycle_times)}"
        least = "least margin" if self.proved else "not proved: least computed margin"
        return f"{said}{len(self.moves)} moves, {least} {1e6 * self.margin:.1f} µm"

    def __repr__(self) -> str:
        return f"<fmopt.Plan {self}>"

    def _repr_html_(self) -> str:
        from fmopt.notebook.sheets import plan_sheet

        return plan_sheet(self)


def solve(problem: task.Problem, progress: Callable[[str], None] = lambda _: None) -> Plan:
    """Solves a problem: plans the motion, checks its certificate independently, and gives the plan with its verdict.

    It takes from seconds to minutes, within the problem's time limit for the search; `progress`, such as `print`, is
    told what is being done. `plan.proved` says whether the plan is certified; one that is not is returned all the same.

    Raises:
        InterferenceError: the parts overlap when assembled, or their clearance is not positive.
        SearchError: no motion was found, which proves nothing. Its `failure` says what is missing, in which move and by
            how much, and the nearest problem that does work: reason, lack, nearest, advice, figures, page.
        InfeasibleError: no bias force holds the contacts; `failure` as above.
    """
    from fmopt.planning.pipeline import RESERVED, synthesise
    from fmopt.runtime.clock import clock

    begun = clock()  # what is explained of a failure shares the time limit
    try:
        found = synthesise(problem, progress, RESERVED)  # leaves that share of the time to `explained`
    except (SearchError, InfeasibleError) as error:
        from fmopt.notebook.failure import explained

        explained(problem, error, begun, progress)
        raise  # the same error, which has its failure now
    return Plan(found.document, found.seconds)


def read(path: str | PathLike[str]) -> Plan:
    """The plan of a file; what it states is not checked, `Plan.verify` does that.

    Raises:
        ResourceError: the file cannot be read.
        PlanFormatError: it is no plan of this format.
    """
    return Plan(files.read_document(Path(path)), name=str(path))
