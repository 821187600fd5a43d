"""Every error that leaves the package: one tree, each leaf with its exit code, its data and its advice."""

from dataclasses import dataclass
from typing import Any, ClassVar


class FmoptError(Exception):
    """Base of all errors that the package raises on purpose."""

    exit_code: ClassVar[int] = 70

    def __init__(self, message: str, advice: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.advice = advice

    def __str__(self) -> str:
        return f"{self.message}; {self.advice}" if self.advice else self.message

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild, (type(self), self.args, dict(self.__dict__))


def _rebuild(cls: type[FmoptError], args: tuple[Any, ...], state: dict[str, Any]) -> FmoptError:
    error = cls.__new__(cls)
    error.args = args
    error.__dict__.update(state)
    return error


@dataclass(frozen=True, order=True)
class Fault:
    """One fault of an input file: place, code, message and advice. Lines and columns count from 1."""

    file: str
    line: int
    column: int
    key: str
    code: str
    message: str
    advice: str = ""

    def __str__(self) -> str:
        where = f"{self.file}:{self.line}:{self.column}: {self.code}: "
        key = f"{self.key}: " if self.key else ""
        return where + key + self.message + (f"; {self.advice}" if self.advice else "")


class InputError(FmoptError):
    """A problem, model, plan or option that cannot be used; carries every fault that was found."""

    exit_code = 2

    def __init__(self, *faults: Fault) -> None:
        self.faults = tuple(sorted(faults))
        super().__init__("\n".join(str(fault) for fault in self.faults))


class GeometryError(FmoptError):
    """A solid that is empty, open, inside out or otherwise not a solid."""

    exit_code = 2


class SizeError(GeometryError):
    """A part so large or so small that its unit must be wrong; `size` in metres."""

    def __init__(self, message: str, size: float, advice: str = "") -> None:
        super().__init__(message, advice)
        self.size = size


class InterferenceError(FmoptError):
    """The parts overlap when assembled: no motion exists."""

    exit_code = 1

    def __init__(self, message: str, interference: float, place: str, advice: str = "") -> None:
        super().__init__(message, advice)
        self.interference = interference
        self.place = place


class InfeasibleError(FmoptError):
    """A state, placement or sequence on the way that does not exist; `shortfall` in metres.

    That no other way leads to the goal is not proven, as it is where parts overlap, `InterferenceError`.

    `attempt` is how far a motion came, `fmopt.planning.motion.Failed`, where one was looked for, and `failure` what
    there is to say of it, `fmopt.report.attempt.Failure`, where that was worked out. `share` is what a sequence takes
    of all errors, about; 0 where that is not known.
    """

    exit_code = 3
    share: float = 0.0
    attempt: Any = None
    failure: Any = None

    def __init__(self, message: str, shortfall: float = 0.0, advice: str = "") -> None:
        super().__init__(message, advice)
        self.shortfall = shortfall


class TaskError(FmoptError):
    """A task command, or an object of the knowledge base, that breaks a rule."""

    exit_code = 2

    def __init__(self, message: str, feature: str, rule: str, advice: str = "") -> None:
        super().__init__(f"{message} (rule: {rule})", advice)
        self.feature = feature
        self.rule = rule


class SearchError(FmoptError):
    """No motion was found; that none exists is not proven.

    Args:
        late: whether a time limit ended it, so that how far it came depends on the machine.
        attempt: how far it came, `fmopt.planning.motion.Failed`; None where no motion could begin.

    `failure` is what there is to say of that, `fmopt.report.attempt.Failure`, where it was worked out.
    """

    exit_code = 3
    failure: Any = None

    def __init__(self, message: str, advice: str = "", late: bool = False, attempt: Any = None) -> None:
        super().__init__(message, advice)
        self.late = late
        self.attempt = attempt


class OverdueError(FmoptError):
    """A time limit ended a computation before it had a result; how far it came depends on the machine."""

    exit_code = 3


class SolverError(FmoptError):
    """A solver stopped without a point that passes its own re-check."""

    exit_code = 3


class UnprovedError(FmoptError):
    """A plan that the check does not certify, where only a certified one is taken."""

    exit_code = 3

    def __init__(self, message: str, findings: tuple[str, ...], advice: str = "") -> None:
        super().__init__(message, advice)
        self.findings = findings


class PlanFormatError(FmoptError):
    """A plan file that is no `fmopt.plan/2` document."""

    exit_code = 2


class ResourceError(FmoptError):
    """A file, folder, lock or memory that could not be had."""

    exit_code = 4


class ChoiceError(FmoptError):
    """The name of a drawing, format or example that there is none of; the advice says which there are."""

    exit_code = 2


class SettingsError(FmoptError):
    """Settings of a simulation with which its result would say nothing."""

    exit_code = 2


class Interruption(BaseException):
    """A signal asks the command to end; `run` of `fmopt.runtime.process` turns it into an exit code.

    No `Exception`, so that nobody takes it for a failure of what was being done.
    """

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number
