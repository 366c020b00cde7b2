"""`python -m study.people`: drive among people and write the tables of docs/evidence/people.md.

With `--family` it drives other worlds and prints their table instead.
"""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import groupby
from multiprocessing import Pool
from multiprocessing.pool import Pool as Workers
from pathlib import Path
from typing import Any, Final

from plant.corpus import CROWD_FAMILIES
from plant.model.configuration import LEVELS
from runtime.errors import UserError
from study.people.comparison import (
    HOUR_S,
    CrowdComparison,
    contact_table,
    name_of,
    navigator_table,
    origin_table,
    pooled,
)
from study.people.crowd_trial import TrialSeries, run_world
from study.report.page import with_text
from study.runner.plan import EVERY_NAVIGATOR, navigator_of

FRESH: Final = 2024
"""A seed that no worlds of this project were made with before."""

EARLIER: Final = 919
"""The seed of earlier versions of the page."""

STUDIED: Final = 13
"""The seed of the committed study; with four repeats these are its trials."""

CONTACTS: Final = (
    TrialSeries("crowd", "default", FRESH, 2000),
    TrialSeries("crowd", "default", EARLIER, 1000),
    TrialSeries("crowd", "default", STUDIED, 100, repeats=4),
    TrialSeries("crowd", "lossy", FRESH, 600),
    TrialSeries("crowd", "lossy", EARLIER, 400),
    TrialSeries("crowd_hasty", "default", FRESH, 600),
    TrialSeries("moving", "default", FRESH, 300),
)
NAVIGATORS: Final = tuple(
    TrialSeries(family, "default", FRESH, 100, EVERY_NAVIGATOR, is_exposed=True)
    for family in ("crowd", "crowd_hasty")
)
BEGIN: Final = "<!-- begin: python -m study.people, {} -->\n"
END: Final = "<!-- end: {} -->\n"


def tables_of(
    contacts: Sequence[CrowdComparison], navigators: Sequence[Sequence[CrowdComparison]]
) -> dict[str, str]:
    """Return the tables by the names of their marks.

    `contacts` has one comparison for each of CONTACTS, `navigators` one sequence for each of
    NAVIGATORS.
    """
    crowds = [
        contact
        for contact in contacts
        if contact.series[0].family in CROWD_FAMILIES
        and contact.series[0].noise == "default"
        and contact.series[0].seed != STUDIED
    ]
    return {
        "contacts": contact_table(with_pooled(contacts)),
        **{rows[0].series[0].family: navigator_table(rows) for rows in navigators},
        "origins": origin_table(crowds),
    }


def with_pooled(contacts: Sequence[CrowdComparison]) -> list[CrowdComparison]:
    """Insert the pooled worlds of several seeds behind those of the same family and noise.

    The worlds of the study stay apart, because each has several drives.
    """
    columns: list[CrowdComparison] = []
    for (_, _, studied), group in groupby(contacts, _kind):
        some = list(group)
        columns += some
        if len(some) > 1 and not studied:
            columns.append(pooled(*some))
    return columns


def _kind(one: CrowdComparison) -> tuple[str, str, bool]:
    series = one.series[0]
    return series.family, series.noise, series.seed == STUDIED


def with_tables(page: str, tables: Mapping[str, str]) -> str:
    """Return the page with new tables between their marks; raise ValueError for missing marks."""
    for name, table in tables.items():
        page = with_text(page, BEGIN.format(name), END.format(name), f"\n{table}\n")
    return page


def to_json(
    contacts: Sequence[CrowdComparison], navigators: Sequence[Sequence[CrowdComparison]]
) -> str:
    """Return the counts as JSON.

    `standing_touched` is a sum of shares of places, rounded; `omniscient_touched` counts a world
    once for each trial in it.
    """
    found = {
        "crowds": [_counts(contact) for contact in contacts],
        "navigators": [_counts(row) | _nearness(row) for rows in navigators for row in rows],
    }
    return json.dumps(found, indent=1) + "\n"


def _counts(one: CrowdComparison) -> dict[str, Any]:
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


def _nearness(one: CrowdComparison) -> dict[str, Any]:
    return {
        "arrived": one.arrived.count,
        "own_contacts": one.own_rate.events,
        "person_h": round(one.nearness.person_s / HOUR_S, 4),
        "intruded_s_per_min": round(one.nearness.intruded_s_per_min, 3),
        "soon_share": round(one.nearness.soon_share, 5),
    }


PAGE: Final = Path("docs/evidence/people.md")
COUNTS: Final = Path("docs/evidence/people.json")
CHUNK: Final = 4


def main(argv: Sequence[str]) -> int:
    """Write the page, or print a table; return the exit code."""
    options = parser().parse_args(argv)
    try:
        navigators = tuple(map(navigator_of, options.navigator))
    except UserError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    with Pool(options.processes) as workers:
        if options.family is None:
            write_page(workers, options.page, options.counts)
        for family in options.family or ():
            worlds = TrialSeries(family, options.noise, options.seed, options.worlds, navigators)
            rows = run(workers, worlds._replace(is_exposed=True))
            print(contact_table(rows), navigator_table(rows), sep="\n")
    return 0


def write_page(workers: Workers, page: Path, counts: Path) -> None:
    """Drive all series of the page, and rewrite its tables and the file of the counts."""
    text = page.read_text(encoding="utf-8")
    contacts = [comparison for series in CONTACTS for comparison in run(workers, series)]
    navigators = [run(workers, series) for series in NAVIGATORS]
    page.write_text(with_tables(text, tables_of(contacts, navigators)), encoding="utf-8")
    counts.write_text(to_json(contacts, navigators), encoding="utf-8")


def run(workers: Workers, series: TrialSeries) -> list[CrowdComparison]:
    """Drive a series and return one comparison for each navigator."""
    drives = f"{series.worlds} worlds x {len(series.navigators) * series.repeats} trials"
    print(f"{series.family}, {series.noise}, seed {series.seed}: {drives}", file=sys.stderr)
    results = workers.map(partial(run_world, series), range(series.worlds), CHUNK)
    return [CrowdComparison((series,), navigator, results) for navigator in series.navigators]


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    made = argparse.ArgumentParser(prog="python -m study.people", description=__doc__)
    families = (*CROWD_FAMILIES, "moving")
    made.add_argument("--family", nargs="+", choices=families, help="print a table of these")
    made.add_argument("--navigator", nargs="+", default=["vgm_memory"], metavar="NAME[:SIDE]")
    made.add_argument("--noise", choices=LEVELS, default="default")
    made.add_argument("--worlds", type=int, default=100, help="worlds of each family")
    made.add_argument("--seed", type=int, default=1, help="seed of the worlds")
    made.add_argument("--page", type=Path, default=PAGE, help="page whose tables are rewritten")
    made.add_argument("--counts", type=Path, default=COUNTS, help="JSON file with the counts")
    made.add_argument("--processes", type=int, help="default: one for each core")
    return made


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
