"""The parsed arguments of a verb: a typed object that argparse fills, and its operation."""

import argparse
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Protocol, runtime_checkable

from ground.client.outcomes import Outcome
from ground.client.session import Operation
from ground.commands.command import Group, OperatorCommand
from runtime.cli.verb import Verb
from runtime.cli.verb_table import VERBS


class Words:
    """The arguments of one verb.

    The attributes are those that `declare` declares. Verbs with several actions have an `action`.
    """

    verb: str
    action: str
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

    @property
    def title(self) -> str:
        """The verb, with its action if it has several."""
        return f"{self.verb} {self.action}" if hasattr(self, "action") else self.verb


class CommandWords(Words):
    """The arguments of a command, or of a group of commands."""

    def __init__(self, verb: str, kind: type[OperatorCommand] | Group) -> None:
        super().__init__(verb)
        self._kind = kind

    def operation(self) -> Any:
        """Return the command for the parsed arguments."""
        return self._kind.parsed(self)


@dataclass(frozen=True)
class CommandParser:
    """What `words_of` returns for a command, in place of a class."""

    kind: type[OperatorCommand] | Group

    def __call__(self, verb: str) -> CommandWords:
        """Return the object that argparse fills."""
        return CommandWords(verb, self.kind)

    def declare(self, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments of the verb on its parser."""
        self.kind.declare(parser)


def words_of(verb: Verb) -> type[Words] | CommandParser:
    """Import the class for the arguments of a verb."""
    found = getattr(import_module(verb.module), verb.words)
    is_words = isinstance(found, type) and issubclass(found, Words)
    return found if is_words else CommandParser(found)


def common_verbs() -> dict[str, Verb]:
    """Return the verbs that are typed operations, which the app's command line has too."""
    return {word: verb for word, verb in VERBS.items() if verb.words}


@runtime_checkable
class FromFile(Protocol):
    """An operation whose values are in a file."""

    def read(self) -> Operation[Outcome]:
        """Read the file; UserError if its values are invalid."""
