"""Arguments of the verbs that read the state of a robot or a recording."""

import argparse
from typing import Final

from ground.client.connection import LONGEST_S
from ground.commands.command import add_common, seconds
from ground.commands.doctor import LISTEN_S, Diagnose
from ground.commands.watch import LookOnce
from ground.grammar.words import Words
from protocol.options import up_to

moment: Final = up_to(LONGEST_S)


class WatchWords(Words):
    """The arguments of `watch`."""

    once: bool

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        add_common(parser)
        help = "print the state once, as --json does"
        parser.add_argument("--once", action="store_true", help=help)

    def operation(self) -> LookOnce:
        """Return the operation for the parsed arguments."""
        return LookOnce()


class DoctorWords(Words):
    """The arguments of `doctor`."""

    timeout: float

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        add_common(parser)
        help = f"listen for this time (default {LISTEN_S:g})"
        parser.add_argument("--timeout", type=seconds, default=LISTEN_S, metavar="S", help=help)

    def operation(self) -> Diagnose:
        """Return the operation for the parsed arguments."""
        return Diagnose(listen_s=self.timeout)
