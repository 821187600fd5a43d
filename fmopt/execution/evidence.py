"""Evidence: a frozen plan of presses carried out for draws that nothing was chosen on, and for all vertices."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from fmopt.execution.confidence import lower_bound
from fmopt.execution.engines.engine import Bodies
from fmopt.execution.engines.mujoco_engine import version
from fmopt.execution.press_trials import carry_out, count_presses, drawn_errors, vertex_errors
from fmopt.plan.evidence import CONFIDENCE, MAX_WAYS, MIN_VERTICES, VERTICES, Evidence, TrialOutcome, cycle_times
from fmopt.plan.press import Conditions, PressPlan
from fmopt.runtime.process import cores


@dataclass(frozen=True)
class Examination:
    """How a plan is examined."""

    draws: int
    min_rate: float  # that the bound has to reach
    seed: int
    examined: int = 1  # number of the plan among those examined for the problem, from 1
    threads: int | None = None  # of the physics engine, None for as many as there are cores
    max_time: float | None = None  # s, within which 95 % of the draws that seat have to be through; None for no limit
    vertices: bool = True  # whether those of the start box are tried, too; without them a plan is not tested

    @property
    def trials(self) -> int:
        """Draws, and vertices where they are tried."""
        return self.draws + VERTICES * self.vertices


def examine(
    bodies: Bodies, plan: PressPlan, conditions: Conditions, asked: Examination, subject: str,
    progress: Callable[[str], None] = lambda _: None,
) -> Evidence:  # fmt: skip
    """Carries a plan out for all draws and vertices, whatever comes of the first ones."""
    presses, threads = count_presses(plan), asked.threads or cores()
    numbers = range(asked.trials)
    progress(f"evidence: {asked.draws} draws and {asked.trials - asked.draws} vertices")
    errors = drawn_errors(conditions, presses, asked.seed, numbers[: asked.draws])
    if asked.vertices:
        errors = errors.followed_by(vertex_errors(conditions, presses))
    outcomes = _with_few_ways(carry_out(bodies, plan, errors, asked.seed, numbers, threads=threads))
    drawn, vertices = outcomes[: asked.draws], outcomes[asked.draws :]
    seated, at_vertices = (sum(one.seated for one in some) for some in (drawn, vertices))
    bound, times = lower_bound(seated, asked.draws), cycle_times(drawn)
    in_time = asked.max_time is None or times is None or times[1] <= asked.max_time
    return Evidence(
        level="tested" if bound >= asked.min_rate and at_vertices >= MIN_VERTICES and in_time else "below",
        draws=asked.draws,
        seated=seated,
        first_tries=sum(one.seated and one.attempt == 0 for one in drawn),
        confidence=CONFIDENCE,
        bound=bound,
        min_rate=asked.min_rate,
        vertices=len(vertices),
        vertices_seated=at_vertices,
        examined=asked.examined,
        seed=asked.seed,
        engine=version(),
        conditions=conditions,
        subject=subject,
        outcomes=tuple(drawn),
        vertex_outcomes=tuple(vertices),
        max_time=asked.max_time,
    )


def _with_few_ways(outcomes: Sequence[TrialOutcome]) -> list[TrialOutcome]:
    """The outcomes with the ways of a few of them, of each kind of failure the first ones."""
    seen, ranks = Counter[tuple[str, str]](), dict[int, int]()
    for number, one in enumerate(outcomes):
        if one.way:
            ranks[number] = seen[one.press, one.kind]
            seen[one.press, one.kind] += 1
    few = sorted(ranks, key=ranks.__getitem__)[:MAX_WAYS]
    return [replace(one, way=one.way if number in few else ()) for number, one in enumerate(outcomes)]
