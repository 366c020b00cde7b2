"""The operator's verbs, loaded: how their arguments are read, and how they are done.

A verb's module is imported when the verb is looked up, not before: the ground station waits for
none of the others.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from typing import Any, Final, NamedTuple, TypeAlias

from ground.cli import operate
from ground.cli.options import common_of
from ground.client.link import Link, open_link
from ground.grammar.words import Words, words_of
from ground.text.output import Output
from runtime.cli import verb_table
from runtime.cli.verb_table import Verb

Arguments: TypeAlias = Callable[[argparse.ArgumentParser], None]
Run: TypeAlias = Callable[[Any, Output], int]
"""Does a verb with the arguments that were read: its `Words`, or argparse's own object."""
Act: TypeAlias = Callable[[argparse.Namespace, Link, Output], int]


class LoadedVerb(NamedTuple):
    """How to read its arguments and how to do it; `run` returns the exit code.

    `words` makes the typed object that its arguments fill; argparse's own without it.
    """

    arguments: Arguments
    run: Run
    summary: str
    words: Callable[[str], Words] | None = None


def loaded(verb: Verb) -> LoadedVerb:
    """Import the module of a verb; without `run` it opens a link and acts."""
    if verb.words:
        words = words_of(verb)
        return LoadedVerb(words.declare, operate.run, verb.summary, words)
    module = import_module(verb.module)
    run: Run = getattr(module, verb.run) if verb.run else talking(getattr(module, verb.act))
    return LoadedVerb(getattr(module, verb.arguments), run, verb.summary)


def talking(act: Act) -> Run:
    """What opens the link and acts, and no more."""

    def run(options: argparse.Namespace, says: Output) -> int:
        with open_link(common_of(options)) as link:
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


VERBS: Final = Verbs(verb_table.VERBS)


def parser_of(verb: LoadedVerb, word: str) -> argparse.ArgumentParser:
    """What reads the arguments of a verb that goes by this word, on a command line."""
    parser = argparse.ArgumentParser(
        prog=f"sidestep {word}", description=verb.summary, allow_abbrev=False
    )
    verb.arguments(parser)
    return parser
