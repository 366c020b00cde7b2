"""Words of the verbs that are one command, and of the emergency stop, the lease and a mark."""

import argparse
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from ground.client.operations import (
    COMMANDS,
    ChangeLease,
    Mark,
    Operation,
    SetMode,
    SetNavigator,
    ShowLease,
    StopNow,
)
from ground.client.operations.commands import STOP_S, PlainCommand
from ground.client.results import Outcome
from ground.client.vocabulary import NAVIGATORS, SIDES
from ground.grammar.words import Words, add_common, seconds
from protocol.wire.enums import LeaseAction, Mode

PLAIN: Final[Mapping[str, type[PlainCommand]]] = MappingProxyType(
    {command.verb: command for command in COMMANDS}
)
LEASE_ACTIONS: Final = ("take", "release", "seize", "show")


class CommandWords(Words):
    """A verb without arguments of its own."""

    timeout: float | None

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        add_common(parser)
        parser.add_argument(
            "--timeout",
            type=seconds,
            metavar="S",
            help="give up after this long, in three tries (1.5)",
        )

    def operation(self) -> Operation[Outcome]:
        return PLAIN[self.verb](timeout_s=self.timeout)


class ModeWords(CommandWords):
    mode: str

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        names = [mode.name.lower() for mode in Mode]
        parser.add_argument("mode", type=str.lower, choices=names, help=", ".join(names))
        super().declare(parser)

    def operation(self) -> SetMode:
        return SetMode(mode=Mode[self.mode.upper()], timeout_s=self.timeout)


class NavigatorWords(CommandWords):
    navigator: str
    side: str | None

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("navigator", type=str.lower, choices=list(NAVIGATORS))
        parser.add_argument(
            "side",
            nargs="?",
            type=str.lower,
            choices=list(SIDES),
            help="on which obstacles are passed",
        )
        super().declare(parser)

    def operation(self) -> SetNavigator:
        side = 0 if self.side is None else SIDES[self.side]
        navigator = NAVIGATORS[self.navigator]
        return SetNavigator(navigator=navigator, side=side, timeout_s=self.timeout)


class StopWords(Words):
    timeout: float | None

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        add_common(parser)
        help = f"repeat it for so long until it shows ({STOP_S:g})"
        parser.add_argument("--timeout", type=seconds, metavar="S", help=help)

    def operation(self) -> StopNow:
        return StopNow(timeout_s=STOP_S if self.timeout is None else self.timeout)


class LeaseWords(Words):
    name: str | None
    hold: float | None

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        help = "take: refused while another holds it"
        parser.add_argument("action", choices=LEASE_ACTIONS, help=help)
        parser.add_argument("--name", metavar="N", help="what others call you (your user name)")
        parser.add_argument(
            "--for", dest="hold", type=seconds, metavar="S", help="give it back after this long"
        )
        add_common(parser)

    def operation(self) -> ShowLease | ChangeLease:
        if self.action == "show":
            return ShowLease()
        action = LeaseAction[self.action.upper()]
        return ChangeLease(action=action, name=self.name, for_s=self.hold)


class MarkWords(Words):
    text: list[str]

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("text", nargs="+", metavar="TEXT", help="what is to be remembered")
        add_common(parser)

    def operation(self) -> Mark:
        return Mark(remark=" ".join(self.text))
