"""What a plan promises about a piece of motion, in a form that can be asked of a real pose."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any

import numpy as np

from fmopt.plan.error_sets import PlanErrorSet
from tests.shared.executions.geometry import Array, Convex, Poses, cross, normal_of, unit

NANO, FLAT = 1e-10, 1e-20
TOUCHING = 1e-8


@dataclass
class Ledger:
    """What was seen: for each check and segment the least slack, below zero where the plan's promise was broken."""

    least: dict[tuple[str, int], float] = field(default_factory=dict)
    share: dict[tuple[str, int], float] = field(default_factory=dict)

    def require(self, check: str, segment: int, slack: Array) -> None:
        """Enters the slack of every execution; what is not a number counts as broken."""
        if slack.size:
            least = float(np.nan_to_num(slack, nan=-np.inf).min())
            self.least[check, segment] = min(self.least.get((check, segment), np.inf), least)

    def used(self, check: str, segment: int, share: Array) -> None:
        """Enters the share of an allowance that every execution used."""
        self.share[check, segment] = max(self.share.get((check, segment), 0.0), float(share.max(initial=0.0)))

    @property
    def broken(self) -> dict[tuple[str, int], float]:
        """The checks that failed, with the segment and the slack."""
        return {key: slack for key, slack in self.least.items() if slack < 0.0}


@dataclass(frozen=True, eq=False)
class Witness:
    """A plane that keeps a moving piece above and a fixed piece below it; a stated normal gets its own offset."""

    kind: str  # "plane", "fixed-face", "moving-face" or "edges"
    moving: Array
    fixed: Array
    # normal, offset: the plane, for "plane" and "fixed-face" in the fixed frame, for "moving-face" in the moving one
    normal: Array
    offset: float
    edges: tuple[Array, Array]  # points of the moving and of the fixed edge, (2, 3) each, for "edges"
    sign: float  # which way the normal of two edges points
    margin: float  # what the heights that count are stated to keep, m
    counted: Array  # which do: those of points that nothing brings to the plane
    beside: Array  # which others only stay on their side: held contacts may leave them there, by less than the margin
    radius: float = 0.0

    @staticmethod
    def read(moving: Convex, fixed: Convex, pair: dict[str, Any], landmarks: Sequence[Poses]) -> "Witness":
        """The witness of a pair; points that are on its plane at one of the nominal `landmarks` are not counted."""
        said, margin = pair["witness"], float(pair["margin"])
        a, b = moving.vertices[said["moving"]], fixed.vertices[said["fixed"]]
        normal = unit(np.array(said.get("normal", [1.0, 0.0, 0.0])))
        offset = float((fixed.vertices @ normal).max())
        if said["kind"] in ("fixed-face", "moving-face"):
            loop = b if said["kind"] == "fixed-face" else a
            normal, offset = normal_of(loop), float(normal_of(loop) @ loop[0])
        every = np.array([], dtype=bool)
        witness = Witness(
            *(said["kind"], moving.vertices, fixed.vertices, normal, offset, (a, b), 1.0, margin, every, every),
            moving.radius,
        )
        if witness.kind == "edges" and witness.heights(landmarks[0])[0, : len(moving.vertices)].mean() < 0.0:
            witness = replace(witness, sign=-1.0)
        low = np.min([witness.heights(poses)[0] for poses in landmarks], axis=0)
        counted = (low > max(TOUCHING, margin - TOUCHING)) | (witness.kind == "plane")
        return replace(witness, counted=counted, beside=(low > TOUCHING) & ~counted)

    def heights(self, poses: Poses) -> Array:
        """Distances (n, k) on the right side of the plane, m: of moving vertices, of fixed ones, or of both."""
        p, R = poses
        if self.kind == "moving-face":
            return np.asarray(np.einsum("nvi,ni->nv", self.fixed - p[:, None], R @ self.normal) - self.offset)
        X = self.moving @ R.transpose(0, 2, 1) + p[:, None]
        if self.kind != "edges":
            return np.asarray(X @ self.normal - self.offset - self.radius)
        (a, b), (c, d) = self.edges
        n = self.sign * unit(cross(R @ (b - a), d - c))
        return np.hstack([np.einsum("nvi,ni->nv", X - c, n), n @ (c - self.fixed).T])

    def least(self, poses: Poses) -> Array:
        """What is left (n,) of the heights that count, and of those that must not be negative."""
        heights = self.heights(poses)
        least = heights[:, self.counted].min(axis=1, initial=np.inf) - self.margin
        return np.asarray(np.minimum(least, heights[:, self.beside].min(axis=1, initial=np.inf)))


class Tube:
    """The error set at one end of a piece, where the check can derive one, and the half-widths that the plan states."""

    def __init__(self, said: dict[str, Any], found: Sequence[PlanErrorSet], rho: float) -> None:
        self.scale = np.repeat([1.0, rho], 3)
        self.box = np.array([*said["offset_box"], *said["angle_box"]])
        self.sets = found

    def check(self, ledger: Ledger, segment: int, errors: Array) -> None:
        """Whether errors (n, 6) are in the box and in both descriptions of the set."""
        ledger.require("tube", segment, (self.box + NANO - np.abs(errors)).min(axis=1))
        for found in self.sets:
            generators, e = found.generators * self.scale, errors * self.scale
            square = np.outer(self.scale, self.scale)
            slide, swing, shape = (Q * square for Q in (found.slide, found.swing, found.shape))
            N = _directions(generators)
            radii = (np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", N, Q, N), 0.0)) for Q in (slide, swing))
            h = np.abs(N @ generators.T).sum(axis=1) + sum(radii)
            seen = np.abs(e @ N.T)
            ledger.require("tube", segment, (h + NANO - seen).min(axis=1))
            wide = h > 1e-6
            ledger.used("tube", segment, (seen[:, wide] / h[wide]).max(axis=1, initial=0.0))
            gauge = np.sqrt(np.einsum("ni,ni->n", e, np.linalg.solve(shape + FLAT * np.eye(6), e.T).T))
            ledger.require("shape", segment, 1.0 + 1e-6 - gauge)
            ledger.used("shape", segment, gauge)


def _directions(generators: Array) -> Array:
    """Unit directions (k, 6): axes, the normals of the zonotope's facets, and some at random."""
    drawn = np.random.default_rng(0).normal(size=(60, 6))
    some = [np.eye(6), drawn / np.linalg.norm(drawn, axis=1, keepdims=True)]
    five = [list(c) for c in combinations(range(len(generators)), 5)]
    if five:
        some.append(np.linalg.svd(generators[five])[2][:, 5])
    return np.concatenate(some)
