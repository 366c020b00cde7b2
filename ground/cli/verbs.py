"""The operator's verbs, loaded on demand: how to run them.

The module of a verb is imported when the verb is looked up, so that a process loads only the
modules it needs.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from typing import Final, TypeAlias

from ground.text.output import Output
from runtime.cli import verb_table
from runtime.cli.verb import Verb

Run: TypeAlias = Callable[[argparse.Namespace, Output], int]
"""Runs a verb with its parsed arguments; returns the exit code."""


def loaded(verb: Verb) -> Run:
    """Import the module of a verb; one without `run` gets a link and acts on it."""
    if verb.words:
        from ground.cli import operate

        return operate.run
    run: Run = getattr(import_module(verb.module), verb.run)
    return run


class Verbs(Mapping[str, Run]):
    """The operator's verbs of the table, each loaded when it is looked up."""

    def __init__(self, table: Mapping[str, Verb]) -> None:
        self._rows = {word: verb for word, verb in table.items() if not verb.is_program}

    def __getitem__(self, word: str) -> Run:
        return loaded(self._rows[word])

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)

    def __contains__(self, word: object) -> bool:
        return word in self._rows


VERBS: Final = Verbs(verb_table.VERBS)
