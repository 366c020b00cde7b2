"""`make generate`: write the rows of the commands of `ground/commands/` into the table of verbs.

`--help`, completion and the app's palette read the rows, and import no command.
"""

import json
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Final

import ground.commands
from ground.commands.command import rows_in
from runtime.cli.verb import SECTIONS, Verb

INDEX: Final = Path(__file__).resolve().parents[2] / "runtime/cli/command_index.py"
FIRST: Final = ("section", "summary", "example", "module", "words", "rank")
HEAD: Final = '''\
"""The rows of the commands of `ground/commands/`: made by `make generate`, not by hand."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from runtime.cli.verb import {}

COMMANDS: Final[Mapping[str, Verb]] = MappingProxyType(
    {{
'''


def index() -> str:
    """Return the text of the module with the rows, in the order of `sidestep --help`."""
    rows: dict[str, Verb] = {}
    for module in iter_modules(ground.commands.__path__):
        rows |= rows_in(vars(import_module(f"{ground.commands.__name__}.{module.name}")))
    order = sorted(rows, key=lambda word: (SECTIONS.index(rows[word].section), rows[word].rank))
    text = "".join(row_text(word, rows[word]) for word in order)
    names = "Subcommand, Verb" if "Subcommand(" in text else "Verb"
    return f"{HEAD.format(names)}{text}    }}\n)\n"


def row_text(word: str, row: Verb) -> str:
    """Return the text of one row, without what is as usual."""
    values = {name: getattr(row, name) for name in FIRST}
    for name, usual in Verb._field_defaults.items():
        if name not in ("words", "rank") and getattr(row, name) != usual:
            values[name] = getattr(row, name)
    below = values.pop("subcommands", {})
    lines = [f"{name}={literal(value)}," for name, value in values.items()]
    if below:
        lines += ["subcommands=MappingProxyType(", "    {"]
        for name, one in below.items():
            also = [f"            also={literal(one.also)},"] if one.also else []
            lines.append(f"        {literal(name)}: Subcommand(")
            lines += [f"            {literal(one.summary)},"]
            lines += [f"            {literal(one.example)},", *also, "        ),"]
        lines += ["    }", "),"]
    head, indent = f"        {literal(word)}: Verb(\n", " " * 12
    return "".join((head, *(f"{indent}{line}\n" for line in lines), "        ),\n"))


def literal(value: object) -> str:
    """Return a literal in the spelling of the formatter."""
    if isinstance(value, bool):
        return str(value)
    if isinstance(value, Mapping):
        rows = ", ".join(f"{literal(key)}: {literal(held)}" for key, held in value.items())
        return f"MappingProxyType({{{rows}}})"
    if isinstance(value, tuple):
        return f"({', '.join(map(literal, value))}{',' * (len(value) == 1)})"
    return json.dumps(value, ensure_ascii=False)


if __name__ == "__main__":
    INDEX.write_text(index(), encoding="utf-8")
