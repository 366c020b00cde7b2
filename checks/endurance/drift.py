"""Estimate how fast a quantity grows: slope with confidence, first third against last third."""

from collections.abc import Sequence
from math import inf, sqrt
from statistics import fmean, median
from typing import Final, NamedTuple

SETTLE_S: Final = 60.0
"""A new process still grows: this beginning of its life is left out, at most a third of it."""
BLOCK_S: Final = 30.0
"""Samples a second apart correlate, so means over blocks count; a life has at least six."""
TEN_MINUTES_S: Final = 600.0

Life = Sequence[tuple[float, float]]
"""Time in seconds and value, of one process from its start to its end."""


class Trend(NamedTuple):
    """A slope per ten minutes with its 95 % margin, which is infinite with too few samples."""

    slope: float
    margin: float
    first: float
    last: float
    longest_s: float


def trend(lives: Sequence[Life]) -> Trend | None:
    """Fit one slope to all lives of a process, each with its own level; None without samples."""
    settled = [one for one in map(settle, lives) if one]
    if not settled:
        return None
    slope, margin = common_slope([blocks(life) for life in settled])
    values = [value for life in settled for _, value in life]
    third = max(1, len(values) // 3)
    return Trend(
        slope=slope * TEN_MINUTES_S,
        margin=margin * TEN_MINUTES_S,
        first=median(values[:third]),
        last=median(values[-third:]),
        longest_s=max(life[-1][0] - life[0][0] for life in settled),
    )


def settle(life: Life) -> Life:
    """Leave out the beginning of a life."""
    if not life:
        return life
    begin_s, end_s = life[0][0], life[-1][0]
    after_s = begin_s + min(SETTLE_S, (end_s - begin_s) / 3)
    return [sample for sample in life if sample[0] >= after_s]


def blocks(life: Life) -> list[tuple[float, float]]:
    """Return the means of time and value over blocks of the same length."""
    begin_s, end_s = life[0][0], life[-1][0]
    length_s = min(BLOCK_S, (end_s - begin_s) / 6) or BLOCK_S
    found: dict[int, list[tuple[float, float]]] = {}
    for sample in life:
        found.setdefault(int((sample[0] - begin_s) / length_s), []).append(sample)
    return [(fmean(t for t, _ in part), fmean(v for _, v in part)) for part in found.values()]


def common_slope(lives: Sequence[Life]) -> tuple[float, float]:
    """Return the least-squares slope within the lives and its 95 % margin, per second."""
    pairs = [pair for life in lives for pair in centred(life)]
    spread = sum(t * t for t, _ in pairs)
    freedom = len(pairs) - len(lives) - 1
    if not spread:
        return 0.0, inf
    slope = sum(t * v for t, v in pairs) / spread
    if freedom < 1:
        return slope, inf
    rest = sum((v - slope * t) ** 2 for t, v in pairs)
    return slope, student(freedom) * sqrt(rest / freedom / spread)


def centred(life: Life) -> list[tuple[float, float]]:
    """Subtract the mean time and value."""
    middle_t, middle_v = fmean(t for t, _ in life), fmean(v for _, v in life)
    return [(t - middle_t, v - middle_v) for t, v in life]


def student(freedom: int) -> float:
    """Return Student's t at 97.5 %, within 1 % of the tables from 3 degrees of freedom on."""
    return 1.96 + 2.37 / freedom + 2.82 / freedom**2 + 2.5 / freedom**3
