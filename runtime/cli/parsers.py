"""Parsers of the verbs, each with its summary and its example."""

import argparse
from importlib import import_module

from runtime.cli.verb_table import VERBS, command_of

PROGRAM = "sidestep"


def new_parser(
    word: str, *, details: str = "", allow_abbrev: bool = False
) -> argparse.ArgumentParser:
    """Return a parser without arguments for a verb of the table.

    `details` precedes the example after the list of options.
    """
    verb = VERBS[word]
    example = f"example:\n  {PROGRAM} {verb.example}"
    return argparse.ArgumentParser(
        prog=f"{PROGRAM} {command_of(word)}",
        description=verb.summary,
        epilog=f"{details}\n\n{example}" if details else example,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=allow_abbrev,
    )


def parser_of(word: str) -> argparse.ArgumentParser:
    """Import the module of a verb, and return the parser of its arguments."""
    verb = VERBS[word]
    module = import_module(verb.module)
    if verb.is_program:
        program: argparse.ArgumentParser = module.parser()
        return program
    parser = new_parser(word)
    declare = getattr(module, verb.words).declare if verb.words else module.__dict__[verb.arguments]
    declare(parser)
    return parser
