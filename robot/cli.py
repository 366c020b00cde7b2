"""The command line of `sidestep run robot`, which runs the control loop of one robot."""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from math import radians
from pathlib import Path
from typing import Final

from protocol.bus.network import Network
from protocol.options import (
    add_network_options,
    add_param_option,
    finite,
    network_of,
    numbers_kept,
)
from protocol.topics import robot_name
from protocol.wire.enums import Severity
from robot.core.parameters import DEFAULTS
from robot.core.values import Pose
from robot.file_writer import InlineWriter, WriterThread
from robot.hosting import HOSTS, InProcessCore, NewCore
from robot.parameter_table import adjusted
from robot.run import Options, run
from robot.storage import PreviousRun, Store, own
from robot.vehicle import Vehicle
from runtime import config
from runtime.cli.parsers import new_parser
from runtime.errors import UserError

BOARD: Final = "--mcu"


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Settings of a `--config` file: the robot's name, the network and the parameters."""

    robot: str = "r1"
    network: Network | None = None
    parameters: dict[str, float] = field(default_factory=dict)


def main(argv: Sequence[str]) -> int:
    """Run the robot; return 0 after a normal stop, 1 after a failure and 2 for bad settings."""
    arguments = parser().parse_args(numbers_kept(argv))
    settings = config.load_shared(arguments.config, Settings) if arguments.config else Settings()
    network = network_of(arguments, settings.network, listens=True)
    name = robot_name(arguments.id or settings.robot)
    if arguments.stop_at:
        network = replace(network, stop_at={**network.stop_at, name: arguments.stop_at})
    warning = own(arguments.state, name) or own(arguments.stops, name)
    writer = InlineWriter() if arguments.lockstep else WriterThread()
    store = Store(arguments.state, writer, arguments.stops)
    options = Options(
        lockstep=arguments.lockstep,
        freeze=arguments.gc_freeze,
        board=arguments.mcu,
        fifo=arguments.realtime,
        after=arguments.after,
    )
    with core_host(arguments) as new_core:
        vehicle = vehicle_of(arguments, settings, store, new_core)
        if warning:
            vehicle.announce(Severity.WARNING, warning)
        return run(vehicle, network, name, options, PreviousRun(store.directory))


@contextmanager
def core_host(arguments: argparse.Namespace) -> Iterator[NewCore]:
    """Yield what creates the core: in this process, or on a board, which ends afterwards.

    Raises UserError if the board cannot be used.
    """
    if not arguments.mcu:
        yield InProcessCore
        return
    if BOARD not in HOSTS:
        raise UserError(f"{BOARD}: this installation has no firmware")
    with HOSTS[BOARD](lockstep=arguments.lockstep) as new_core:
        yield new_core


def parser() -> argparse.ArgumentParser:
    """Return the parser of `sidestep run robot`."""
    parser = new_parser("robot")
    add_network_options(parser)
    parser.add_argument("--id", metavar="NAME", help="the robot's name (default r1)")
    add_start_options(parser)
    add_param_option(parser, "a parameter; the names are in `sidestep param list`")
    parser.add_argument(
        "--state",
        metavar="DIR",
        type=Path,
        help="directory that keeps parameters, fence, mission, the emergency stop and how the run "
        "ended",
    )
    parser.add_argument(
        "--stops",
        metavar="DIR",
        type=Path,
        help="directory that keeps only the emergency stop over a restart, instead of --state",
    )
    parser.add_argument(
        "--stop-at",
        metavar="HOST:PORT",
        help="where stop datagrams are received (default: at the address of --listen)",
    )
    parser.add_argument(
        "--after", metavar="WORDS", default="", help='how the previous run ended: "signal SIGKILL"'
    )
    parser.add_argument(
        "--lockstep", action="store_true", help="use simulated time, which the plant provides"
    )
    parser.add_argument(
        BOARD, action="store_true", help="run the control core on the emulated board"
    )
    parser.add_argument("--realtime", action="store_true", help="schedule the loop SCHED_FIFO")
    parser.add_argument(
        "--gc-freeze",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="exclude objects that exist at the start from garbage collection (default yes)",
    )
    return parser


def add_start_options(parser: argparse.ArgumentParser) -> None:
    """Declare `--start` and `--encoders`."""
    parser.add_argument(
        "--start",
        metavar=("X", "Y", "DEG"),
        nargs=3,
        type=finite,
        default=(0.0, 0.0, 0.0),
        help="start pose in the world frame, so that goals are in it too (default 0 0 0)",
    )
    parser.add_argument(
        "--encoders",
        metavar=("LEFT", "RIGHT"),
        nargs=2,
        type=int,
        default=(0, 0),
        help="encoder totals at the start pose: with other totals at its start, the robot does not "
        "know its place (0 0)",
    )


def vehicle_of(
    arguments: argparse.Namespace,
    settings: Settings,
    store: Store,
    new_core: NewCore = InProcessCore,
) -> Vehicle:
    """Return a vehicle with the parameters of all sources.

    Later sources override earlier ones: defaults, configuration file, values saved by an operator,
    command line. File and command line are the configuration, which bounds the safety group.
    """
    configured = adjusted(DEFAULTS, settings.parameters, f"{arguments.config}: [parameters]")
    configured = adjusted(configured, dict(arguments.param), "--param")
    params, warnings = store.load(configured, configured)
    params = adjusted(params, dict(arguments.param), "--param")
    x_m, y_m, heading_deg = arguments.start
    start, totals = Pose(x_m, y_m, radians(heading_deg)), tuple(arguments.encoders)
    vehicle = Vehicle(params, store, start, configured, totals, new_core)
    for warning in warnings:
        vehicle.announce(Severity.WARNING, warning)
    return vehicle
