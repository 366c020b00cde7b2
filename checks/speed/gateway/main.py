"""Figures of the MAVLink gateway, each measured in one run beside what it is compared with."""

import argparse
from typing import Final

from checks.harness.figures import Report
from checks.speed.gateway import cost, flood, forgery, goto, ready, slow_line, timeouts

PARTS: Final = {
    "goto": goto.goto_figures,
    "cost": cost.cost_figures,
    "line": slow_line.line_figures,
    "forgery": forgery.forgery_figures,
    "timeouts": timeouts.timeout_figures,
    "ready": ready.ready_figures,
    "flood": flood.flood_figures,
}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--parts", nargs="+", choices=list(PARTS), default=list(PARTS))
    parser.add_argument("--goals", type=int, default=200, help="of goto, by each way")
    parser.add_argument("--seconds", type=float, default=60.0, help="of each reading: cost, line")
    parser.add_argument("--repetitions", type=int, default=3, help="of the reading of the cost")
    parser.add_argument("--rounds", type=int, default=9, help="of all kinds of forgery")
    parser.add_argument("--forged", type=int, default=32, help="frames of each kind in a round")
    parser.add_argument("--stops", type=int, default=20, help="of each kind of setpoint")
    parser.add_argument("--connections", type=int, default=20, help="until ready, of each kind")
    parser.add_argument("--kinds", nargs="+", choices=flood.ALL, default=flood.ALL, help="of flood")
    parser.add_argument("--rate", type=float, default=10_000.0, help="frames a second of a flood")
    parser.add_argument("--drive", type=float, default=15.0, help="seconds of each flood")
    parser.add_argument("--presses", type=int, default=3, help="emergency stops in each flood")


def measure(options: argparse.Namespace) -> Report:
    """Measure the selected parts."""
    return Report.of("gateway", (PARTS[name](options) for name in options.parts))
