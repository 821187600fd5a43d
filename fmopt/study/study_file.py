"""The tables of a study file: a base problem, axes over its parameters, how they are sampled, what is computed."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from fmopt.task.toml.problem_file import Units
from fmopt.task.toml.tables import Distance, Duration, File, Name, Parameter, Ratio, Table, Title

# Read later: whether it is a length, an angle or a word depends on the parameters that it is for.
Value: TypeAlias = Parameter
Path: TypeAlias = Annotated[str, Field(min_length=1, max_length=200)]
Expression: TypeAlias = Annotated[str, Field(min_length=1, max_length=200)]
Positive: TypeAlias = Annotated[int, Field(ge=1, le=1_000_000_000)]


class AxisTable(Table):
    """A parameter that varies: by values, by a range, or by a distribution."""

    name: Name
    """What the tables call it, and expressions."""
    sets: (
        Annotated[tuple[Path, ...], Field(min_length=1, max_length=64)]
        | Annotated[dict[Path, Expression], Field(min_length=1, max_length=64)]
    )
    """Paths of the parameters that take its value; or a table of paths with arithmetic on the names of axes."""
    values: Annotated[tuple[Value, ...], Field(max_length=100_000)] | None = None
    """The values it takes, numbers or words."""
    low: Value | None = None
    """Least value of a range; of a normal distribution, where it is cut off."""
    high: Value | None = None
    """Greatest value."""
    steps: Annotated[int, Field(ge=1, le=100_000)] | None = None
    """Number of values in a range, for grids and lists."""
    spacing: Literal["linear", "log"] = "linear"
    """Whether steps, or a uniform distribution, are even in the value or in its logarithm."""
    mean: Value | None = None
    """Mean of a normal distribution."""
    deviation: Value | None = None
    """Its standard deviation."""
    linked: Name | None = None
    """An axis that this one moves along with: value by value, or at the same quantile."""


class Sampling(Table):
    """How the axes are sampled."""

    method: Literal["grid", "list", "random", "latin-hypercube", "sobol", "saltelli"] = "grid"
    """Every combination; value by value; or points in the cube. "saltelli" is made for Sobol indices."""
    runs: Positive | None = None
    """Number of points in the cube; a power of two for "sobol" and "saltelli", which makes k + 2 times as many."""
    seed: Annotated[int, Field(ge=0, lt=2**63)] | None = None
    """Seed of the points in the cube."""


class RunLimits(Table):
    """What one run may take, and how many runs are meant."""

    time: Duration | None = None
    """Time after which a run is given up."""
    memory_mb: Annotated[int, Field(ge=64, le=1_000_000)] | None = None
    """Address space of a worker in MB (10^6 bytes)."""
    runs: Positive = 100_000
    """Greatest number of runs that is no accident, 100 000 if not given."""


class StudyFile(Table):
    """A batch study for fmopt."""

    title: Title
    problem: File
    """The base problem, relative to this file."""
    units: Units
    compute: Annotated[tuple[Name, ...], Field(min_length=1, max_length=32)]
    """What to compute of each run."""
    plan: File | None = None
    """A plan of presses, relative to this file, whose evidence is computed as it is; without it, of one plan a run."""
    keep: tuple[Literal["plan"], ...] = ()
    """What to keep of each run beside its row of the table."""
    axes: tuple[AxisTable, ...]
    sampling: Sampling = Field(default_factory=Sampling)
    limits: RunLimits = Field(default_factory=RunLimits)


class ToleranceTable(Table):
    """A tolerance that may be changed."""

    name: Name
    sets: Annotated[tuple[Path, ...], Field(min_length=1, max_length=16)]
    """Paths of what it stands for, all below `uncertainty`; they have one value."""
    weight: Annotated[float, Field(ge=0.0, le=1e9)] = 1.0
    """What it costs as it is now; half the tolerance costs twice that."""
    low: Value | None = None
    """Tightest value allowed; the present one if not given, so that it is only loosened."""
    high: Value | None = None
    """Loosest value allowed; ten times the present one if not given."""


class AllocationFile(Table):
    """Which tolerances can be loosened, at given weights, with the insertion still certified."""

    title: Title
    problem: File
    """The base problem, relative to this file."""
    units: Units
    margin: Distance
    """Least margin that the motion must keep."""
    gap: Ratio = 0.005
    """How near to the least possible cost is near enough, as a fraction."""
    tolerances: Annotated[tuple[ToleranceTable, ...], Field(max_length=32)]
