"""Sums over the trials of one navigator among people, and their comparison with the baselines."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import inf
from statistics import median

import numpy as np

from study.people.crowd_trial import CrowdTrial, Series, WorldResult
from study.people.encounters import Exposure
from study.people.rates import HOUR_S, Rate
from study.statistics.intervals import Interval, Share, mean_interval

MINUTE_S = 60.0
HALF = 0.5
"""Wanted is this share of the trials in which the standing robot is touched."""


class Nearness:
    """Sums of the exposure in several drives or stays."""

    def __init__(self, exposures: Iterable[Exposure]) -> None:
        found = list(exposures)
        self.time_s = sum(one.time_s for one in found)
        self.person_s = sum(one.person_s for one in found)
        self._intruded_s = sum(one.intruded_s for one in found)
        self._soon_s = sum(one.soon_s for one in found)
        self.least_s = median(one.least_s for one in found) if found else inf

    @property
    def intruded_s_per_min(self) -> float:
        """Seconds with a person in the personal space, per minute."""
        return self._intruded_s / (self.time_s / MINUTE_S) if self.time_s else 0.0

    @property
    def soon_share(self) -> float:
        """Share of the time with a low time to collision."""
        return self._soon_s / self.time_s if self.time_s else 0.0


@dataclass(frozen=True)
class Comparison:
    """The trials of one navigator in worlds of one or several series of the same family."""

    series: tuple[Series, ...]
    navigator: str
    results: Sequence[WorldResult]

    @cached_property
    def trials(self) -> list[CrowdTrial]:
        """All trials, world by world."""
        return [trial for result in self.results for trial in result.trials[self.navigator]]

    @property
    def arrived(self) -> Share:
        """Trials that arrived without a contact."""
        return self._share(trial.arrived for trial in self.trials)

    @property
    def touched(self) -> Share:
        """Trials with a contact of any kind."""
        return self._share(trial.touched for trial in self.trials)

    @property
    def own(self) -> Share:
        """Trials with a contact by the robot's own motion."""
        return self._share(trial.own_contacts > 0 for trial in self.trials)

    @property
    def blocked(self) -> Share:
        """Worlds in which the omniscient robot finds no way without a contact."""
        return self._share(result.blocked for result in self.results)

    @property
    def standing(self) -> float:
        """Share of the trials in which the standing robot is touched, mean over its places."""
        return sum(trial.standing for trial in self.trials) / len(self.trials)

    @property
    def own_rate(self) -> Rate:
        """Own contacts per person-hour."""
        own_contacts = sum(trial.own_contacts for trial in self.trials)
        return Rate(own_contacts, self.nearness.person_s / HOUR_S)

    @cached_property
    def nearness(self) -> Nearness:
        """Exposure of all trials."""
        return Nearness(trial.exposure for trial in self.trials)

    @property
    def excess(self) -> float:
        """Share of trials touched, less half of the standing robot's share."""
        return self.touched.rate - HALF * self.standing

    @property
    def touched_interval(self) -> Interval:
        """Interval of the share of trials touched.

        Wilson's for one trial in each world, else over worlds as independent samples.
        """
        if len(self.trials) == len(self.results):
            return self.touched.interval
        return mean_interval(self._by_world(1.0, 0.0))

    @property
    def standing_interval(self) -> Interval:
        """Interval of the standing robot's share, over worlds as independent samples."""
        return mean_interval(self._by_world(0.0, 1.0))

    @property
    def excess_interval(self) -> Interval:
        """Interval of `excess`, paired by worlds, which are the independent samples."""
        return mean_interval(self._by_world(1.0, -HALF))

    @property
    def verdict(self) -> str:
        """`met` or `missed` if the whole interval of `excess` is on one side of 0."""
        low, high = self.excess_interval
        if high <= 0.0:
            return "met"
        return "missed" if low > 0.0 else "not decided"

    def _by_world(self, touched: float, standing: float) -> list[float]:
        """Return the mean over the trials of each world of a weighted sum of both contacts."""
        return [
            float(
                np.mean(
                    [
                        touched * trial.touched + standing * trial.standing
                        for trial in result.trials[self.navigator]
                    ]
                )
            )
            for result in self.results
        ]

    @staticmethod
    def _share(found: Iterable[bool]) -> Share:
        values = list(found)
        return Share(sum(values), len(values))


def pooled(first: Comparison, *others: Comparison) -> Comparison:
    """Return the comparison over the worlds of all; the navigator is that of the first."""
    every = (first, *others)
    return Comparison(
        tuple(series for one in every for series in one.series),
        first.navigator,
        [result for one in every for result in one.results],
    )
