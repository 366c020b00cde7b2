"""Arguments of the verbs that are one command, and of the emergency stop, lease and mark."""

import argparse
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from ground.client.outcomes import Outcome
from ground.client.session import Operation
from ground.client.vocabulary import NAVIGATORS, SIDES
from ground.commands.all_robots import ClearAll, StopAll
from ground.commands.lease import IDLE_S, ChangeLease, ShowLease
from ground.commands.stop import (
    COMMANDS,
    STOP_S,
    Mark,
    PlainCommand,
    SetMode,
    SetNavigator,
    StopNow,
)
from ground.grammar.words import Words, add_common, add_seize, seconds
from protocol.wire.enums import LeaseAction, Mode
from runtime.errors import UserError

PLAIN: Final[Mapping[str, type[PlainCommand]]] = MappingProxyType(
    {command.verb: command for command in COMMANDS}
)
LEASE_ACTIONS: Final = ("take", "release", "seize", "show")
ALL: Final = "all"


class CommandWords(Words):
    """The arguments of a command without arguments of its own."""

    timeout: float | None

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        add_common(parser)
        parser.add_argument(
            "--timeout",
            type=seconds,
            metavar="S",
            help="give up after this time, in three attempts (default 1.5)",
        )

    def operation(self) -> Operation[Outcome]:
        """Return the operation for the parsed arguments."""
        return PLAIN[self.verb](timeout_s=self.timeout)


class LeasedCommandWords(CommandWords):
    """The arguments of a command that only the operator of the robot may give."""

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        super().declare(parser)
        add_seize(parser)


class ModeWords(LeasedCommandWords):
    """The arguments of `mode`."""

    mode: str

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        names = [mode.name.lower() for mode in Mode]
        parser.add_argument("mode", type=str.lower, choices=names, help=", ".join(names))
        super().declare(parser)

    def operation(self) -> SetMode:
        """Return the operation for the parsed arguments."""
        return SetMode(mode=Mode[self.mode.upper()], timeout_s=self.timeout)


class NavigatorWords(LeasedCommandWords):
    """The arguments of `navigator`."""

    navigator: str
    side: str | None

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        parser.add_argument("navigator", type=str.lower, choices=list(NAVIGATORS))
        parser.add_argument(
            "side",
            nargs="?",
            type=str.lower,
            choices=list(SIDES),
            help="side on which obstacles are passed",
        )
        super().declare(parser)

    def operation(self) -> SetNavigator:
        """Return the operation for the parsed arguments."""
        side = 0 if self.side is None else SIDES[self.side]
        navigator = NAVIGATORS[self.navigator]
        return SetNavigator(navigator=navigator, side=side, timeout_s=self.timeout)


class AllWords(Words):
    """The arguments of a verb that acts on one robot or on all of them."""

    everyone: str | None
    all: bool

    @property
    def is_for_all(self) -> bool:
        """True with `all` or `--all`; UserError if a robot is named as well."""
        everyone = self.all or self.everyone is not None
        if everyone and self.id is not None:
            raise UserError("--all cannot be combined with --id: leave out one of them")
        return everyone


def add_all(parser: argparse.ArgumentParser) -> None:
    """Declare `all` and `--all`."""
    help = "every robot that is present"
    parser.add_argument("everyone", nargs="?", choices=[ALL], metavar=ALL, help=help)
    parser.add_argument("--all", action="store_true", help=help)


class ClearWords(LeasedCommandWords, AllWords):
    """The arguments of `clear-estop`."""

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        add_all(parser)
        super().declare(parser)

    def operation(self) -> Operation[Outcome]:
        """Return the operation for the parsed arguments."""
        if self.is_for_all:
            return ClearAll(timeout_s=self.timeout)
        return super().operation()


class StopWords(AllWords):
    """The arguments of `estop`."""

    timeout: float | None

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        add_all(parser)
        add_common(parser)
        help = f"repeat until the robot's status shows it, for at most (default {STOP_S:g})"
        parser.add_argument("--timeout", type=seconds, metavar="S", help=help)

    def operation(self) -> StopNow | StopAll:
        """Return the operation for the parsed arguments."""
        timeout_s = STOP_S if self.timeout is None else self.timeout
        if self.is_for_all:
            return StopAll(timeout_s=timeout_s)
        return StopNow(timeout_s=timeout_s)


class LeaseWords(Words):
    """The arguments of `lease`."""

    name: str | None
    hold: float | None

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        help = "take is refused while another person holds it; the robot takes it back when nothing"
        help += f" has been driven for {IDLE_S} s"
        parser.add_argument("action", choices=LEASE_ACTIONS, help=help)
        parser.add_argument(
            "--name", metavar="N", help="name shown to other operators (default user@host:terminal)"
        )
        parser.add_argument(
            "--for", dest="hold", type=seconds, metavar="S", help="keep it for this time"
        )
        add_common(parser)

    def operation(self) -> ShowLease | ChangeLease:
        """Return the operation for the parsed arguments."""
        if self.action == "show":
            return ShowLease()
        action = LeaseAction[self.action.upper()]
        return ChangeLease(action=action, name=self.name, for_s=self.hold)


class MarkWords(Words):
    """The arguments of `mark`."""

    text: list[str]

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        parser.add_argument("text", nargs="+", metavar="TEXT", help="the remark")
        add_common(parser)

    def operation(self) -> Mark:
        """Return the operation for the parsed arguments."""
        return Mark(remark=" ".join(self.text))
