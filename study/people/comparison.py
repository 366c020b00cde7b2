"""Compare navigators among people with the baselines: sums over trials, rates, and tables.

Rates of rare events are per person-hour and have an exact interval.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import exp, inf, isfinite, nan, pi
from statistics import median
from typing import Final, NamedTuple

import numpy as np

from robot.core.parameters import DEFAULTS
from study.intervals import CONFIDENCE, Interval, Proportion, mean_interval
from study.people.crowd_trial import CrowdTrial, TrialSeries, WorldResult
from study.people.encounters import PERSONAL_M, SOON_S, Exposure, PersonContact

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


def poisson_interval(count: int) -> Interval:
    """Return the exact interval of the mean of a Poisson count; its low end is 0 for none."""
    tail = (1.0 - CONFIDENCE) / 2.0
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
class CrowdComparison:
    """The trials of one navigator in worlds of one or several series of the same family."""

    series: tuple[TrialSeries, ...]
    navigator: str
    results: Sequence[WorldResult]

    @cached_property
    def trials(self) -> list[CrowdTrial]:
        """All trials, world by world."""
        return [trial for result in self.results for trial in result.trials[self.navigator]]

    @property
    def arrived(self) -> Proportion:
        """Trials that arrived without a contact."""
        return self._share(trial.arrived for trial in self.trials)

    @property
    def touched(self) -> Proportion:
        """Trials with a contact of any kind."""
        return self._share(trial.touched for trial in self.trials)

    @property
    def own(self) -> Proportion:
        """Trials with a contact by the robot's own motion."""
        return self._share(trial.own_contacts > 0 for trial in self.trials)

    @property
    def blocked(self) -> Proportion:
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
    def _share(found: Iterable[bool]) -> Proportion:
        values = list(found)
        return Proportion(sum(values), len(values))


def pooled(first: CrowdComparison, *others: CrowdComparison) -> CrowdComparison:
    """Return the comparison over the worlds of all; the navigator is that of the first."""
    every = (first, *others)
    return CrowdComparison(
        tuple(series for one in every for series in one.series),
        first.navigator,
        [result for one in every for result in one.results],
    )


NONE: Final = "-"
NAMES: Final = {"bug:left": "bug, left", "bug:right": "bug, right"}
"""Names of the navigators that run once per side; the others are named without a side."""

NEAR_COLUMNS: Final = (
    *("navigator", "drives", "arrived, no contact", "touched", "own contact"),
    *("own contacts per person-hour", f"within {PERSONAL_M:g} m, s per min"),
    *(f"time to collision < {SOON_S:g} s", "least time to collision, median"),
)
BEARINGS: Final = (
    ("behind (beyond 90°)", 0.5 * pi, inf),
    ("the side (45 to 90°)", 0.25 * pi, 0.5 * pi),
    ("ahead (within 45°)", -inf, 0.25 * pi),
)
"""Direction from which a person came, with its least and greatest angle off the heading."""

ORIGIN_COLUMNS: Final = (
    *("family", "the person came from", "contacts", "own contacts"),
    *("robot drove", "turned on the spot", "did not move"),
    *("tracked at the contact", "tracked in the 6 s before", "not tracked"),
    "faster than the robot",
)
ROBOT_M_S: Final = DEFAULTS.v_max_m_s
DRIVING_M_S: Final = 0.02
TURNING_RAD_S: Final = 0.1
TRACKED_S: Final = 0.1
"""A person with a proven track in the last two ticks counts as tracked at the contact."""

LATELY_S: Final = 6.0


class ContactOrigin(NamedTuple):
    """A contact with a person; `own` is set if the trial has a contact by own motion."""

    contact: PersonContact
    own: bool


def contact_table(columns: Sequence[CrowdComparison]) -> str:
    """Return a table with one column for each comparison."""
    rows: list[tuple[str, Callable[[CrowdComparison], str]]] = [
        ("navigator", lambda one: name_of(one.navigator)),
        ("noise", lambda one: one.series[0].noise),
        ("seed of the worlds", lambda one: " and ".join(str(some.seed) for some in one.series)),
        ("worlds", lambda one: str(len(one.results))),
        ("drives", lambda one: str(len(one.trials))),
        ("touched", lambda one: _percent(one.touched.rate, one.touched_interval)),
        ("standing robot, touched", lambda one: _percent(one.standing, one.standing_interval)),
        ("touched, less half of the standing robot's", _excess),
        ("at most half of the standing robot's", lambda one: one.verdict),
        ("omniscient robot, no way without a contact", lambda one: _share(one.blocked)),
        ("own contact", lambda one: f"{_share(one.own)}, {one.own.count} of {one.own.of}"),
        ("person-hours", lambda one: f"{one.own_rate.hours:.1f}"),
        ("own contacts per person-hour", lambda one: _rate(one.own_rate)),
        (f"within {PERSONAL_M:g} m, s per min", lambda one: _intruded(one.nearness)),
        (f"time to collision < {SOON_S:g} s", lambda one: _soon(one.nearness)),
        ("least time to collision, median", lambda one: _least(one.nearness)),
    ]
    heading = ["", *(one.series[0].family for one in columns)]
    return _table(heading, ([name, *map(cell, columns)] for name, cell in rows))


