"""Random streams: every source has its own stream, by name, independent of all others.

Streams are read in whole rows, so that a tick always consumes the same numbers, whatever it uses.
They are drawn in blocks, because drawing single numbers costs more than the simulation.
"""

from collections.abc import Callable
from typing import Final
from zlib import crc32

import numpy as np
import numpy.typing as npt

BLOCK_ROWS: Final = 64


def stream(seed: int, robot: int, source: str) -> np.random.Generator:
    """Return the generator of one named source of one robot; equal names give equal numbers.

    Raises ValueError if the seed is negative.
    """
    if seed < 0:
        raise ValueError(f"seed: {seed} is negative")
    name = crc32(source.encode())
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(robot, name)))


class Rows:
    """Endless rows of random numbers of one source."""

    __slots__ = ("_draw", "_left", "_width")

    def __init__(
        self, draw: Callable[[tuple[int, int]], npt.NDArray[np.float64]], width: int
    ) -> None:
        self._draw = draw
        self._width = width
        self._left: list[list[float]] = []

    def next(self) -> list[float]:
        """Return the next row."""
        if not self._left:
            self._left = self._draw((BLOCK_ROWS, self._width)).tolist()[::-1]
        return self._left.pop()


def gaussian_rows(seed: int, robot: int, source: str, width: int) -> Rows:
    """Return rows of independent standard normal numbers."""
    return Rows(stream(seed, robot, source).standard_normal, width)


def uniform_rows(seed: int, robot: int, source: str, width: int) -> Rows:
    """Return rows of independent numbers from 0 to below 1."""
    return Rows(stream(seed, robot, source).random, width)
