"""The operator's verbs, loaded on demand: how to run them.

The module of a verb is imported when the verb is looked up, so that a process loads only the
modules it needs.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias

from ground.text.output import Output
from runtime.cli import verb_table
from runtime.cli.verb import Verb

if TYPE_CHECKING:
    from ground.client.link import Link
    from ground.grammar.words import Words

Run: TypeAlias = Callable[[Any, Output], int]
"""Runs a verb with its parsed arguments: its `Words`, or argparse's own object."""
Act: TypeAlias = Callable[[argparse.Namespace, "Link", Output], int]


class LoadedVerb(NamedTuple):
    """The functions of a verb; `run` returns the exit code.

    `words` creates the typed object for the parsed arguments; without it they stay argparse's own.
    """

    run: Run
    words: "Callable[[str], Words] | None" = None


def loaded(verb: Verb) -> LoadedVerb:
    """Import the module of a verb; one without `run` gets a link and acts on it."""
    if verb.words:
        from ground.cli import operate
        from ground.grammar.words import words_of

        words = words_of(verb)
        return LoadedVerb(operate.run, words)
    module = import_module(verb.module)
    run: Run = getattr(module, verb.run) if verb.run else with_link(getattr(module, verb.act))
    return LoadedVerb(run)


def with_link(act: Act) -> Run:
    """Return a function that opens a link and calls `act` with it."""

    def run(options: argparse.Namespace, output: Output) -> int:
        from ground.cli.options import common_of
        from ground.client.link import open_link

        with open_link(common_of(options, output)) as link:
            return act(options, link, output)

    return run


class Verbs(Mapping[str, LoadedVerb]):
    """The operator's verbs of the table, each loaded when it is looked up."""

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
