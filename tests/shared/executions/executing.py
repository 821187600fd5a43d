"""Sampled executions by the hundred thousand: none may leave what its plan promises.

python executing.py --count 200000 --seed 0 PLAN..., to execute at length: every plan takes its share of the count.
"""

import argparse
import json
import sys
import time
from pathlib import Path

from tests.shared.executions.model import Plan, execute
from tests.shared.executions.promises import Ledger

BATCH = 500


def executed(plan: Plan, count: int, seed: int, steps: int = 4) -> Ledger:
    """Executes a plan in batches, and enters what was seen in all of them."""
    total = Ledger()
    for done in range(0, count, BATCH):
        found = execute(plan, min(BATCH, count - done), seed + done, steps)
        for key, slack in found.least.items():
            total.least[key] = min(total.least.get(key, slack), slack)
        for key, share in found.share.items():
            total.share[key] = max(total.share.get(key, share), share)
    return total


def told(ledger: Ledger) -> str:
    """What was seen, in a line: promises broken, and how far out the executions went."""
    fullest = max(share for (check, _), share in ledger.share.items() if check == "tube")
    broken = sorted(ledger.broken.items(), key=lambda item: item[1])
    worst = "; ".join(f"{check} in segment {k} by {-slack:.3g}" for (check, k), slack in broken[:5])
    return f"{len(broken)} promises broken, error sets used to {100.0 * fullest:.2f} % {worst}".rstrip()


def main() -> int:
    """Executes the plans that are named, and prints what was seen."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("plans", nargs="+", type=Path)
    parser.add_argument("--count", type=int, default=200_000)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    broken = 0
    for n, file in enumerate(asked.plans):
        began, share = time.perf_counter(), asked.count // len(asked.plans) + (n < asked.count % len(asked.plans))
        ledger = executed(json.loads(file.read_text()), share, asked.seed + 1_000_000 * n)
        broken += len(ledger.broken)
        print(f"{file}: {share} in {time.perf_counter() - began:.0f} s, {told(ledger)}", flush=True)
    return 0 if not broken else 1


if __name__ == "__main__":
    sys.exit(main())
