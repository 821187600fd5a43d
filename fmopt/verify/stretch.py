"""That the pieces of a move fit executions that are longer or shorter than the move.

The execution. The controller follows the commanded pieces of a move one after the other and stops as it touches: the
piece in which it touches is cut short, or the last piece goes on. The model of `motion` measures each execution on its
own way instead, and stretches every piece alike. Let V′ₖ be the twist of piece k per unit of the move's progress, λ_k
by how much more than planned an execution has progressed when, on its own way, piece k ends. What it has done then is
the commanded motion up to s_k + λ_k, where the model has Σ_{j≤k} (s_j − s_{j−1} + λ_j − λ_{j−1}) V′ⱼ. The difference is

    D_k = ∫ V′ ds over [s_k, s_k + λ_k] − Σ_{j≤k} (λ_j − λ_{j−1}) V′ⱼ = Σ_b c_{bk} (V′_{b+1} − V′_b),

    c_{bk} = λ_b + (s_b − s_k − λ_k)⁺ for boundaries b < k,   c_{bk} = (λ_k − (s_b − s_k))⁺ for b ≥ k.

Executions never turn back, s_b + λ_b ≤ s_k + λ_k for b < k, so the bracket of the first is at most (−λ_b)⁺ and
|c_{bk}| ≤ Λ_b = Σ_{j≤b} o_j (s_j − s_{j−1}) for all k, o_j the overtravel bound of piece j. What lies along the
compliant directions C, the same for all pieces, the contacts take up; with Π_k the projector along C at piece k,

    |Π_k D_k| ≤ Σ_b Λ_b |Π_k (V′_{b+1} − V′_b)|

holds for translations, exactly, and for rotations, which compose, to first order. A move whose pieces share one twist
up to the compliance has nothing here. Up to `LEFT_ASIDE` of it is allowed to a move and left aside: it is not added to
the errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from fmopt.verify.findings import LEFT_ASIDE, Notes, micrometres
from fmopt.verify.linear import image, row_of
from fmopt.verify.rational import SLACK, Row, Square, fixed, length, number, over, times


@dataclass(frozen=True)
class Leg:
    """A piece of a move, as far as the fit of the pieces is concerned.

    Attributes:
        twist: V = (Δ, ω).
        progress: its share of the move, s₁ − s₀.
        overtravel: bound of how much longer or shorter than V an execution's piece can be, as a share of V.
        directions: C, along which contacts give way.
        hold: projector along C.
    """

    twist: Row
    progress: int
    overtravel: int
    directions: tuple[Row, ...]
    hold: Square


def misfit(legs: Sequence[Leg]) -> tuple[int, int]:
    """Bounds of the translation (m) and rotation (rad) by which executions can differ from stretched pieces.

    Args:
        legs: the pieces of one move, in order.
    """
    rates = [row_of(over(x, leg.progress) for x in leg.twist) for leg in legs]
    jumps = [row_of(y - x for x, y in zip(a, b, strict=True)) for a, b in pairwise(rates)]
    lags: list[int] = []
    for leg in legs[:-1]:
        lags.append((lags[-1] if lags else 0) + times(leg.overtravel, leg.progress) + 1)
    translation = rotation = 0
    for leg in legs:
        felt = [image(leg.hold, jump) for jump in jumps]
        translation = max(translation, sum(times(lag, length(f[:3])) for lag, f in zip(lags, felt, strict=True)))
        rotation = max(rotation, sum(times(lag, length(f[3:])) for lag, f in zip(lags, felt, strict=True)))
    return translation + SLACK, rotation + SLACK


def check_fit(legs: Sequence[Leg], notes: Notes) -> None:
    """Notes when a move relies on its pieces being stretched alike.

    Args:
        legs: the pieces of one move that makes a contact, in order.
        notes: takes the finding.
    """
    if any(leg.directions != legs[0].directions for leg in legs):
        notes.add("pieces of the move", "do not give way along the same directions")
        return
    translation, rotation = misfit(legs)
    if translation > fixed(LEFT_ASIDE[0]) or rotation > fixed(LEFT_ASIDE[1]):
        notes.add(
            "pieces of the move",
            "do not share one twist: an execution that touches late would leave its error set by "
            f"{micrometres(number(translation))} / {number(rotation) * 1e6:.9g} µrad",
            number(translation),
        )
