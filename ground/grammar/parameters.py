"""Arguments of `param`."""

import argparse
from collections.abc import Callable
from pathlib import Path

from ground.client.outcomes import Outcome
from ground.client.session import Operation
from ground.client.vocabulary import value_in_words
from ground.commands.command import add_common, add_seize
from ground.commands.param import (
    LoadParameters,
    ResetParameter,
    SaveParameters,
    SetParameter,
    ShowParameters,
)
from ground.grammar.words import Words
from runtime.cli.parsers import add_subcommands


class ParameterWords(Words):
    """The arguments of `param`."""

    pattern: str
    name: str
    value: str
    file: Path | None

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        actions = add_subcommands(parser, "param")
        actions["list"].add_argument("pattern", nargs="?", default="*", metavar="GLOB")
        actions["get"].add_argument("pattern", metavar="GLOB")
        actions["set"].add_argument("name", metavar="NAME")
        help = "a number, or a name such as bug or left"
        actions["set"].add_argument("value", metavar="VALUE", help=help)
        actions["reset"].add_argument("name", metavar="NAME")
        help = "without it, list what the robot saves by itself"
        actions["save"].add_argument("file", nargs="?", type=Path, metavar="FILE", help=help)
        help = "TOML with [parameters]"
        actions["load"].add_argument("file", type=Path, metavar="FILE", help=help)
        for action in actions.values():
            add_common(action)
        for name in ("set", "reset", "load"):
            add_seize(actions[name])

    def operation(self) -> Operation[Outcome]:
        """Return the operation for the parsed arguments."""
        meanings: dict[str, Callable[[], Operation[Outcome]]] = {
            "list": lambda: ShowParameters(pattern=self.pattern),
            "get": lambda: ShowParameters(pattern=self.pattern, wide=False),
            "diff": lambda: ShowParameters(only_changed=True),
            "set": lambda: SetParameter(
                name=self.name, value=value_in_words(self.name, self.value)
            ),
            "reset": lambda: ResetParameter(name=self.name),
            "save": lambda: SaveParameters(file=self.file),
            "load": lambda: LoadParameters(file=self.file or Path()),
        }
        return meanings[self.action]()
