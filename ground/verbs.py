"""The table from verb to what does it: one grammar, for the command line and for the console."""

import argparse
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final, NamedTuple, TypeAlias

from ground import (
    doctor,
    exporting,
    fence,
    goto,
    lease,
    orders,
    param,
    plotting,
    record,
    replay,
    router,
    teleop,
    up,
    watch,
)
from ground.explain import verb as explain
from ground.ghost import verb as ghost
from ground.link import Link, linked
from ground.missions import verb as mission
from ground.options import common_of
from ground.says import Says

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


def talking(arguments: Arguments, act: Act, says: str) -> Verb:
    """A verb whose `run` opens the link and acts, and no more."""

    def run(options: argparse.Namespace, says: Says) -> int:
        with linked(common_of(options)) as link:
            return act(options, link, says)

    return Verb(arguments, run, says, act)


def order(says: str) -> Verb:
    """A verb that is one command."""
    return talking(orders.arguments, orders.act, says)


VERBS: Final[Mapping[str, Verb]] = MappingProxyType(
    {
        "up": Verb(up.arguments, up.run, "start plant, robot and a goal, and tell how it ended"),
        "goto": Verb(
            goto.arguments, goto.run, "drive to X Y [DEG] and wait for the outcome", goto.act
        ),
        "hold": order("stand still, keep the goal"),
        "resume": order("go on to the goal"),
        "abort": order("drop the goal and stand still"),
        "estop": order("emergency stop, latched"),
        "clear-estop": order("release the emergency stop"),
        "arm": order("let the wheels turn"),
        "disarm": order("do not let the wheels turn"),
        "rtl": order("drive back along the robot's own trail"),
        "mode": talking(orders.mode_arguments, orders.act_mode, "choose the mode"),
        "navigator": talking(
            orders.navigator_arguments, orders.act_navigator, "choose the navigator"
        ),
        "param": talking(param.arguments, param.act, "read and set the robot's parameters"),
        "mission": Verb(
            mission.arguments,
            mission.run,
            "waypoints: send, start, pause, jump, fetch",
            mission.act,
        ),
        "fence": Verb(fence.arguments, fence.run, "keep the robot inside of a place", fence.act),
        "lease": talking(
            lease.arguments, lease.act, "who commands the robot: take it, give it back"
        ),
        "teleop": Verb(teleop.arguments, teleop.run, "drive by hand: SPEED YAW_DEG_S", teleop.act),
        "watch": talking(watch.arguments, watch.act, "show what the robot says, line by line"),
        "ground": Verb(
            watch.ground_arguments,
            watch.run_ground,
            "the ground station, in this terminal or in a browser",
            watch.act_ground,
        ),
        "doctor": Verb(
            doctor.arguments, doctor.run, "say what is missing and what to do", doctor.act
        ),
        "router": Verb(router.arguments, router.run, "a Zenoh router, until told to stop"),
        "explain": Verb(explain.arguments, explain.run, "why did it turn?", explain.act),
        "ghost": Verb(ghost.arguments, ghost.run, "another navigator from here on", ghost.act),
        "record": Verb(record.arguments, record.run, "write every frame to .tlog and .mcap"),
        "mark": talking(record.mark_arguments, record.act_mark, "a remark in what is recorded"),
        "replay": Verb(replay.arguments, replay.run, "a recorded run, shown or executed again"),
        "export": Verb(exporting.arguments, exporting.run, "a recording as CSV or Parquet"),
        "plot": Verb(plotting.arguments, plotting.run, "a recorded run as a picture"),
    }
)


def parser_of(verb: Verb, word: str) -> argparse.ArgumentParser:
    """What reads the arguments of a verb that goes by this word, on a command line."""
    parser = argparse.ArgumentParser(
        prog=f"sidestep {word}", description=verb.says, allow_abbrev=False
    )
    verb.arguments(parser)
    return parser
