"""Change one setting in the user's file, and keep its comments and order."""

import json
import re
from pathlib import Path
from typing import Any, Final

from ground.user.settings import Settings, settings_file, settings_in
from runtime.errors import ConfigError, UserError
from runtime.files import make_folder, replace, text_in
from runtime.toml_reader import MAX_BYTES, MAX_DOTS, check_size, key_lines, table_in

PLAIN: Final = re.compile(r"[A-Za-z0-9_-]+\Z")
HEADER: Final = re.compile(r"\s*\[")


def set_setting(key: str, text: str) -> Settings:
    """Set a key, such as `theme` or `contexts.lab.connect`, and return the settings.

    `text` is a TOML value, or a string without quotes. Raises UserError or ConfigError, and leaves
    the file as it was, if the result would not be valid.
    """
    path = settings_file()
    before = text_of(path) if path.exists() else ""
    try:
        check_size(text)
    except ValueError as error:
        raise UserError(f"the value of {key}: {error}") from error
    names = key.split(".")
    if len(names) > MAX_DOTS or not all(map(PLAIN.match, names)):
        raise UserError(f"{key!r} is not a key, such as theme or contexts.lab.connect")
    values = [text] if is_toml(text) else []
    values.append(json.dumps(text, ensure_ascii=False))
    errors: list[ConfigError] = []
    for value in values:
        after = with_value(before, names, value)
        try:
            settings = checked(after, names, value, path)
        except ConfigError as error:
            errors.append(error)
        else:
            write(path, after)
            return settings
    raise errors[0]


def unset_setting(key: str) -> None:
    """Remove a key of the top level, if it is set."""
    path = settings_file()
    if not path.exists():
        return
    text = text_of(path)
    line = key_lines(text).get((key,))
    if line is not None:
        lines = text.splitlines(keepends=True)
        del lines[line - 1]
        settings_in(table_in("".join(lines)), path)
        write(path, "".join(lines))


def text_of(path: Path) -> str:
    """Return the text of the file; UserError if no parser should have it."""
    try:
        text = text_in(path, MAX_BYTES)
        check_size(text)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise UserError(f"{path}: {why}: correct the file, or remove it") from error
    return text


def is_toml(text: str) -> bool:
    """Return whether a text is a value of TOML in one line."""
    try:
        table_in(f"x = {text}")
    except ValueError:
        return False
    return "\n" not in text


def with_value(text: str, names: list[str], value: str) -> str:
    """Return the file with one key set: in its line, or in a new one in its table."""
    known = key_lines(text)
    assignment = f"{names[-1]} = {value}"
    lines = text.splitlines()
    table = tuple(names[:-1])
    if (line := known.get(tuple(names))) is not None:
        lines[line - 1] = assignment
    elif not table:
        first = next((at for at, one in enumerate(lines) if HEADER.match(one)), len(lines))
        while first and not lines[first - 1].strip():
            first -= 1
        lines.insert(first, assignment)
    elif (line := known.get(table)) is not None and HEADER.match(lines[line - 1]):
        lines.insert(line, assignment)
    else:
        lines += ["", f"[{'.'.join(table)}]", assignment]
    return "\n".join(lines).lstrip("\n") + "\n"


def checked(text: str, names: list[str], value: str, path: Path) -> Settings:
    """Return the settings of a text in which a key should have this value."""
    wanted = table_in(f"x = {value}")["x"]
    try:
        table = table_in(text)
    except ValueError:
        table = {}
    found: Any = table
    for name in names:
        found = found.get(name) if isinstance(found, dict) else None
    if found != wanted:
        raise UserError(f"{path}: {'.'.join(names)} cannot be changed here: edit the file")
    return settings_in(table, path)


def write(path: Path, text: str) -> None:
    """Write the file as a whole."""
    try:
        make_folder(path.parent)
        replace(path, text)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from error
