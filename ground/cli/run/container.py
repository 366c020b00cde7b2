"""`berth`: a verb in its place among containers: which robot, where it stands, which network.

Containers of one service are started alike and have to find out which of them they are. Each can
be reached by a name that ends in its number, so it asks which of these names leads to itself:
container 2 has the robot r2. What `up` would give to a process is added to the verb's own words.
"""

import argparse
import os
import socket
from collections.abc import Callable, Iterator, Mapping, Sequence
from math import radians
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from ground.launch.child_command import command
from ground.launch.scenario import world_facts, world_query
from ground.text.output import Output
from protocol.bus.network import MAX_ROBOTS
from protocol.options import whole
from protocol.wire.goal import start_arguments
from runtime.calibration import settings_of
from runtime.errors import UserError

KEY: Final = ".key"
MOST_USERS: Final = 60_000
NAME: Final = "{id}"
"""Stands for the robot's name in file names and in the verb's words."""

Addresses = Callable[[str], frozenset[str]]


class Place(NamedTuple):
    """Which robot it is, counted from 1, and of how many."""

    number: int
    robots: int

    @property
    def robot(self) -> str:
        return f"r{self.number}"


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.set_defaults(json=False)
    parser.add_argument(
        "--config",
        action="append",
        default=[],
        metavar="FILE",
        help=f"the network, for verbs that use it: the first of these files that is there; {NAME}"
        " in it is the robot's name",
    )
    parser.add_argument(
        "--replica", metavar="STEM", help="this is one of the containers STEM1, STEM2 and so on"
    )
    parser.add_argument("--world", metavar="W", default="box", help="(box)")
    parser.add_argument("--noise", metavar="LEVEL", default="", help="as the world says")
    parser.add_argument("--seed", metavar="S", default="0", help="(0)")
    parser.add_argument(
        "--robots",
        type=whole(1, MAX_ROBOTS),
        default=1,
        metavar="K",
        help="how many there are (1)",
    )
    parser.add_argument(
        "--users",
        type=whole(1, MOST_USERS),
        metavar="U",
        help="go on as the user U + 1 for r1, U + 2 for r2 and so on, so that none can read what "
        "is another's",
    )
    parser.add_argument(
        "--own", metavar="DIR", help=f"a folder to make, of that user alone; {NAME} as above"
    )
    parser.add_argument("words", nargs=argparse.REMAINDER, metavar="VERB ...")


def run(options: argparse.Namespace, output: Output) -> int:
    """Becomes the verb. Raises UserError when its place cannot be found out."""
    place = place_of(options, addresses)
    if options.users is not None:
        become(options.users + place.number)
    if options.own is not None:
        take(Path(options.own.replace(NAME, place.robot)))
    words = ["sidestep", *words_of(options, place)]
    try:
        os.execvp(words[0], words)
    except FileNotFoundError:
        raise UserError("berth: there is no `sidestep` on the path") from None


def become(user: int) -> None:
    """Switch to this user and group, without capabilities and with files private to it."""
    try:
        os.setgroups([])
        os.setgid(user)
        os.setuid(user)
    except PermissionError as error:
        raise UserError(f"berth: it cannot go on as user {user}: start it as root") from error
    os.umask(0o077)


def take(folder: Path) -> None:
    """Make a folder that is ours alone. UserError when it is there and another one's."""
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        owner = folder.lstat().st_uid
    except OSError as error:
        raise UserError(f"berth: {folder}: {error.strerror}") from error
    if owner != os.geteuid():
        raise UserError(
            f"berth: {folder} belongs to user {owner}, and this process is user {os.geteuid()}: "
            "take it away, or give it to this one"
        )


def words_of(options: argparse.Namespace, place: Place) -> list[str]:
    """The verb with all that it is to be told."""
    verb, *words = (word.replace(NAME, place.robot) for word in options.words)
    added = [*PLACED[verb](options, place)] if verb in PLACED else []
    if options.replica is not None and verb != "plant":
        added += ["--id", place.robot]
    if options.config and takes_config(verb):
        added += ["--config", config_of(options.config, place)]
    return [verb, *added, *words]


def place_of(options: argparse.Namespace, lookup: Addresses) -> Place:
    """Its number: 1 unless it is one of several. UserError when there are not so many."""
    if not options.words:
        raise UserError("berth: which verb? for example: berth --robots 2 plant")
    number = 1 if options.replica is None else number_of(options.replica, lookup)
    if number > options.robots:
        raise UserError(f"this is container {number} of --robots {options.robots}: set ROBOTS")
    return Place(number, options.robots)


