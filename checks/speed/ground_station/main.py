"""Cost and latency of the app on a terminal with a real robot.

CPU time is the kernel's figure of the app's process. Output is counted and keys are pressed at the
other end of its pty; an observer on the bus records the robot's reaction.
"""

import argparse
from typing import Final

from checks.harness.figures import Report
from checks.speed.ground_station import cost, first_paint, fleet, key_latency, long_run

PARTS: Final = {
    "paint": first_paint.paint_figures,
    "cost": cost.cost_figures,
    "keys": key_latency.key_figures,
    "crowd": long_run.long_run_figures,
    "fleet": fleet.fleet_figures,
}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--parts", nargs="+", choices=list(PARTS), default=list(PARTS))
    parser.add_argument("--robots", type=int, default=12, help="of the part `fleet`")
    parser.add_argument("--seconds", type=float, default=20.0, help="of each reading of the cost")
    parser.add_argument("--settle", type=float, default=3.0, help="seconds before each reading")
    parser.add_argument("--slow-presses", type=int, default=10, help="of a key on a slow line")
    parser.add_argument("--repetitions", type=int, default=3, help="of each reading of the cost")
    parser.add_argument("--starts", type=int, default=10, help="first paints")
    parser.add_argument("--presses", type=int, default=200, help="of hold, and of the e-stop")
    parser.add_argument("--minutes", type=float, default=10.0, help="of telemetry at 50 Hz")
    parser.add_argument("--lines", type=int, default=100_000, help="of log")
    parser.add_argument("--presses-after", type=int, default=20, help="of keys after these lines")


def measure(options: argparse.Namespace) -> Report:
    """Measure the selected parts."""
    return Report.of("ground", (PARTS[name](options) for name in options.parts))
