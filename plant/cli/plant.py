"""Command line of `sidestep run plant`."""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite

from plant.model.configuration import noise_of
from plant.model.noise import LEVELS
from plant.process.run import run
from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.bus.network import Network
from protocol.options import add_network_options, network_of, whole
from protocol.topics import robot_name
from runtime import config
from runtime.cli.parsers import new_parser
from runtime.errors import UserError


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Settings of `--config FILE`: robot and network."""

    robot: str = "r1"
    network: Network | None = None


def main(argv: Sequence[str]) -> int:
    """Run the plant until it is stopped; return 0, or 2 for a bad world or wrong settings."""
    arguments = parser().parse_args(list(argv))
    settings = config.load_shared(arguments.config, Settings) if arguments.config else Settings()
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
