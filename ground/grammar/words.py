"""What was read of one command: a typed object that argparse fills, and the operation it means."""

import argparse
from importlib import import_module
from typing import Final, Protocol, runtime_checkable

from ground.client.operations import Operation, Progress
from ground.client.results import Outcome
from protocol.options import CONFIG_HELP, DEFAULT_ENDPOINT, above_zero
from runtime.cli.verb_table import VERBS, Verb

LONGEST_S: Final = 7 * 24 * 3600.0
positive: Final = above_zero()
seconds: Final = above_zero(LONGEST_S)


class Words:
    """The words of one verb; `declare` says which there are, `operation` what they mean.

    Attributes are those that were declared. An `action` is there where the verb has several.
    """

    verb: str
    action: str
    connect: str | None
    id: str | None
    config: str | None
    json: bool

    def __init__(self, verb: str) -> None:
        self.verb = verb

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Add the arguments of the verb to what reads them."""
        raise NotImplementedError

    def operation(self) -> Operation[Outcome]:
        """UserError names what is out of range."""
        raise NotImplementedError

    @property
    def title(self) -> str:
        """The verb, with its action if there are several."""
        return f"{self.verb} {self.action}" if hasattr(self, "action") else self.verb


def words_of(verb: Verb) -> type[Words]:
    """Import the class that reads the words of a verb."""
    found: type[Words] = getattr(import_module(verb.module), verb.words)
    return found


def common_verbs() -> dict[str, Verb]:
    """The verbs that are typed operations, which the app's command line has, too."""
    return {word: verb for word, verb in VERBS.items() if verb.words}


@runtime_checkable
class Offline(Protocol):
    """An operation on files, which needs no robot."""

    def run(self, progress: Progress) -> Outcome: ...


@runtime_checkable
class FromFile(Protocol):
    """An operation whose values are in a file; `read` raises UserError when they cannot be used."""

    def read(self) -> Operation[Outcome]: ...


def add_common(parser: argparse.ArgumentParser, *, listens: bool = False) -> None:
    """`--connect` (or `--listen`), `--id`, `--config` and `--json`."""
    if listens:
        parser.add_argument("--listen", metavar="ENDPOINT", help=f"({DEFAULT_ENDPOINT})")
    else:
        parser.add_argument("--connect", metavar="ENDPOINT", help=f"({DEFAULT_ENDPOINT})")
        parser.add_argument("--id", metavar="NAME", help="name of the robot (r1)")
    parser.add_argument("--config", metavar="FILE", help=CONFIG_HELP)
    add_json(parser)


def add_json(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
