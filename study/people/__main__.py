"""`python -m study.people`: drive among people and write the tables of docs/evidence/people.md.

With `--family` it drives other worlds and prints their table instead.
"""

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from multiprocessing import Pool
from multiprocessing.pool import Pool as Workers
from pathlib import Path
from typing import Final

from plant.corpus import CROWD_FAMILIES
from plant.model.configuration import LEVELS
from runtime.errors import UserError
from study.people.comparison import Comparison
from study.people.crowd_tables import contact_table, navigator_table
from study.people.crowd_trial import Series, run_world
from study.people.people_page import CONTACTS, NAVIGATORS, tables_of, to_json, with_tables
from study.runner.plan import navigator_of

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
            worlds = Series(family, options.noise, options.seed, options.worlds, navigators)
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


def run(workers: Workers, series: Series) -> list[Comparison]:
    """Drive a series and return one comparison for each navigator."""
    drives = f"{series.worlds} worlds x {len(series.navigators) * series.repeats} trials"
    print(f"{series.family}, {series.noise}, seed {series.seed}: {drives}", file=sys.stderr)
    results = workers.map(partial(run_world, series), range(series.worlds), CHUNK)
    return [Comparison((series,), navigator, results) for navigator in series.navigators]


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
