"""The measurements of the page docs/evidence/people.md: series, tables, and JSON."""

import json
from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any, Final

from plant.corpus import CROWD_FAMILIES
from study.people.comparison import Comparison, pooled
from study.people.crowd_tables import contact_table, name_of, navigator_table, origin_table
from study.people.crowd_trial import Series
from study.people.rates import HOUR_S
from study.report.output.marks import with_text
from study.runner.plan import EVERY_NAVIGATOR

FRESH: Final = 2024
"""A seed that no worlds of this project were made with before."""

EARLIER: Final = 919
"""The seed of earlier versions of the page."""

STUDIED: Final = 13
"""The seed of the committed study; with four repeats these are its trials."""

CONTACTS: Final = (
    Series("crowd", "default", FRESH, 2000),
    Series("crowd", "default", EARLIER, 1000),
    Series("crowd", "default", STUDIED, 100, repeats=4),
    Series("crowd", "lossy", FRESH, 600),
    Series("crowd", "lossy", EARLIER, 400),
    Series("crowd_hasty", "default", FRESH, 600),
    Series("moving", "default", FRESH, 300),
)
NAVIGATORS: Final = tuple(
    Series(family, "default", FRESH, 100, EVERY_NAVIGATOR, is_exposed=True)
    for family in ("crowd", "crowd_hasty")
)
BEGIN: Final = "<!-- begin: python -m study.people, {} -->\n"
END: Final = "<!-- end: {} -->\n"


def tables_of(
    contacts: Sequence[Comparison], navigators: Sequence[Sequence[Comparison]]
) -> dict[str, str]:
    """Return the tables by the names of their marks.

    `contacts` has one comparison for each of CONTACTS, `navigators` one sequence for each of
    NAVIGATORS.
    """
    crowds = [
        one
        for one in contacts
        if one.series[0].family in CROWD_FAMILIES
        and one.series[0].noise == "default"
        and one.series[0].seed != STUDIED
    ]
    return {
        "contacts": contact_table(with_pooled(contacts)),
        **{rows[0].series[0].family: navigator_table(rows) for rows in navigators},
        "origins": origin_table(crowds),
    }


def with_pooled(contacts: Sequence[Comparison]) -> list[Comparison]:
    """Insert the pooled worlds of several seeds behind those of the same family and noise.

    The worlds of the study stay apart, because each has several drives.
    """
    columns: list[Comparison] = []
    for (_, _, studied), group in groupby(contacts, _kind):
        some = list(group)
        columns += some
        if len(some) > 1 and not studied:
            columns.append(pooled(*some))
    return columns


def _kind(one: Comparison) -> tuple[str, str, bool]:
    series = one.series[0]
    return series.family, series.noise, series.seed == STUDIED


def with_tables(page: str, tables: Mapping[str, str]) -> str:
    """Return the page with new tables between their marks; raise ValueError for missing marks."""
    for name, table in tables.items():
        page = with_text(page, BEGIN.format(name), END.format(name), f"\n{table}\n")
    return page


def to_json(contacts: Sequence[Comparison], navigators: Sequence[Sequence[Comparison]]) -> str:
    """Return the counts as JSON.

    `standing_touched` is a sum of shares of places, rounded; `omniscient_touched` counts a world
    once for each trial in it.
    """
    found = {
        "crowds": [_counts(one) for one in contacts],
        "navigators": [_counts(one) | _nearness(one) for rows in navigators for one in rows],
    }
    return json.dumps(found, indent=1) + "\n"


def _counts(one: Comparison) -> dict[str, Any]:
    series = one.series[0]
    return {
        "family": series.family,
        "navigator": name_of(one.navigator),
        "noise": series.noise,
        "seed": series.seed,
        "trials": len(one.trials),
        "touched": one.touched.count,
        "own": one.own.count,
        "standing_touched": round(one.standing * len(one.trials)),
        "omniscient_touched": one.blocked.count * series.repeats,
    }


def _nearness(one: Comparison) -> dict[str, Any]:
    return {
        "arrived": one.arrived.count,
        "own_contacts": one.own_rate.events,
        "person_h": round(one.nearness.person_s / HOUR_S, 4),
        "intruded_s_per_min": round(one.nearness.intruded_s_per_min, 3),
        "soon_share": round(one.nearness.soon_share, 5),
    }
