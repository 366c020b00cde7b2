"""The parsed arguments of a verb: a typed object that argparse fills, and its operation."""

import argparse
from importlib import import_module
from typing import Final, Protocol, runtime_checkable

from ground.client.connection import LONGEST_S
from ground.client.outcomes import Outcome, Progress
from ground.client.session import Operation
from protocol.options import CONFIG_HELP, DEFAULT_ENDPOINT, above_zero
from runtime.cli.verb_table import VERBS, Verb

positive: Final = above_zero()
seconds: Final = above_zero(LONGEST_S)


class Words:
    """The arguments of one verb.

    The attributes are those that `declare` declares. Verbs with several actions have an `action`.
    """

    verb: str
    action: str
    chosen: str = ""
    """The file that was chosen because none was named, or a remark on it; it is printed."""
    connect: str | None
    id: str | None
    config: str | None
    run: str | None
    context: str | None
    json: bool
    seize: bool = False
    """Whether to take the lease from another operator first."""

    def __init__(self, verb: str) -> None:
        self.verb = verb

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments of the verb on its parser."""
        raise NotImplementedError

    def operation(self) -> Operation[Outcome]:
        """Return the operation for the parsed arguments; UserError for a value out of range."""
        raise NotImplementedError

    def without_robot(self) -> "Offline | None":
        """Return what is done instead when no robot was named and none answers, if anything."""
        return None

    @property
    def title(self) -> str:
        """The verb, with its action if it has several."""
        return f"{self.verb} {self.action}" if hasattr(self, "action") else self.verb


def words_of(verb: Verb) -> type[Words]:
    """Import the class for the arguments of a verb."""
    found: type[Words] = getattr(import_module(verb.module), verb.words)
    return found


def common_verbs() -> dict[str, Verb]:
    """Return the verbs that are typed operations, which the app's command line has too."""
    return {word: verb for word, verb in VERBS.items() if verb.words}


@runtime_checkable
class Offline(Protocol):
    """An operation on files, which needs no robot."""

    def run(self, progress: Progress) -> Outcome:
        """Carry it out."""


@runtime_checkable
class FromFile(Protocol):
    """An operation whose values are in a file."""

    def read(self) -> Operation[Outcome]:
        """Read the file; UserError if its values are invalid."""


def add_common(parser: argparse.ArgumentParser, *, listens: bool = False) -> None:
    """Declare `--listen`, or what names a system and its robot; `--config` and `--json`."""
    if listens:
        parser.add_argument("--listen", metavar="ENDPOINT", help=f"(default {DEFAULT_ENDPOINT})")
    else:
        text = f"where it listens (default that of `up`, if one runs here, else {DEFAULT_ENDPOINT})"
        parser.add_argument("--connect", metavar="ENDPOINT", help=text)
        text = "a running `up`, by its name in `sidestep ps`"
        parser.add_argument("--run", metavar="NAME", help=text)
        text = "a system by its name in the settings, see `sidestep config context`"
        parser.add_argument("--context", metavar="NAME", help=text)
        parser.add_argument("--id", metavar="NAME", help="name of the robot (default r1)")
    parser.add_argument("--config", metavar="FILE", help=CONFIG_HELP)
    add_json(parser)


def add_seize(parser: argparse.ArgumentParser) -> None:
    """Declare `--seize`, for what only the operator of the robot may do."""
    help = "take the lease from another operator first"
    parser.add_argument("--seize", action="store_true", help=help)


def add_anyway(parser: argparse.ArgumentParser, what: str) -> None:
    """Declare `--anyway`."""
    help = f"send {what} outside of the known world or in an obstacle, too"
    parser.add_argument("--anyway", action="store_true", help=help)


def add_json(parser: argparse.ArgumentParser) -> None:
    """Declare `--json`."""
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
