"""Noise of sensors: standard normal samples, each body from its own stream."""

from collections.abc import Sequence

import numpy as np

from fmopt.spatial.values import Array

_BLOCK = 256  # periods of noise drawn at once


class Noise:
    """Standard normal samples (n, width) a call, each body from its own stream, another at each attempt."""

    def __init__(self, seed: int, numbers: Sequence[int], attempt: int = 0, width: int = 6) -> None:
        # Counted from 1: NumPy fills seeds up with zeros, so that 0 would give the stream of `draw` again.
        self.streams = [np.random.default_rng([seed, number, 1 + attempt]) for number in numbers]
        self.block, self.used, self.width = np.zeros((len(numbers), 0, width)), 0, width

    def __call__(self) -> Array:
        if self.used == self.block.shape[1]:
            self.block = np.stack([stream.standard_normal((_BLOCK, self.width)) for stream in self.streams])
            self.used = 0
        self.used += 1
        return np.asarray(self.block[:, self.used - 1])
