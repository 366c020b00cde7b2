"""The operator's verbs, loaded: one grammar, for the command line and for the console.

A verb's module is imported when the verb is looked up, not before: who opens the ground station
waits for none of the others.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from typing import Final, NamedTuple, TypeAlias

from ground.client.connection import common_of
from ground.client.link import Link, linked
from ground.text.output import Says
from runtime.cli import verb_table
from runtime.cli.verb_table import Verb

Arguments: TypeAlias = Callable[[argparse.ArgumentParser], None]
Run: TypeAlias = Callable[[argparse.Namespace, Says], int]
Act: TypeAlias = Callable[[argparse.Namespace, Link, Says], int]


class LoadedVerb(NamedTuple):
    """How to read its arguments and how to do it; `run` returns the exit code.

    A verb that talks to a robot does so in `act`, over a link that is there already.
    """

    arguments: Arguments
    run: Run
    summary: str
    act: Act | None = None


def loaded(verb: Verb) -> LoadedVerb:
    """Import the module of a verb; without `run` it opens a link and acts."""
    module = import_module(verb.module)
    arguments: Arguments = getattr(module, verb.arguments)
    act: Act | None = getattr(module, verb.act) if verb.act else None
    if verb.run:
        return LoadedVerb(arguments, getattr(module, verb.run), verb.summary, act)
    assert act is not None, "a verb runs or acts"
    return LoadedVerb(arguments, talking(act), verb.summary, act)


def talking(act: Act) -> Run:
    """What opens the link and acts, and no more."""

    def run(options: argparse.Namespace, says: Says) -> int:
        with linked(common_of(options)) as link:
            return act(options, link, says)

    return run


class Verbs(Mapping[str, LoadedVerb]):
    """The verbs of the table that are the operator's, each loaded when it is looked up."""

    def __init__(self, table: Mapping[str, Verb]) -> None:
        self._rows = {word: verb for word, verb in table.items() if not verb.is_program}

    def __getitem__(self, word: str) -> LoadedVerb:
        return loaded(self._rows[word])

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)

    def __contains__(self, word: object) -> bool:
        return word in self._rows

    def summary(self, word: str) -> str:
        """Return its line of help, without loading it."""
        return self._rows[word].summary


VERBS: Final = Verbs(verb_table.VERBS)


def parser_of(verb: LoadedVerb, word: str) -> argparse.ArgumentParser:
    """What reads the arguments of a verb that goes by this word, on a command line."""
    parser = argparse.ArgumentParser(
        prog=f"sidestep {word}", description=verb.summary, allow_abbrev=False
    )
    verb.arguments(parser)
    return parser
