"""Random streams: every source has its own stream, by name, independent of all others.

The bits of PCG64 are specified; numpy promises them for all versions, but not the numbers that its
`Generator` makes of them. So this module maps the bits itself, by operations that are exact or
rounded as IEEE 754 says: the numbers are the same on every machine.

Streams are read in whole rows, so that a tick always consumes the same numbers, whatever it uses.
They are drawn in blocks, because drawing single numbers costs more than the simulation.
"""

from collections.abc import Callable
from math import factorial, pi
from typing import Final, TypeAlias
from zlib import crc32

import numpy as np
import numpy.typing as npt

BLOCK_ROWS: Final = 128
"""Rows whose normal numbers are made of each other's bits."""
BLOCKS: Final = 2
"""Blocks that are drawn together; the numbers do not depend on it."""

Bits: TypeAlias = npt.NDArray[np.uint64]
Numbers: TypeAlias = npt.NDArray[np.float64]

UNUSED_BITS: Final = np.uint64(11)
STEP: Final = 1.0 / (1 << 53)
"""The distance between neighbouring uniform numbers."""

LN_2: Final = 0.6931471805599453
ROOT_HALF: Final = 0.7071067811865476
LOG_SERIES: Final = tuple(2.0 / (2 * k + 1) for k in range(11))
SINE_SERIES: Final = tuple((1 - 2 * (k & 1)) / factorial(2 * k + 1) for k in range(9))
COSINE_SERIES: Final = tuple((1 - 2 * (k & 1)) / factorial(2 * k) for k in range(10))
"""Taylor coefficients; the terms that follow are below 1e-17."""


def stream(seed: int, robot: int, source: str) -> np.random.PCG64:
    """Return the bits of one named source of one robot; equal names give equal bits.

    Raises ValueError if the seed is negative.
    """
    if seed < 0:
        raise ValueError(f"seed: {seed} is negative")
    name = crc32(source.encode())
    return np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(robot, name)))


def uniform(bits: Bits) -> Numbers:
    """Return one number from 0 to below 1 for each 64 bits."""
    numbers: Numbers = (bits >> UNUSED_BITS).astype(np.float64)
    numbers *= STEP
    return numbers


def gaussian(bits: Bits) -> Numbers:
    """Return one standard normal number for each 64 bits, of which a row has an even number.

    The first half of each row gives the lengths of normal vectors, the second half their directions
    (Box and Muller): 53 bits the angle within a quarter turn, the lowest two the quarter.
    """
    half = bits.shape[-1] // 2
    lengths, angles = bits[..., :half], bits[..., half:]
    length = np.sqrt(-2.0 * _log(uniform(lengths) + STEP))
    angle_rad = (uniform(angles) - 0.5) * (0.5 * pi)
    square = angle_rad * angle_rad
    along = length * _series(COSINE_SERIES, square)
    across = length * (angle_rad * _series(SINE_SERIES, square))
    turned, opposite = angles & np.uint64(1) != 0, angles & np.uint64(2) != 0
    sign = np.where(opposite, -1.0, 1.0)
    numbers = np.where(turned, -across, along), np.where(turned, along, across)
    return np.concatenate([sign * numbers[0], sign * numbers[1]], axis=-1)


def _log(numbers: Numbers) -> Numbers:
    """Return natural logarithms by the series of the inverse hyperbolic tangent."""
    mantissa, exponent = np.frexp(numbers)
    small = mantissa < ROOT_HALF
    mantissa = np.where(small, 2.0 * mantissa, mantissa)
    share = (mantissa - 1.0) / (mantissa + 1.0)
    logs: Numbers = (exponent - small) * LN_2 + share * _series(LOG_SERIES, share * share)
    return logs


def _series(coefficients: tuple[float, ...], square: Numbers) -> Numbers:
    """Return the value of a polynomial, lowest coefficient first."""
    total = np.full_like(square, coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        total *= square
        total += coefficient
    return total


class Rows:
    """Endless rows of random numbers of one source."""

    __slots__ = ("_bits", "_block", "_numbers", "_width")

    def __init__(
        self, bits: np.random.PCG64, numbers: Callable[[Bits], Numbers], width: int
    ) -> None:
        self._bits = bits
        self._numbers = numbers
        self._width = width
        self._block: list[list[float]] = []

    def next(self) -> list[float]:
        """Return the next row."""
        if not self._block:
            bits = self._bits.random_raw(BLOCKS * BLOCK_ROWS * self._width)
            numbers = self._numbers(bits.reshape(BLOCKS, -1))
            self._block = numbers.reshape(-1, self._width)[::-1].tolist()
        return self._block.pop()


def gaussian_rows(seed: int, robot: int, source: str, width: int) -> Rows:
    """Return rows of independent standard normal numbers."""
    return Rows(stream(seed, robot, source), gaussian, width)


def uniform_rows(seed: int, robot: int, source: str, width: int) -> Rows:
    """Return rows of independent numbers from 0 to below 1."""
    return Rows(stream(seed, robot, source), uniform, width)