def number_of(stem: str, lookup: Addresses) -> int:
    """Which of the names STEM1, STEM2 and so on leads here; UserError when none does."""
    here = lookup(socket.gethostname())
    for number in range(1, MAX_ROBOTS + 1):
        if here & lookup(f"{stem}{number}"):
            return number
    raise UserError(
        f"--replica {stem}: none of {stem}1 to {stem}{MAX_ROBOTS} leads to this container; "
        "is it on a network of its own, and are there no more robots than that?"
    )


def addresses(name: str) -> frozenset[str]:
    """Where a name leads; nowhere when nobody has it."""
    try:
        found = socket.getaddrinfo(name, None, type=socket.SOCK_STREAM)
    except OSError:
        return frozenset()
    return frozenset(str(place[0]) for *_, place in found)


def config_of(files: Sequence[str], place: Place) -> str:
    """Return the first existing path; else the last one, so that its reader reports it missing.

    UserError where keys are meant to be used and cannot be: the next file may be one without.
    """
    for name in files[:-1]:
        file = Path(name.replace(NAME, place.robot))
        if is_there(file):
            return str(file)
        refuse_keys_of_others(file, apart=NAME in Path(name).parent.name)
    return files[-1].replace(NAME, place.robot)


def is_there(file: Path) -> bool:
    """Return whether the file exists. Raise UserError if that cannot be determined."""
    try:
        file.stat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError as error:
        raise UserError(
            f"berth: {file}: {error.strerror}: without its keys this process does not start; "
            "let its user read that folder"
        ) from error
    return True


def refuse_keys_of_others(file: Path, *, apart: bool) -> None:
    """Raise UserError when the folder of a missing file holds keys: our own are not among them.

    `apart`: each robot has a folder of its own for its keys, beside those of the others.
    """
    folder = file.parent.parent if apart else file.parent
    try:
        keys = sorted(path.name for path in folder.iterdir() if apart or path.suffix == KEY)
    except (FileNotFoundError, NotADirectoryError):
        return
    except OSError as error:
        raise UserError(f"berth: {folder}: {error.strerror}: let its user read it") from error
    if keys:
        raise UserError(
            f"berth: {folder} holds {keys[0]} and no {file.relative_to(folder)}: this process does "
            "not start without keys of its own; give it these, or take the others away"
        )


def takes_config(verb: str) -> bool:
    """Whether it talks to others."""
    from ground.cli.verbs import VERBS, parser_of  # which know this verb

    if verb not in VERBS:
        return verb in ("robot", "plant")
    return "--config" in parser_of(VERBS[verb], verb).format_usage()


def as_robot(options: argparse.Namespace, place: Place) -> Iterator[str]:
    """Where it stands, and the parameters that a robot of this world has."""
    facts = facts_of(options, place)
    start = facts["starts"][place.number - 1]
    heading_rad = radians(start["heading_deg"])
    yield from ("--start", *start_arguments(start["x_m"], start["y_m"], heading_rad))
    level = options.noise or str(facts["noise"].get("level", "default"))
    for name, value in settings_of(facts["robot"], level, calibrated=True).items():
        yield from ("--param", f"{name}={value!r}")


def as_plant(options: argparse.Namespace, place: Place) -> Iterator[str]:
    """The world with all robots in it."""
    names = ",".join(f"r{number}" for number in range(1, place.robots + 1))
    yield from ("--world", options.world, "--seed", options.seed, "--robots", names)
    if options.noise:
        yield from ("--noise", options.noise)


def as_driven(options: argparse.Namespace, place: Place) -> Iterator[str]:
    """Without a destination of its own it goes where `up` would send this robot."""
    if len(options.words) == 1:
        facts = facts_of(options, place)
        goal, own = facts["goal"], facts["goals"][place.number - 1]
        yield from (repr(own["x_m"]), repr(own["y_m"]))
        if goal["heading_deg"] is not None:
            yield repr(goal["heading_deg"])


PLACED: Final[Mapping[str, Callable[[argparse.Namespace, Place], Iterator[str]]]] = (
    MappingProxyType({"robot": as_robot, "plant": as_plant, "goto": as_driven})
)


def facts_of(options: argparse.Namespace, place: Place) -> dict[str, Any]:
    """What the plant's side says of the world; UserError with its words when it refuses."""
    asked = argparse.Namespace(world=options.world, robots=place.robots, goal=None)
    return world_facts(command(world_query(asked), os.getpid()))
