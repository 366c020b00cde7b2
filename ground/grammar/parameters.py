"""Arguments of `param`."""

import argparse
from collections.abc import Callable
from pathlib import Path

from ground.client.operations import (
    LoadParameters,
    Operation,
    ResetParameter,
    SaveParameters,
    SetParameter,
    ShowParameters,
)
from ground.client.results import Outcome
from ground.grammar.words import Words, add_common
from protocol.options import finite


class ParameterWords(Words):
    """The arguments of `param`."""

    pattern: str
    name: str
    value: float
    file: Path | None

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        names = "list|get|diff|set|reset|save|load"
        actions = parser.add_subparsers(dest="action", required=True, metavar=names)
        help = "all parameters, with unit, range, default and meaning"
        listing = actions.add_parser("list", help=help)
        listing.add_argument("pattern", nargs="?", default="*", metavar="GLOB")
        getting = actions.add_parser("get", help="parameters whose name matches, as in 'sonar_*'")
        getting.add_argument("pattern", metavar="GLOB")
        help = "set one parameter; a robot with --state saves it"
        setting = actions.add_parser("set", help=help)
        setting.add_argument("name", metavar="NAME")
        setting.add_argument("value", type=finite, metavar="VALUE")
        resetting = actions.add_parser("reset", help="set one parameter to its default value")
        resetting.add_argument("name", metavar="NAME")
        help = "write the changed parameters to a file"
        saving = actions.add_parser("save", help=help)
        help = "without it, list what the robot saves by itself"
        saving.add_argument("file", nargs="?", type=Path, metavar="FILE", help=help)
        loading = actions.add_parser("load", help="set all values of a file, if all are allowed")
        loading.add_argument("file", type=Path, metavar="FILE", help="TOML with [parameters]")
        differing = actions.add_parser("diff", help="parameters that differ from their defaults")
        for action in (listing, getting, setting, resetting, saving, loading, differing):
            add_common(action)

    def operation(self) -> Operation[Outcome]:
        """Return the operation for the parsed arguments."""
        meanings: dict[str, Callable[[], Operation[Outcome]]] = {
            "list": lambda: ShowParameters(pattern=self.pattern),
            "get": lambda: ShowParameters(pattern=self.pattern, wide=False),
            "diff": lambda: ShowParameters(only_changed=True),
            "set": lambda: SetParameter(name=self.name, value=self.value),
            "reset": lambda: ResetParameter(name=self.name),
            "save": lambda: SaveParameters(file=self.file),
            "load": lambda: LoadParameters(file=self.file or Path()),
        }
        return meanings[self.action]()
