"""Does it grow? A slope with its confidence, and the first third against the last."""

from collections.abc import Sequence
from math import inf, sqrt
from statistics import fmean, median
from typing import Final, NamedTuple

SETTLE_S: Final = 60.0
"""A process that has just been started still grows: so much of its life is left out, or a third."""
BLOCK_S: Final = 30.0
"""Samples a second apart say much the same: their means over this count as one, or six a life."""
TEN_MINUTES_S: Final = 600.0

Life = Sequence[tuple[float, float]]
"""Time in seconds and value, of one process from its start to its end."""


class Trend(NamedTuple):
    """Per ten minutes, within 95 %; `margin` is infinite when there was too little to tell."""

    slope: float
    margin: float
    first: float
    last: float
    longest_s: float


def trend(lives: Sequence[Life]) -> Trend | None:
    """One slope for all lives of a process, each from a level of its own; None without samples."""
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
    if not life:
        return life
    begin_s, end_s = life[0][0], life[-1][0]
    after_s = begin_s + min(SETTLE_S, (end_s - begin_s) / 3)
    return [sample for sample in life if sample[0] >= after_s]


def blocks(life: Life) -> list[tuple[float, float]]:
    """Means of time and value over pieces of the same length."""
    begin_s, end_s = life[0][0], life[-1][0]
    length_s = min(BLOCK_S, (end_s - begin_s) / 6) or BLOCK_S
    found: dict[int, list[tuple[float, float]]] = {}
    for sample in life:
        found.setdefault(int((sample[0] - begin_s) / length_s), []).append(sample)
    return [(fmean(t for t, _ in part), fmean(v for _, v in part)) for part in found.values()]


def common_slope(lives: Sequence[Life]) -> tuple[float, float]:
    """Least squares within the lives: slope and its 95 % margin, per second."""
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
    middle_t, middle_v = fmean(t for t, _ in life), fmean(v for _, v in life)
    return [(t - middle_t, v - middle_v) for t, v in life]


def student(freedom: int) -> float:
    """Student's t at 97.5 %, within 1 % of the tables from 3 degrees of freedom on."""
    return 1.96 + 2.37 / freedom + 2.82 / freedom**2 + 2.5 / freedom**3
