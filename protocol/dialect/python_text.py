"""Python source for parts of the dialect: classes of messages and enumerations, tables, constants.

The text is formatted as ruff formats it, so that nothing has to be run over it.
"""

import textwrap
from collections.abc import Iterable, Iterator
from typing import Final

from protocol.dialect.definitions import Entry, EnumType, Field, MessageType

MADE: Final = "Made by `make generate` from sidestep.xml: change that file instead."
MAX_COLUMNS: Final = 100
INDENT: Final = "    "
TYPES: Final = {"s": "str", "f": "float", "d": "float"}
"""Python type of a struct code; integers where nothing is said."""


def class_name(name: str) -> str:
    """SONAR_SCAN is called SonarScan in Python."""
    return "".join(part.capitalize() for part in name.split("_"))


def module(docstring: str, *blocks: Iterable[str]) -> str:
    """A source file: docstring and blocks, each block with the blank lines it begins with."""
    lines = [*doc_lines(f"{docstring} {MADE}", ""), *(line for block in blocks for line in block)]
    return "\n".join(lines) + "\n"


def doc_lines(text: str, indent: str, more: Iterable[str] = ()) -> list[str]:
    """A docstring: the first sentence, the other ones wrapped, then finished lines.

    Raises ValueError when the first sentence does not fit one line.
    """
    summary, stop, rest = text.partition(". ")
    first = f'{indent}"""{summary}{stop.rstrip()}'
    blocks = [wrapped(rest, indent, indent)] if rest else []
    blocks += [list(more)] if more else []
    if len(first) > MAX_COLUMNS - (0 if blocks else 3):
        raise ValueError(f"a summary that does not fit one line: {summary}")
    if not blocks:
        return [f'{first}"""']
    return [first, *(line for block in blocks for line in ("", *block)), f'{indent}"""']


def wrapped(text: str, first: str, rest: str) -> list[str]:
    return textwrap.wrap(
        text,
        MAX_COLUMNS,
        initial_indent=first,
        subsequent_indent=rest,
        break_long_words=False,
        break_on_hyphens=False,
    )


def message_lines(message: MessageType, enum_classes: dict[str, str]) -> list[str]:
    """The class of a message; fields with a description are listed in its docstring."""
    described = [field for field in message.fields if field.text]
    attributes = [line for field in described for line in attribute_lines(field, enum_classes)]
    more = [f"{INDENT}Attributes:", *attributes] if attributes else []
    return [
        "",
        "",
        f"class {class_name(message.name)}(Message, frozen=True, kw_only=True):",
        *doc_lines(message.text, INDENT, more),
        "",
        *(INDENT + declaration(field) for field in message.fields),
        *check_lines(message),
    ]


def attribute_lines(field: Field, enum_classes: dict[str, str]) -> list[str]:
    indent = INDENT * 2
    kind = unit(field, enum_classes)
    text = f"{field.name}: {field.text}" + (f" [{kind}]" if kind else "")
    return wrapped(text, indent, indent + INDENT)


def unit(field: Field, enum_classes: dict[str, str]) -> str:
    """What the value of a field is counted in, and its limit: a unit, an enumeration, bytes."""
    if field.code == "s":
        return f"at most {field.length} bytes"
    number = f"{field.length} values" if field.length else ""
    most = f"at most {field.most}" if field.most else ""
    kind = enum_classes.get(field.enum, "") or field.units
    return ", ".join(word for word in (number, kind, most) if word)


def declaration(field: Field) -> str:
    kind = TYPES.get(field.code, "int")
    if field.length and field.code != "s":
        kind = f"tuple[{kind}, ...]"
    if field.default is None:
        return f"{field.name}: {kind}"
    return f"{field.name}: {kind} = {float(field.default) if kind == 'float' else field.default}"


def check_lines(message: MessageType) -> list[str]:
    """The check of lengths on construction, for messages with arrays or texts."""
    checks = [
        f"too_long(self.{field.name}, {field.length})"
        if field.code == "s"
        else f"len(self.{field.name}) != {field.length}"
        for field in message.fields
        if field.length
    ]
    if not checks:
        return []
    return [
        "",
        f"{INDENT}def __post_init__(self) -> None:",
        f"{INDENT * 2}if {' or '.join(checks)}:",
        f"{INDENT * 3}raise unfit(self)",
    ]


def import_lines(source: str, names: Iterable[str]) -> Iterator[str]:
    """An import of names, one a line where they do not fit one line."""
    ordered = sorted(names)
    line = f"from {source} import {', '.join(ordered)}"
    if len(line) <= MAX_COLUMNS:
        yield line
    else:
        yield f"from {source} import ("
        yield from (f"{INDENT}{name}," for name in ordered)
        yield ")"


def enum_lines(name: str, enum: EnumType, text: str) -> Iterator[str]:
    """An IntEnum with the descriptions of its members behind or above them."""
    yield from ("", "", f"class {name}(IntEnum):", *doc_lines(text, INDENT), "")
    for entry in enum.entries:
        yield from commented(f"{INDENT}{entry.name} = {entry.value}", entry.text, INDENT)


def commented(code: str, comment: str, indent: str) -> list[str]:
    """A line of code with its comment behind it, or above it where it would be too long."""
    if not comment:
        return [code]
    if len(line := f"{code}  # {comment}") <= MAX_COLUMNS:
        return [line]
    return [*wrapped(comment, f"{indent}# ", f"{indent}# "), code]


def constant_lines(entries: Iterable[Entry], prefix: str = "") -> Iterator[str]:
    """Module integers, for the core: MicroPython has no enum."""
    for entry in entries:
        yield from commented(f"{prefix}{entry.name}: Final = {entry.value}", entry.text, "")


def table_lines(head: str, rows: Iterable[str], close: str) -> list[str]:
    """A literal with one row per line."""
    return [head, *(f"{INDENT}{row}," for row in rows), close]


def layout_lines(message: MessageType) -> list[str]:
    """The message's line of the table from which the codec builds its packing."""
    words = [message.name, str(message.number), str(message.crc_extra)]
    words += [f"{f.name}:{f.length or ''}{f.code}" for f in message.wire_fields]
    return textwrap.wrap(" ".join(words), MAX_COLUMNS - 4, subsequent_indent="  ")
