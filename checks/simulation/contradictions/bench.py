"""The observer of contradictions: what programs say, compared with what was, seed by seed.

Each seed draws two persons with an app, terminals and a notebook, `up` and MAVLink stations, that
command one robot for 24 simulated seconds. Every outcome, answer, acknowledgement, exit code,
lease, band, status line, log text and recording summary is compared with the truth. A word that is
not so is printed with the seed, what was said, what was so, and the command that repeats it. The
options are those of `bench simulate`. With `--beside` the programs are processes beside a real
`up`.
"""

import argparse
from typing import Final

from checks.harness.figures import Figure, Report
from checks.simulation import campaign
from checks.simulation.campaign import Campaign
from checks.simulation.contradictions.beside import beside_up
from checks.simulation.contradictions.persons import DEFECTS, draw_persons, observe
from runtime.units import NS_PER_S

CONTRADICTIONS: Final = Campaign(
    "contradictions", draw_persons, observe, DEFECTS, failure="seeds with a contradiction"
)
BESIDE_S: Final = 60.0


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `bench contradictions`."""
    campaign.add_options(parser, CONTRADICTIONS)
    parser.add_argument(
        "--beside",
        nargs="?",
        type=float,
        const=BESIDE_S,
        metavar="S",
        help=f"beside a real `up`, for so many seconds ({BESIDE_S:g}); --seed S draws other deeds",
    )


def measure(options: argparse.Namespace) -> Report:
    """Run one scenario, many seeds, the search for defects, or programs beside a real `up`."""
    if options.beside is None:
        return campaign.measure(options, CONTRADICTIONS)
    found, journal = beside_up(options.seed or 0, options.beside)
    return Report(
        benchmark=CONTRADICTIONS.name,
        figures=(
            Figure(name="deeds beside a real `up`", unit="", values=(len(journal.deeds),)),
            Figure(name="words that were judged", unit="", values=(len(journal.words),)),
            Figure(name="contradictions", unit="", values=(len(found),), at_most=0),
        ),
        notes=tuple(
            f"{one.time_ns / NS_PER_S:.1f} s «{one.invariant}»: {one.words}" for one in found
        ),
    )
