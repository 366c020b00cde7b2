"""`sidestep navigators`: list the navigators, and begin and check one of the user's own."""

import argparse
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from ground.client.vocabulary import NAVIGATOR_SUMMARIES
from protocol.navigators import NAVIGATORS, SUFFIX, OwnSource
from robot.own_navigator import load
from runtime.cli.parsers import add_subcommands, new_parser
from runtime.errors import UserError

TEMPLATE: Final = Path(__file__).with_name("navigator.txt")


def main(argv: Sequence[str]) -> int:
    """Return 0; raise UserError for a file that is there already, or cannot be used."""
    options = parser().parse_args(argv)
    if options.action == "list":
        listed(as_json=options.json)
    elif options.action == "new":
        print(f"{new(options.name)}: try it with `sidestep trial --navigator {options.name}.py`")
    else:
        own = load(options.file)
        print(f"{own.source}: ready, named {own.source.name}")
    return 0


def parser() -> argparse.ArgumentParser:
    """Return the parser of the verb."""
    made = new_parser("navigators")
    below = add_subcommands(made, "navigators")
    below["list"].add_argument("--json", action="store_true", help="print one JSON object")
    below["new"].add_argument("name", metavar="NAME", help="its name, and that of its file")
    text = "a file such as my_nav.py or my_nav.py:FUNCTION, or a module such as package.module"
    below["check"].add_argument("file", metavar="FILE", help=text)
    return made


def listed(*, as_json: bool) -> None:
    """Print the navigators of the robot with a summary of each."""
    if as_json:
        rows = [{"name": one, "summary": NAVIGATOR_SUMMARIES[one]} for one in NAVIGATORS]
        print(json.dumps({"verb": "navigators", "navigators": rows}))
        return
    width = max(map(len, NAVIGATORS))
    for name in NAVIGATORS:
        print(f"{name:<{width}}  {NAVIGATOR_SUMMARIES[name]}")


def new(name: str) -> Path:
    """Write the file of a new navigator into the present folder; return its path."""
    name = name.removesuffix(SUFFIX)
    if not re.fullmatch(r"[a-zA-Z_]\w*", name) or OwnSource(name).name in NAVIGATORS:
        taken = f"is taken: the robot has {', '.join(NAVIGATORS)}"
        why = taken if name in NAVIGATORS else "is no name: use letters, digits and _"
        raise UserError(f"{name} {why}")
    file = Path(f"{name}{SUFFIX}")
    try:
        with file.open("x", encoding="utf-8") as opened:
            opened.write(TEMPLATE.read_text(encoding="utf-8").format(name=name))
    except FileExistsError:
        raise UserError(f"{file} is there already: choose another name") from None
    except OSError as error:
        raise UserError(f"{file}: cannot be written: {error.strerror}") from None
    return file