def navigator_table(rows: Sequence[CrowdComparison]) -> str:
    """Return a table with a row for each navigator and both baselines, in the same worlds.

    All rows are of one series whose results have the exposure of the baselines.
    """
    return _table(NEAR_COLUMNS, [*map(_navigator_cells, rows), *_baseline_cells(rows[-1])])


def origin_table(comparisons: Sequence[CrowdComparison]) -> str:
    """Return where the people of the contacts came from, what the robot did and tracked."""
    families = dict.fromkeys(one.series[0].family for one in comparisons)
    lines = []
    for family in families:
        whole = pooled(*(one for one in comparisons if one.series[0].family == family))
        origins = [
            ContactOrigin(contact, trial.own_contacts > 0)
            for trial in whole.trials
            for contact in trial.contacts
        ]
        for name, least_rad, most_rad in BEARINGS:
            some = [one for one in origins if least_rad <= abs(one.contact.bearing_rad) < most_rad]
            lines.append([family, name, *_origin_cells(some)])
        lines.append([family, "all", *_origin_cells(origins)])
    return _table(ORIGIN_COLUMNS, lines)


def name_of(navigator: str) -> str:
    """Return the name of NAME:SIDE in the tables."""
    return NAMES.get(navigator, navigator.partition(":")[0])


def _navigator_cells(row: CrowdComparison) -> list[str]:
    return [
        *(name_of(row.navigator), str(len(row.trials)), _share(row.arrived)),
        *(_share(row.touched), _share(row.own), _rate(row.own_rate), *_near(row.nearness)),
    ]


def _baseline_cells(row: CrowdComparison) -> list[list[str]]:
    stays = [one for result in row.results for one in result.stays]
    routes = [result.route for result in row.results if result.route is not None]
    worlds, places = len(row.results), len(stays) // len(row.results)
    touched = f"{100.0 * sum(one.touched for one in stays) / len(stays):.1f} %"
    near = _near(Nearness(one.exposure for one in stays))
    standing = [f"{worlds} × {places} places", NONE, touched, NONE, NONE, *near]
    free = _share(Proportion(worlds - row.blocked.count, worlds))
    omniscient = [str(worlds), free, _share(row.blocked), NONE, NONE, *_near(Nearness(routes))]
    return [["standing robot", *standing], ["omniscient robot", *omniscient]]


def _origin_cells(origins: list[ContactOrigin]) -> list[str]:
    contacts = [one.contact for one in origins]
    drove = sum(abs(one.speed_m_s) >= DRIVING_M_S for one in contacts)
    still = sum(
        abs(one.speed_m_s) < DRIVING_M_S and abs(one.yaw_rate_rad_s) < TURNING_RAD_S
        for one in contacts
    )
    now = sum(one.tracked_s <= TRACKED_S for one in contacts)
    lately = sum(TRACKED_S < one.tracked_s <= LATELY_S for one in contacts)
    counts = len(origins), sum(one.own for one in origins)
    motions = drove, len(origins) - drove - still, still
    faster = sum(one.person_m_s > ROBOT_M_S for one in contacts)
    return [*map(str, (*counts, *motions, now, lately, len(origins) - now - lately, faster))]


def _near(nearness: Nearness) -> tuple[str, str, str]:
    return _intruded(nearness), _soon(nearness), _least(nearness)


def _intruded(nearness: Nearness) -> str:
    return f"{nearness.intruded_s_per_min:.1f}"


def _soon(nearness: Nearness) -> str:
    return f"{100.0 * nearness.soon_share:.1f} %"


def _least(nearness: Nearness) -> str:
    return f"{nearness.least_s:.1f} s" if isfinite(nearness.least_s) else "none"


def _excess(one: CrowdComparison) -> str:
    low, high = one.excess_interval
    return f"{100.0 * one.excess:+.1f} points ({100.0 * low:+.1f} to {100.0 * high:+.1f})"


def _share(share: Proportion) -> str:
    return _percent(share.rate, share.interval)


def _percent(rate: float, interval: Interval) -> str:
    low, high = interval
    return f"{100.0 * rate:.1f} % ({100.0 * low:.1f} to {100.0 * high:.1f})"


def _rate(rate: Rate) -> str:
    low, high = rate.interval
    return f"{rate.per_hour:.2f} ({low:.2f} to {high:.2f})"


def _table(heading: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    rule = "|---" * len(heading) + "|\n"
    first, *rest = (f"| {' | '.join(row)} |\n" for row in [heading, *lines])
    return "".join([first, rule, *rest])
