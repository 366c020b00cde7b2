"""The table from verb to what does it: one grammar, for the command line and for the console.

A verb's module is imported when the verb is looked up, not before: who opens the ground station
waits for none of the others.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from types import MappingProxyType
from typing import Final, NamedTuple, TypeAlias

from ground.client.connection import common_of
from ground.client.link import Link, linked
from ground.text.output import Says

Arguments: TypeAlias = Callable[[argparse.ArgumentParser], None]
Run: TypeAlias = Callable[[argparse.Namespace, Says], int]
Act: TypeAlias = Callable[[argparse.Namespace, Link, Says], int]


class Verb(NamedTuple):
    """How to read its arguments and how to do it; `run` returns the exit code.

    A verb that talks to a robot does so in `act`, over a link that is there already.
    """

    arguments: Arguments
    run: Run
    says: str
    act: Act | None = None


class Place(NamedTuple):
    """Where a verb is, by the names of its functions; without `run` it opens a link and acts."""

    says: str
    module: str
    act: str = ""
    run: str = ""
    arguments: str = "arguments"

    def verb(self) -> Verb:
        module = import_module(f"ground.cli.{self.module}")
        arguments: Arguments = getattr(module, self.arguments)
        act: Act | None = getattr(module, self.act) if self.act else None
        if self.run:
            return Verb(arguments, getattr(module, self.run), self.says, act)
        assert act is not None, "a verb runs or acts"
        return Verb(arguments, talking(act), self.says, act)


def talking(act: Act) -> Run:
    """What opens the link and acts, and no more."""

    def run(options: argparse.Namespace, says: Says) -> int:
        with linked(common_of(options)) as link:
            return act(options, link, says)

    return run


def order(says: str) -> Place:
    """A verb that is one command."""
    return Place(says, SIMPLE, "act")


def both(says: str, module: str) -> Place:
    """A verb that refuses what it can before anybody is dialled, and then acts."""
    return Place(says, module, "act", "run")


def alone(says: str, module: str) -> Place:
    """A verb that talks to no robot, or brings its own."""
    return Place(says, module, run="run")


SIMPLE: Final = "command.simple_commands"

PLACES: Final[Mapping[str, Place]] = MappingProxyType(
    {
        "up": alone("start plant, robot and a goal, and tell how it ended", "run.up"),
        "goto": both("drive to X Y [DEG] and wait for the outcome", "command.goto"),
        "hold": order("stand still, keep the goal"),
        "resume": order("go on to the goal"),
        "abort": order("drop the goal and stand still"),
        "estop": Place(
            "emergency stop, latched",
            SIMPLE,
            "act_estop",
            arguments="estop_arguments",
        ),
        "clear-estop": order("release the emergency stop"),
        "arm": order("let the wheels turn"),
        "disarm": order("do not let the wheels turn"),
        "rtl": order("drive back along the robot's own trail"),
        "mode": Place("choose the mode", SIMPLE, "act_mode", arguments="mode_arguments"),
        "navigator": Place(
            "choose the navigator",
            SIMPLE,
            "act_navigator",
            arguments="navigator_arguments",
        ),
        "param": Place("read and set the robot's parameters", "command.param", "act"),
        "mission": both("waypoints: send, start, pause, jump, fetch", "command.mission"),
        "fence": both("keep the robot inside of a place", "command.fence"),
        "lease": Place("who commands the robot: take it, give it back", "command.lease", "act"),
        "teleop": both("drive by hand: SPEED YAW_DEG_S", "command.teleop"),
        "watch": Place("show what the robot says, line by line", "look.watch", "act"),
        "ground": Place(
            "the ground station, in this terminal or in a browser",
            "look.watch",
            "act_ground",
            "run_ground",
            "ground_arguments",
        ),
        "doctor": both("say what is missing and what to do", "look.doctor"),
        "health": both("are the data of a role flowing?", "look.health"),
        "berth": alone("a verb in one of several containers", "run.container"),
        "router": alone("a Zenoh router, until told to stop", "run.router"),
        "keys": alone(
            "who may join a locked bus: certificates made and checked", "run.certificates"
        ),
        "explain": both("why did it turn?", "look.explain"),
        "ghost": both("another navigator from here on", "look.ghost"),
        "record": alone("write every frame to .tlog and .mcap", "look.record"),
        "bridge": Place("live, for Foxglove or Lichtblick to connect to", "look.bridge", "act"),
        "mark": Place(
            "a remark in what is recorded", "look.record", "act_mark", arguments="mark_arguments"
        ),
        "replay": alone("a recorded run, shown or executed again", "look.replay"),
        "export": alone("a recording as CSV or Parquet", "look.export"),
        "plot": alone("a recorded run as a picture", "look.plot"),
    }
)


class Verbs(Mapping[str, Verb]):
    """The same as verbs that can be done."""

    def __getitem__(self, word: str) -> Verb:
        return PLACES[word].verb()

    def __iter__(self) -> Iterator[str]:
        return iter(PLACES)

    def __len__(self) -> int:
        return len(PLACES)

    def __contains__(self, word: object) -> bool:
        return word in PLACES


VERBS: Final = Verbs()


def parser_of(verb: Verb, word: str) -> argparse.ArgumentParser:
    """What reads the arguments of a verb that goes by this word, on a command line."""
    parser = argparse.ArgumentParser(
        prog=f"sidestep {word}", description=verb.says, allow_abbrev=False
    )
    verb.arguments(parser)
    return parser
