"""Markdown tables of trials among people."""

from collections.abc import Callable, Iterable, Sequence
from math import inf, isfinite, pi
from typing import Final, NamedTuple

from robot.core.parameters import DEFAULTS
from study.people.comparison import Comparison, Nearness, pooled
from study.people.encounters import PERSONAL_M, SOON_S, Contact
from study.people.rates import Rate
from study.statistics.intervals import Interval, Share

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


class Origin(NamedTuple):
    """A contact with a person; `own` is set if the trial has a contact by own motion."""

    contact: Contact
    own: bool


def contact_table(columns: Sequence[Comparison]) -> str:
    """Return a table with one column for each comparison."""
    rows: list[tuple[str, Callable[[Comparison], str]]] = [
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


def navigator_table(rows: Sequence[Comparison]) -> str:
    """Return a table with a row for each navigator and both baselines, in the same worlds.

    All rows are of one series whose results have the exposure of the baselines.
    """
    return _table(NEAR_COLUMNS, [*map(_navigator_cells, rows), *_baseline_cells(rows[-1])])


def origin_table(comparisons: Sequence[Comparison]) -> str:
    """Return where the people of the contacts came from, what the robot did and tracked."""
    families = dict.fromkeys(one.series[0].family for one in comparisons)
    lines = []
    for family in families:
        whole = pooled(*(one for one in comparisons if one.series[0].family == family))
        origins = [
            Origin(contact, trial.own_contacts > 0)
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


def _navigator_cells(row: Comparison) -> list[str]:
    return [
        *(name_of(row.navigator), str(len(row.trials)), _share(row.arrived)),
        *(_share(row.touched), _share(row.own), _rate(row.own_rate), *_near(row.nearness)),
    ]


def _baseline_cells(row: Comparison) -> list[list[str]]:
    stays = [one for result in row.results for one in result.stays]
    routes = [result.route for result in row.results if result.route is not None]
    worlds, places = len(row.results), len(stays) // len(row.results)
    touched = f"{100.0 * sum(one.touched for one in stays) / len(stays):.1f} %"
    near = _near(Nearness(one.exposure for one in stays))
    standing = [f"{worlds} × {places} places", NONE, touched, NONE, NONE, *near]
    free = _share(Share(worlds - row.blocked.count, worlds))
    omniscient = [str(worlds), free, _share(row.blocked), NONE, NONE, *_near(Nearness(routes))]
    return [["standing robot", *standing], ["omniscient robot", *omniscient]]


def _origin_cells(origins: list[Origin]) -> list[str]:
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


def _excess(one: Comparison) -> str:
    low, high = one.excess_interval
    return f"{100.0 * one.excess:+.1f} points ({100.0 * low:+.1f} to {100.0 * high:+.1f})"


def _share(share: Share) -> str:
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
