"""`sidestep run plant`: connect a plant to the bus and run it until it is stopped."""

import argparse
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf, isfinite

from plant.model.configuration import LEVELS, noise_of
from plant.process.loop import Process, RequestQueue, Wake, nothing
from plant.process.robot_link import RobotLink
from plant.shortest_path import known_length_m
from plant.sim.simulation import Plant
from plant.world.file import load
from plant.world.writer import run_json
from protocol.bus.bus import Bus, Presence, claim, open_bus
from protocol.bus.network import Network
from protocol.options import add_network_options, network_of, whole
from protocol.topics import RUN, WORLD, Role, robot_name
from protocol.world import as_json
from runtime import config
from runtime.cli.parsers import new_parser
from runtime.clock import WallClock
from runtime.errors import UserError
from runtime.watchdog import Watchdog


def run(
    plant: Plant, network: Network, robots: list[str], *, lockstep: bool, speed: float, paused: bool
) -> int:
    """Run until stopped and return 0. In lockstep the first tick waits for the robots."""
    wake = Wake()
    with open_bus(replace(network, patient=lockstep), Role.PLANT, robots[0]) as bus:
        for number in (
            signal.SIGINT,
            signal.SIGTERM,
        ):
            signal.signal(number, lambda *_: wake.stop())
        bus.on_impostor(lambda why: log_line(f"plant: {why}"))
        watchdog = Watchdog()
        process = assemble(
            plant, bus, robots, wake, lockstep=lockstep, paused=paused, turn=watchdog.reset
        )
        names = ", ".join(robots)
        log_line(f"plant: world {plant.world.name} with {names}")
        with watchdog:
            if lockstep:
                process.run_lockstep(speed)
            else:
                process.run_wall(WallClock())
    log_line("plant: ends")
    return 0


def assemble(
    plant: Plant,
    bus: Bus,
    robots: list[str],
    wake: Wake,
    *,
    lockstep: bool,
    paused: bool,
    turn: Callable[[], None] = nothing,
) -> Process:
    """Create the links to the robots and the services, and announce them. Raises NameTakenError."""
    world = as_json(plant.world, known_length_m(plant.world))
    world |= run_json(plant.world, plant.seed, plant.noise)
    desk = RequestQueue(running=not paused, world=world, nudge=wake)
    wires = [
        RobotLink(bus, robot, number, wake, lockstep=lockstep)
        for number, robot in enumerate(robots)
    ]
    for number, robot in enumerate(robots):
        take = partial(desk.ask, number)
        bus.serve(RUN, take, robot)
        bus.serve(WORLD, take, robot)
    claim(bus, robots)
    if lockstep:
        watch_robots(bus, wires, wake)
    look = RejectLog(lambda: bus.rejected, log_line).look
    return Process(plant, wires, desk, wake, look=look, turn=turn)


def watch_robots(bus: Bus, links: list[RobotLink], wake: Wake) -> None:
    """Tell each link which robots are present, so that no tick waits for one that has gone."""

    def note(token: Presence, appeared: bool) -> None:
        for link in links:
            link.note_presence(token, appeared)
        wake()

    bus.watch(note)


def log_line(line: str) -> None:
    """Print a line to standard error."""
    print(line, file=sys.stderr, flush=True)


class RejectLog:
    """Report rejected frames at once, and again whenever their number has doubled.

    `counts` returns the numbers of rejected frames by path; `report` receives each line.
    """

    def __init__(
        self, counts: Callable[[], Mapping[str, int]], report: Callable[[str], None]
    ) -> None:
        self._counts = counts
        self._report = report
        self._reported: dict[str, int] = {}

    def look(self) -> None:
        """Report the counts that have grown."""
        for path, count in self._counts().items():
            if count > 2 * self._reported.get(path, 0):
                self._reported[path] = count
                what = f"{count} rejected on {path}"
                self._report(f"plant: {what}: find out which other process publishes there")


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantSettings:
    """Settings of `--config FILE`: robot and network."""

    robot: str = "r1"
    network: Network | None = None


def main(argv: Sequence[str]) -> int:
    """Run the plant until it is stopped; return 0, or 2 for a bad world or wrong settings."""
    arguments = parser().parse_args(list(argv))
    settings = (
        config.load_shared(arguments.config, PlantSettings) if arguments.config else PlantSettings()
    )
    network = network_of(arguments, settings.network, listens=False)
    names = settings.robot if arguments.robots is None else arguments.robots
    robots = [robot_name(name) for name in names.split(",")]
    if len(set(robots)) < len(robots):
        raise UserError(f"--robots {names}: each robot needs a name of its own")
    return run(
        plant_of(arguments, len(robots)),
        network,
        robots,
        lockstep=arguments.lockstep,
        speed=arguments.speed,
        paused=arguments.paused,
    )


def plant_of(arguments: argparse.Namespace, robots: int) -> Plant:
    """Return the plant of the command line; raise UserError for an unusable world."""
    world = load(arguments.world)
    try:
        return Plant(world, arguments.seed, noise_of(world, arguments.noise), robots=robots)
    except ValueError as error:
        raise UserError(f"world {arguments.world}: {error}") from error


def parser() -> argparse.ArgumentParser:
    """Return the parser of `sidestep run plant`."""
    parser = new_parser("plant")
    add_network_options(parser)
    parser.add_argument(
        "--world", metavar="W", default="box", help="a world's name or file (default box)"
    )
    parser.add_argument(
        "--seed",
        metavar="S",
        type=whole(0),
        default=0,
        help="seed of all random numbers (default 0)",
    )
    parser.add_argument("--noise", metavar="LEVEL", choices=sorted(LEVELS), help=", ".join(LEVELS))
    parser.add_argument("--robots", metavar="NAMES", help="as in r1,r2 (default r1)")
    parser.add_argument("--lockstep", action="store_true", help="advance when all robots answered")
    parser.add_argument(
        "--speed",
        metavar="F",
        type=speed,
        default=inf,
        help="in lockstep, times real time (default max)",
    )
    parser.add_argument("--paused", action="store_true", help="wait for a START")
    return parser


def speed(text: str) -> float:
    """Parse a factor above zero, or `max`."""
    value = inf if text == "max" else float(text)
    if not value > 0 or (not isfinite(value) and text != "max"):
        raise argparse.ArgumentTypeError(f"{text!r}: a number above 0, or max")
    return value
