"""`router`: a Zenoh router for several robots or machines, until a signal ends it."""

import argparse
from typing import Final

from ground.cli.options import listening_of
from ground.commands.command import add_common
from ground.text.output import Output
from protocol.bus.audit import audited_connections
from protocol.bus.bus import open_bus
from protocol.bus.door import guarded_door
from runtime.clock import WallClock

BUS_NAME: Final = "router"
POLL_NS: Final = 200_000_000


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `router`."""
    add_common(parser, listens=True)
    help_text = "another router, so that the processes at both reach each other"
    parser.add_argument("--connect", metavar="ENDPOINT", help=help_text)


def run(options: argparse.Namespace, output: Output) -> int:
    """Route until Ctrl-C."""
    network, clock = listening_of(options), WallClock()
    with open_bus(network, None, BUS_NAME) as bus:
        output.note(f"router at {bus.locator()}")
        try:
            with audited_connections(bus, output.note), guarded_door(bus, output.note):
                while True:
                    clock.sleep_until(clock.now_ns() + POLL_NS)
        except KeyboardInterrupt:
            output.note("router ends")
    return 0
