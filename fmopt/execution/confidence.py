"""Confidence in success rates: Clopper–Pearson intervals, which hold for few trials and for rates near 0 and 1, too."""

from scipy.stats import binomtest

from fmopt.plan.evidence import CONFIDENCE


def success_interval(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Two-sided Clopper–Pearson interval of a success rate; (0, 1) without trials."""
    if not trials:
        return 0.0, 1.0
    found = binomtest(successes, trials).proportion_ci(confidence, method="exact")
    return float(found.low), float(found.high)


def lower_bound(successes: int, trials: int, confidence: float = CONFIDENCE) -> float:
    """One-sided Clopper–Pearson lower bound of a success rate; 0 without trials."""
    if not trials:
        return 0.0
    return float(binomtest(successes, trials, alternative="greater").proportion_ci(confidence, method="exact").low)
