"""Parsers of the verbs and their subcommands, each with its summary and its example."""

import argparse
import re
from collections.abc import Mapping
from importlib import import_module
from typing import Final, NoReturn

from runtime.cli.verb import Subcommand
from runtime.cli.verb_table import VERBS, command_of, nearest

PROGRAM: Final = "sidestep"
UNKNOWN_OPTION: Final = re.compile(r"unrecognized arguments: (-[^ =]+)")
INVALID_CHOICE: Final = re.compile(r"invalid choice: '(.+)' \(choose from (.+)\)")

PLACE: Final = "an option stands after its verb, and before -- if there is one"


class VerbParser(argparse.ArgumentParser):
    """A parser whose errors suggest a word for a misspelt one."""

    def error(self, message: str) -> NoReturn:
        """Print the message with a suggestion and the option's help, else the usage; exit 2."""
        if found := UNKNOWN_OPTION.match(message):
            message += advice_on(found[1], self)
        elif found := INVALID_CHOICE.search(message):
            message += nearest(found[1], found[2].replace("'", "").split(", "))
            if help := help_of(message, self):
                self.exit(2, f"{self.prog}: error: {message}{help}\n")
        super().error(message)


def help_of(message: str, parser: argparse.ArgumentParser) -> str:
    """Return a line with the help of the option that an error names; empty without one."""
    options = parser._option_string_actions
    option = message.removeprefix("argument ").split(":")[0].split("/")[-1]
    text = options[option].help if option in options else None
    return f"\n  {option}: {text}" if text else ""


def advice_on(option: str, parser: argparse.ArgumentParser) -> str:
    """Return what to write for an option that was not taken: the nearest, or itself elsewhere."""
    names = options_below(parser)
    return f"; {PLACE}" if option in names else nearest(option, names)


def options_below(parser: argparse.ArgumentParser) -> set[str]:
    """Return the options of a parser and of its subcommands."""
    names = {name for action in parser._actions for name in action.option_strings}
    for below in subcommands_of(parser).values():
        names |= options_below(below)
    return names


def subcommands_of(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Return the parsers of the subcommands by name."""
    # argparse has no public interface to the subparsers.
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return dict(action.choices)
    return {}


def new_parser(
    word: str, *, details: str = "", allow_abbrev: bool = False
) -> argparse.ArgumentParser:
    """Return a parser without arguments for a verb of the table.

    `details` precedes the example after the list of options.
    """
    verb = VERBS[word]
    shown = example_text(verb.example)
    return VerbParser(
        prog=f"{PROGRAM} {command_of(word)}",
        description=verb.summary,
        epilog=f"{details}\n\n{shown}" if details else shown,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=allow_abbrev,
    )


def new_subcommand_parser(word: str, name: str) -> argparse.ArgumentParser:
    """Return a parser without arguments for a subcommand that is a program of its own."""
    row = VERBS[word].subcommands[name]
    return VerbParser(
        prog=f"{PROGRAM} {command_of(word)} {name}",
        description=row.summary,
        epilog=example_text(row.example),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )


def add_subcommands(
    parser: argparse.ArgumentParser,
    of: str | Mapping[str, Subcommand],
    *,
    dest: str = "action",
    allow_abbrev: bool = True,
) -> dict[str, argparse.ArgumentParser]:
    """Add subcommands, those of a verb or these, to its parser; return their parsers by name."""
    rows = VERBS[of].subcommands if isinstance(of, str) else of
    added = parser.add_subparsers(dest=dest, required=True, metavar="|".join(rows))
    return {
        name: added.add_parser(
            name,
            help=row.summary,
            description=row.summary,
            epilog=example_text(row.example),
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=allow_abbrev,
        )
        for name, row in rows.items()
    }


def example_text(example: str) -> str:
    """Return the end of a help text, with an example."""
    return f"example:\n  {PROGRAM} {example}"


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


def program_parsers(word: str) -> dict[str, argparse.ArgumentParser]:
    """Return the parsers of those subcommands of a verb that are programs of their own."""
    rows = VERBS[word].subcommands
    return {name: import_module(row.module).parser() for name, row in rows.items() if row.module}
