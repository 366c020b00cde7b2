"""Arguments of the emergency stop."""

import argparse
from typing import Final

from ground.commands.all_robots import ClearAll, StopAll
from ground.commands.command import add_common, add_seize, seconds
from ground.commands.stop import STOP_S, ClearEmergencyStop, StopNow
from ground.grammar.words import Words
from runtime.errors import UserError

ALL: Final = "all"


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


class ClearWords(AllWords):
    """The arguments of `clear-estop`."""

    timeout: float | None

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        add_all(parser)
        add_common(parser)
        help = "give up after this time, in three attempts (default 1.5)"
        parser.add_argument("--timeout", type=seconds, metavar="S", help=help)
        add_seize(parser)

    def operation(self) -> ClearAll | ClearEmergencyStop:
        """Return the operation for the parsed arguments."""
        if self.is_for_all:
            return ClearAll(timeout_s=self.timeout)
        return ClearEmergencyStop(timeout_s=self.timeout)


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
