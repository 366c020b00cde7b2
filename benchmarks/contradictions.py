"""The observer of contradictions: what programs say, compared with what was, seed by seed.

Each seed draws two persons with an app, terminals and a notebook, `up` and MAVLink stations, that
command one robot for 24 simulated seconds. Every outcome, answer, acknowledgement, exit code,
lease, band, status line, log text and recording summary is compared with the truth. A word that is
not so is printed with the seed, what was said, what was so, and the command that repeats it. The
options are those of `bench simulate`.
"""

import argparse
from typing import Final

from verification import simulate
from verification.harness.figures import Report
from verification.simulation.campaign import Campaign
from verification.simulation.contradictions.defects import DEFECTS
from verification.simulation.contradictions.draw import draw_persons
from verification.simulation.contradictions.run import observe

CONTRADICTIONS: Final = Campaign(
    "contradictions", draw_persons, observe, DEFECTS, failure="seeds with a contradiction"
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `bench contradictions`."""
    simulate.add_options(parser, CONTRADICTIONS)


def measure(options: argparse.Namespace) -> Report:
    """Run one scenario, many seeds, or the search for defects."""
    return simulate.measure(options, CONTRADICTIONS)
