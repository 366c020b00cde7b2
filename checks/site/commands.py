"""`make generate`: write the rows of the commands of `ground/commands/` into the table of verbs.

`--help`, completion and the app's palette read the rows, and import no command.
"""

import json
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any, Final

import ground.commands
from ground.commands.command import Facts, Group, OperatorCommand
from runtime.cli.verb import GROUPS, SECTIONS

INDEX: Final = Path(__file__).resolve().parents[2] / "runtime/cli/command_index.py"
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
    rows = {}
    for module in iter_modules(ground.commands.__path__):
        name = f"{ground.commands.__name__}.{module.name}"
        for attribute, value in vars(import_module(name)).items():
            if isinstance(value, Group):
                below = value.commands
                rows[order(value)] = row(value.word, value, value.summary, name, attribute, below)
            elif is_verb(value, name):
                facts = value.facts
                rows[order(facts)] = row(facts.word, facts, value.summary(), name, attribute, {})
    text = "".join(rows[one] for one in sorted(rows))
    names = "Subcommand, Verb" if "Subcommand(" in text else "Verb"
    return f"{HEAD.format(names)}{text}    }}\n)\n"


def is_verb(value: Any, module: str) -> bool:
    """Return whether it is a command that is defined in the module, and is a verb by itself."""
    is_here = isinstance(value, type) and value.__module__ == module
    return is_here and issubclass(value, OperatorCommand) and bool(value.facts.section)


def order(facts: Facts | Group) -> tuple[int, int]:
    """Return the place of a verb in the table."""
    return SECTIONS.index(facts.section), facts.rank


def row(
    word: str,
    facts: Facts | Group,
    summary: str,
    module: str,
    attribute: str,
    below: Mapping[str, type[OperatorCommand]],
) -> str:
    """Return the text of one row."""
    last = facts.example.split()[1] if facts.section in GROUPS else word
    values: dict[str, object] = {
        "section": facts.section,
        "summary": summary,
        "example": facts.example,
        "module": module,
        "words": attribute,
        "rank": facts.rank,
    }
    values |= {"name": last} if last != word else {}
    values |= {"suffixes": facts.suffixes} if facts.suffixes else {}
    lines = [f"{name}={literal(value)}," for name, value in values.items()]
    if below:
        lines += ["subcommands=MappingProxyType(", "    {"]
        for name, kind in below.items():
            lines.append(f"        {literal(name)}: Subcommand(")
            lines += [f"            {literal(kind.summary())},"]
            lines += [f"            {literal(kind.facts.example)},", "        ),"]
        lines += ["    }", "),"]
    head, indent = f"        {literal(word)}: Verb(\n", " " * 12
    return "".join((head, *(f"{indent}{line}\n" for line in lines), "        ),\n"))


def literal(value: object) -> str:
    """Return a literal in the spelling of the formatter."""
    if isinstance(value, tuple):
        return f"({', '.join(map(literal, value))}{',' * (len(value) == 1)})"
    return json.dumps(value, ensure_ascii=False)


if __name__ == "__main__":
    INDEX.write_text(index(), encoding="utf-8")
