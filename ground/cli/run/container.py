"""`run container`: run a verb in a container, with robot, start and network of its number.

Containers of one service have the same command and must find out their number. Each is reachable by
a name that ends in its number, so a container looks for the name that resolves to itself: container
2 has the robot r2. The options that `up` would give to a process are added to the verb.
"""

import argparse
import os
import socket
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

from ground.cli.observe import health
from ground.launch.scenario import CLOCKS, PACED, WALL, run_of
from ground.text.output import Output
from ground.user.folders import PRIVATE_FOLDER
from protocol.bus.network import DEFAULT_ROBOTS
from protocol.options import whole
from protocol.outcome import start_arguments
from protocol.world import WorldRun, rounded_degrees
from runtime.cli.parsers import parser_of
from runtime.cli.verb_table import VERBS, command_of, find
from runtime.config import settings_of, totals_arguments
from runtime.errors import UserError

HEALTH: Final = "health"
KEY: Final = ".key"
MAX_USER: Final = 60_000
NAME: Final = "{id}"
"""Placeholder of the robot's name in file names and in the verb's arguments."""

MOST_ROBOTS: Final = len(DEFAULT_ROBOTS)
Addresses = Callable[[str], frozenset[str]]


class RobotNumber(NamedTuple):
    """The number of this container's robot, from 1, and the number of robots."""

    number: int
    robots: int

    @property
    def robot(self) -> str:
        """The name of the robot."""
        return f"r{self.number}"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `run container`."""
    parser.set_defaults(json=False)
    parser.add_argument(
        "--config",
        action="append",
        default=[],
        metavar="FILE",
        help=f"network file, for verbs that use it: the first of these that exists; {NAME} in it"
        " is the robot's name",
    )
    parser.add_argument(
        "--replica", metavar="STEM", help="this is one of the containers STEM1, STEM2 and so on"
    )
    parser.add_argument("--world", metavar="W", default="box", help="world (default box)")
    parser.add_argument(
        "--noise", metavar="LEVEL", default="", help="noise level (default the world's)"
    )
    parser.add_argument("--seed", metavar="S", default="0", help="seed (default 0)")
    text = "of plant and robot, as of `sidestep up` (default wall)"
    parser.add_argument("--clock", choices=CLOCKS, default=WALL, help=text)
    parser.add_argument(
        "--robots",
        type=whole(1, MOST_ROBOTS),
        default=1,
        metavar="K",
        help="number of robots (default 1)",
    )
    parser.add_argument(
        "--counted",
        metavar="NAME",
        help="name that resolves to the addresses of all robots, which are counted: there are so"
        " many, or --robots if that is more",
    )
    parser.add_argument(
        "--users",
        type=whole(1, MAX_USER),
        metavar="U",
        help="run as user U + 1 for r1, U + 2 for r2 and so on, so that no robot can read the "
        "files of another one",
    )
    parser.add_argument(
        "--own", metavar="DIR", help=f"folder to create, private to that user; {NAME} as above"
    )
    parser.add_argument(
        "--healthy", metavar="FILE", help="file to create when the verb `run health` succeeds"
    )
    parser.add_argument("words", nargs=argparse.REMAINDER, metavar="VERB ...")


def run(options: argparse.Namespace, output: Output) -> int:
    """Replace this process with the verb; UserError if its number cannot be determined.

    The health check, which every container repeats, runs in this process: to start a second one
    would double its cost.
    """
    place = place_of(options, addresses)
    if options.users is not None:
        become(options.users + place.number)
    if options.own is not None:
        make_private_folder(Path(options.own.replace(NAME, place.robot)))
    words = ["sidestep", *words_of(options, place)]
    call = find(words[1:])
    if call is not None and call.word == HEALTH:
        code = health.run(parser_of(HEALTH).parse_args(call.arguments), output)
        if options.healthy is not None:
            Path(options.healthy).touch()
        return code
    try:
        os.execvp(words[0], words)
    except FileNotFoundError:
        raise UserError("`sidestep` is not on the PATH") from None


def become(user: int) -> None:
    """Switch to this user and group, without capabilities and with private files.

    Do not switch if this process is that user already, because it may not.
    """
    os.umask(0o077)
    if user == os.getuid() == os.getgid():
        return
    try:
        os.setgroups([])
        os.setgid(user)
        os.setuid(user)
    except PermissionError as error:
        raise UserError(f"cannot switch to user {user}: start the container as root") from error


def make_private_folder(folder: Path) -> None:
    """Create a folder owned by this user; UserError if it exists and another user owns it."""
    try:
        folder.mkdir(mode=PRIVATE_FOLDER, exist_ok=True)
        owner = folder.lstat().st_uid
    except OSError as error:
        raise UserError(f"{folder}: {error.strerror}") from error
    if owner != os.geteuid():
        raise UserError(
            f"{folder} belongs to user {owner}, and this process is user {os.geteuid()}: "
            "remove it, or change its owner"
        )


def words_of(options: argparse.Namespace, place: RobotNumber) -> list[str]:
    """Return the verb with the added options."""
    words = [word.replace(NAME, place.robot) for word in options.words]
    call = find(words)
    if call is None:
        return words
    verb, added = call.word, list[str]()
    if verb in ADDED_OPTIONS and not (verb == "goto" and call.arguments):  # a goal of its own
        added += ADDED_OPTIONS[verb](options, place)
    if options.replica is not None and verb != "plant":
        added += ["--id", place.robot]
    if options.config and takes_config(verb):
        added += ["--config", config_of(options.config, place)]
    return [*command_of(verb).split(), *added, *call.arguments]


def place_of(options: argparse.Namespace, lookup: Addresses) -> RobotNumber:
    """Return the number of this container, and of the robots as far as it needs to know them.

    Start and goal of a robot do not depend on those after it, so a replica need not count them.
    """
    if not options.words:
        raise UserError("the verb is missing, as in: sidestep run container --robots 2 run plant")
    number = 1 if options.replica is None else number_of(options.replica, lookup)
    counted = 0 if options.counted is None else len(lookup(options.counted))
    return RobotNumber(number, max(options.robots, number, counted))


def number_of(stem: str, lookup: Addresses) -> int:
    """Return the N for which STEM N resolves to this host; UserError if there is none."""
    here = lookup(socket.gethostname())
    for number in range(1, MOST_ROBOTS + 1):
        if here & lookup(f"{stem}{number}"):
            return number
    raise UserError(
        f"--replica {stem}: none of {stem}1 to {stem}{MOST_ROBOTS} resolves to this container: "
        "check its network and the number of robots"
    )


def addresses(name: str) -> frozenset[str]:
    """Return the addresses of a name, none if it cannot be resolved."""
    try:
        found = socket.getaddrinfo(name, None, type=socket.SOCK_STREAM)
    except OSError:
        return frozenset()
    return frozenset(str(place[0]) for *_, place in found)


def config_of(files: Sequence[str], place: RobotNumber) -> str:
    """Return the first existing path; else the last one, so that its reader reports it missing.

    Raises UserError if a folder holds keys that cannot be used: the next file may be one without
    keys.
    """
    for name in files[:-1]:
        file = Path(name.replace(NAME, place.robot))
        if exists(file):
            return str(file)
        refuse_keys_of_others(file, apart=NAME in Path(name).parent.name)
    return files[-1].replace(NAME, place.robot)


def exists(file: Path) -> bool:
    """Return whether the file exists; UserError if that cannot be determined."""
    try:
        file.stat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError as error:
        raise UserError(
            f"{file}: {error.strerror}: this process does not start without its keys; "
            "allow its user to read that folder"
        ) from error
    return True


def refuse_keys_of_others(file: Path, *, apart: bool) -> None:
    """Raise UserError if the folder of a missing file holds keys of other processes.

    `apart`: each robot has a folder of its own for its keys, beside those of the others.
    """
    folder = file.parent.parent if apart else file.parent
    try:
        keys = sorted(path.name for path in folder.iterdir() if apart or path.suffix == KEY)
    except (FileNotFoundError, NotADirectoryError):
        return
    except OSError as error:
        raise UserError(f"{folder}: {error.strerror}: allow its user to read it") from error
    if keys:
        raise UserError(
            f"{folder} holds {keys[0]} but not {file.relative_to(folder)}: this process "
            "does not start without its own keys; add them, or remove the others"
        )


def takes_config(verb: str) -> bool:
    """Return whether a verb has the option --config."""
    if VERBS[verb].is_program:
        return verb in ("robot", "plant")
    return "--config" in parser_of(verb).format_usage()


def as_robot(options: argparse.Namespace, place: RobotNumber) -> Iterator[str]:
    """Yield the start pose and the parameters of a robot in this world."""
    run = run_for(options, place)
    start, world = run.starts[place.number - 1], run.world
    yield from ("--start", *start_arguments(start.x_m, start.y_m, start.heading_rad))
    yield from totals_arguments(world.robot)
    if options.clock == PACED:
        yield "--lockstep"
    level = options.noise or str(world.noise.get("level", "default"))
    for name, value in settings_of(world.robot, level, calibrated=True).items():
        yield from ("--param", f"{name}={value!r}")


def as_plant(options: argparse.Namespace, place: RobotNumber) -> Iterator[str]:
    """Yield the world and the names of all robots."""
    names = ",".join(f"r{number}" for number in range(1, place.robots + 1))
    yield from ("--world", options.world, "--seed", options.seed, "--robots", names)
    if options.noise:
        yield from ("--noise", options.noise)
    if options.clock == PACED:
        yield from ("--lockstep", "--speed", "1")


def as_gateway(options: argparse.Namespace, place: RobotNumber) -> Iterator[str]:
    """Yield the names of all robots."""
    yield from ("--robots", ",".join(f"r{number}" for number in range(1, place.robots + 1)))


def as_driven(options: argparse.Namespace, place: RobotNumber) -> Iterator[str]:
    """Yield the goal that `up` would send to this robot."""
    run = run_for(options, place)
    heading_rad, own = run.world.goal.heading_rad, run.goals[place.number - 1]
    yield from (repr(own.x_m), repr(own.y_m))
    if heading_rad is not None:
        yield repr(rounded_degrees(heading_rad))


ADDED_OPTIONS: Final[Mapping[str, Callable[[argparse.Namespace, RobotNumber], Iterator[str]]]] = (
    MappingProxyType(
        {
            "robot": as_robot,
            "plant": as_plant,
            "gateway": as_gateway,
            "ros2": as_gateway,
            "goto": as_driven,
        }
    )
)


def run_for(options: argparse.Namespace, place: RobotNumber) -> WorldRun:
    """Ask the plant's command for the world; UserError with its error message."""
    return run_of(argparse.Namespace(world=options.world, robots=place.robots, goal=None))
