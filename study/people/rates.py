"""Rates of rare events per person-hour, with an exact interval."""

from math import exp, inf, nan
from typing import Final, NamedTuple

from study.statistics.intervals import CONFIDENCE, Interval

HOUR_S: Final = 3600.0


class Rate(NamedTuple):
    """Events in a number of person-hours."""

    events: int
    hours: float

    @property
    def per_hour(self) -> float:
        """Events per person-hour; NaN in no time."""
        return self.events / self.hours if self.hours else nan

    @property
    def interval(self) -> Interval:
        """Exact two-sided Poisson interval of the events per hour (Garwood 1936)."""
        low, high = poisson_interval(self.events)
        return Interval(low / self.hours, high / self.hours) if self.hours else Interval(0.0, inf)


def poisson_interval(count: int, confidence: float = CONFIDENCE) -> Interval:
    """Return the exact interval of the mean of a Poisson count; its low end is 0 for none."""
    tail = (1.0 - confidence) / 2.0
    low = 0.0 if count == 0 else _mean_where(count - 1, 1.0 - tail)
    return Interval(low, _mean_where(count, tail))


def _mean_where(count: int, probability: float) -> float:
    """Return the mean at which at most `count` events have this probability."""
    low, high = 0.0, 10.0 + 2.0 * count
    while at_most(count, high) > probability:
        high *= 2.0
    for _ in range(100):
        middle = (low + high) / 2.0
        low, high = (middle, high) if at_most(count, middle) > probability else (low, middle)
    return (low + high) / 2.0


def at_most(count: int, mean: float) -> float:
    """Return the probability of at most `count` events; the mean must be below 700."""
    term = total = exp(-mean)
    for k in range(1, count + 1):
        term *= mean / k
        total += term
    return min(1.0, total)
