"""Latency of hold and e-stop, from the key to the robot's reaction, and the distance rolled."""

import argparse
from typing import Final

from checks.harness.figures import Figure
from checks.harness.observer import observed
from checks.speed.ground_station.reaction import Presses, TerminalOperator
from checks.speed.ground_station.stage import SIZES, commanding

WORLD: Final = "open"
PERIOD_MS: Final = 50.0
SLACK_MS: Final = 5.0
HOLD, ESTOP = "h", " "


def key_figures(options: argparse.Namespace) -> tuple[list[Figure], list[str]]:
    """Measure hold and e-stop."""
    with observed(WORLD) as observer, commanding(observer, SIZES[0]) as terminal:
        operator = TerminalOperator(terminal, observer)
        holds = operator.presses(HOLD, operator.resume, options.presses)
        stops = operator.presses(ESTOP, operator.clear, options.presses)
    notes = [
        "from the write of the key into the pty to what an observer on the bus receives;"
        " one period is 50 ms",
        "hold has acted when the robot reports HOLD: the wheels slow down from that tick on;"
        " e-stop when the wheels are commanded to zero",
        "rolled: true distance from the last sample before the key to rest, at 0.3 m/s",
    ]
    return [*figures_of("hold", holds), *figures_of("e-stop", stops)], notes


def figures_of(name: str, found: Presses) -> list[Figure]:
    """Return the figures of one key."""
    worst_ms = max(found.acted_ms)
    return [
        Figure(
            name=f"{name}: key to robot acts",
            unit="ms",
            values=tuple(found.acted_ms),
            at_most=PERIOD_MS + SLACK_MS,
        ),
        Figure(
            name=f"{name}: key to robot acts, worst",
            unit="ms",
            values=(worst_ms,),
            at_most=2 * PERIOD_MS + SLACK_MS,
        ),
        Figure(name=f"{name}: key to wheels at zero", unit="ms", values=tuple(found.wheels_ms)),
        Figure(name=f"{name}: rolled", unit="m", values=tuple(found.rolled_m)),
    ]
