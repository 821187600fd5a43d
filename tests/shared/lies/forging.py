"""Forged plans and mutants by the thousand: none may pass that is false, break a command or, at length, take long.

python forging.py --count 10000 --seed 0 --problems ../problems PLAN..., to forge at length: every plan takes its share
of the count, half of it forged, half of it mutants. A plan's problem is the file of its name, plan.json that of its
folder's.
"""

import argparse
import contextlib
import io
import json
import random
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain, islice
from pathlib import Path
from unittest import mock

from fmopt.cli import entry
from fmopt.planning.same_problem import differences
from fmopt.task.problem import load
from fmopt.verify import PlanError
from fmopt.verify.reading.parse import parse
from tests.shared.lies.forger import LIES, Court, Differences, forged
from tests.shared.lies.lie import SAMPLING, Document
from tests.shared.lies.mutations import claims, junk, numbers

SLOWER, LEAST = 10.0, 0.05  # times its original's check, which counts as this many seconds at least
INTERNAL = 70
COMMANDS = (
    ("verify", "{plan}"),
    ("show", "{plan}", "--out", "{folder}/shown.html"),
    ("export", "{plan}", "--to", "urscript", "--out", "{folder}/program.script", "--base", *"000000"),
    ("export", "{plan}", "--unverified", "--to", "csv", "--out", "{folder}/table.csv"),
)


@dataclass
class Account:
    """What came of it: how many of each kind ended how, and what must not be, in words."""

    ends: Counter[str] = field(default_factory=Counter)
    false: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    slow: list[str] = field(default_factory=list)

    @property
    def clean(self) -> bool:
        """Whether nothing was found that must not be."""
        return not (self.false or self.faults or self.slow)


def forgeries(plan: Document, count: int, seed: int) -> Iterator[tuple[str, str, Document]]:
    """Forged plans as (name, oracle, plan), one kind of lie after the other."""
    tried = 0
    for n in range(1000 * count):
        if tried == count:
            return
        lie = LIES[n % len(LIES)]
        with contextlib.suppress(PlanError):
            found = forged(plan, lie, seed + n)
            if found is not None:
                tried += 1
                yield f"{lie.name}, seed {seed + n}", lie.oracle, found


def mutants(plan: Document, count: int, seed: int) -> Iterator[tuple[str, str, Document]]:
    """Random mutants as (name, oracle, plan): half of them junk, the others changed numbers and claims."""
    half = count // 2
    for k, found in enumerate(junk(plan, half, seed)):
        yield f"junk {k}, seed {seed}", SAMPLING, found
    pick = random.Random(seed)
    worse = chain(numbers(plan, 1 + count // 60, seed), claims(plan)) if _mutable(plan) else iter(())
    kept = [entry for entry in islice(worse, 2 * count) if pick.random() < 0.5]
    for name, found in kept[: count - half]:
        yield name, SAMPLING, found


def _mutable(plan: Document) -> bool:
    """Whether a plan makes and holds contacts, which the changed claims are about."""
    return any(s["hybrid"]["normal_forces"] for s in plan["segments"]) and any(s["contacts"] for s in plan["segments"])


def run(
    plan: Document, differences: Differences | None, count: int, seed: int, account: Account, *, commands: bool = True
) -> None:
    """Forges an honest plan so many times and enters what comes of it, of commands tried on the forgeries too.

    Differences are what a plan states otherwise than its problem; None where it has none.
    """
    court = Court(plan, differences, executions=100)
    allowed = SLOWER * max(LEAST, min(court.judge(plan, SAMPLING).seconds for _ in range(3)))
    half = count // 2
    for name, oracle, found in chain(forgeries(plan, half, seed), mutants(plan, count - half, seed)):
        kind = "junk" if name.startswith("junk") else name.split(",")[0].split(" (")[0]
        try:
            judged = court.judge(found, oracle)
        except Exception as error:  # noqa: BLE001 (whatever comes is what is looked for)
            account.faults.append(f"{name}: {type(error).__name__}: {error}")
            continue
        account.ends[
            f"{kind}: {'false and accepted' if judged.false else 'accepted' if judged.accepted else 'refused'}"
        ] += 1
        if judged.false:
            account.false.append(f"{name}: {judged.false}")
        if judged.seconds > allowed:
            account.slow.append(f"{name}: {judged.seconds:.2f} s where {allowed:.2f} s are allowed")
        if commands:
            account.faults += [f"{name}: {fault}" for fault in faults(found)]


def faults(plan: Document) -> list[str]:
    """The commands that end with an internal fault on a plan, with what they say."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "plan.json"
        file.write_text(json.dumps(plan))
        for command in COMMANDS:
            words = [word.format(plan=file, folder=folder) for word in command]
            code, said = called(words)
            if code == INTERNAL:
                found.append(f"{' '.join(command)}: {said.strip()[-200:]}")
    return found


def called(words: list[str]) -> tuple[int, str]:
    """A command's exit code and what it says on standard error."""
    said = io.StringIO()
    with (
        mock.patch.object(sys, "argv", ["fmopt", *words]),
        contextlib.redirect_stderr(said),
        contextlib.redirect_stdout(io.StringIO()),
    ):
        try:
            entry.main()
        except SystemExit as end:
            return int(end.code or 0), said.getvalue()
    return 0, said.getvalue()


def problem_of(plan: Path, problems: Path) -> Differences | None:
    """What a plan states otherwise than the problem of its name; None where there is none."""
    name = plan.parent.name if plan.name == "plan.json" else plan.stem
    files = sorted(problems.rglob(f"{name}.toml"))
    if not files:
        return None
    problem = load(files[0])
    return lambda document: differences(parse(document), problem)


def main() -> int:
    """Forges the plans that are named, and prints what comes of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("plans", nargs="+", type=Path)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--problems", type=Path, required=True)
    asked = parser.parse_args()
    account = Account()
    for n, file in enumerate(asked.plans):
        began, seed = time.perf_counter(), asked.seed + 1_000_000 * n
        share = asked.count // len(asked.plans) + (n < asked.count % len(asked.plans))
        run(json.loads(file.read_text()), problem_of(file, asked.problems), share, seed, account)
        print(f"{file}: {share} in {time.perf_counter() - began:.0f} s, so far {_summary(account)}", flush=True)
    for what in (account.false, account.faults, account.slow):
        print("\n".join(what))
    print("\n".join(f"{end}: {count}" for end, count in sorted(account.ends.items())))
    print(_summary(account))
    return 0 if account.clean else 1


def _summary(account: Account) -> str:
    passed = sum(count for end, count in account.ends.items() if end.endswith("accepted"))
    return (
        f"{account.ends.total()} judged, {passed} accepted, {len(account.false)} of them false; "
        f"{len(account.faults)} internal faults, {len(account.slow)} slow"
    )


if __name__ == "__main__":
    sys.exit(main())
