"""Words of `param`."""

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
    pattern: str
    name: str
    value: float
    file: Path | None

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        names = "list|get|diff|set|reset|save|load"
        actions = parser.add_subparsers(dest="action", required=True, metavar=names)
        help = "all of them, with unit, range, default and meaning"
        listing = actions.add_parser("list", help=help)
        listing.add_argument("pattern", nargs="?", default="*", metavar="GLOB")
        getting = actions.add_parser("get", help="those whose name matches, as in 'sonar_*'")
        getting.add_argument("pattern", metavar="GLOB")
        help = "give one a value; a robot with --state saves it"
        setting = actions.add_parser("set", help=help)
        setting.add_argument("name", metavar="NAME")
        setting.add_argument("value", type=finite, metavar="VALUE")
        resetting = actions.add_parser("reset", help="give one its default value")
        resetting.add_argument("name", metavar="NAME")
        help = "write what is not default; set saves on the robot"
        saving = actions.add_parser("save", help=help)
        help = "without it, say what the robot keeps"
        saving.add_argument("file", nargs="?", type=Path, metavar="FILE", help=help)
        loading = actions.add_parser("load", help="set all that a file says, if all of it can be")
        loading.add_argument("file", type=Path, metavar="FILE", help="TOML with [parameters]")
        differing = actions.add_parser("diff", help="those that are not as they are by default")
        for action in (listing, getting, setting, resetting, saving, loading, differing):
            add_common(action)

    def operation(self) -> Operation[Outcome]:
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
