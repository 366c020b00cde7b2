"""Read the user's settings, in `~/.config/sidestep/config.toml`: appearance, keys, contexts.

One setting can be changed; comments and order of the file stay.
"""

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from ground.text.theme_names import THEMES
from ground.user.folders import config_folder
from protocol.bus.network import check_endpoint
from protocol.topic import robot_name
from runtime.config import line_located, parse, read_toml
from runtime.errors import ConfigError, UserError
from runtime.files import make_folder, replace, text_in
from runtime.toml_reader import MAX_BYTES, MAX_DOTS, check_size, key_lines, table_in

RATES_HZ: Final = (2.0, 5.0, 10.0, 20.0)
USUAL_HZ: Final = 10.0


@dataclass(frozen=True, kw_only=True)
class Context:
    """A system by name: where to connect, the robot, and the file with the certificates."""

    connect: str | None = None
    id: str | None = None
    config: str | None = None


@dataclass(frozen=True, kw_only=True)
class Settings:
    """The settings of the user.

    `startup` are lines for the app's command line, run at its start. `context` is the name of the
    context in force. `keys` has the form of a key file.
    """

    theme: str | None = None
    hz: float = USUAL_HZ
    bell: bool = True
    startup: tuple[str, ...] = ()
    context: str | None = None
    keys: dict[str, Any] = field(default_factory=dict)
    contexts: dict[str, Context] = field(default_factory=dict)


def settings_file() -> Path:
    """Return the path of the user's settings, which need not exist."""
    return config_folder() / "config.toml"


def load_settings() -> Settings:
    """Return the settings; those that are not set have their defaults.

    Raises ConfigError, with the line, for a file that cannot be used.
    """
    path = settings_file()
    if not path.exists():
        return Settings()
    with line_located(path):
        return settings_in(read_toml(path), path)


def settings_in(table: Mapping[str, Any], path: Path) -> Settings:
    """Return the settings of a table, which is or becomes that of `path`."""
    found = parse(table, Settings, file=str(path))
    check(found, str(path))
    return found


def check(found: Settings, file: str) -> None:
    """Raise ConfigError for the first value that is out of range."""

    def refuse(key: str, reason: str, fix: str) -> None:
        raise ConfigError(file=file, key=key, reason=reason, fix=fix)

    if found.theme is not None and found.theme not in THEMES:
        refuse("theme", f"no such theme: {found.theme!r}", f"choose one of {', '.join(THEMES)}")
    if found.hz not in RATES_HZ:
        rates = ", ".join(f"{rate:g}" for rate in RATES_HZ)
        refuse("hz", f"{found.hz:g} frames per second are not offered", f"choose one of {rates}")
    if found.context is not None and found.context not in found.contexts:
        known = ", ".join(found.contexts) or "none"
        refuse("context", f"no such context: {found.context!r}", f"known contexts: {known}")
    for name, context in found.contexts.items():
        key = f"contexts.{name}"
        if context.connect is None and context.config is None:
            refuse(key, "has neither connect nor config", 'add connect = "tcp/HOST:7447"')
        if context.connect is not None:
            refuse_invalid(check_endpoint, context.connect, f"{key}.connect", file)
        if context.id is not None:
            refuse_invalid(robot_name, context.id, f"{key}.id", file)


def refuse_invalid(check_value: Callable[[str], object], text: str, key: str, file: str) -> None:
    """Raise ConfigError with the reason of the UserError that the check of a value raises."""
    try:
        check_value(text)
    except UserError as error:
        raise ConfigError(file=file, key=key, reason=str(error), fix="") from error


def context_named(name: str | None) -> tuple[str, Context] | None:
    """Return a context: that of this name, else the one in force; None without one.

    A relative path of its `config` is below the folder of the settings. Raises UserError for an
    unknown name.
    """
    settings = load_settings()
    chosen = settings.context if name is None else name
    if chosen is None:
        return None
    if chosen not in settings.contexts:
        known = ", ".join(settings.contexts) or "none"
        raise UserError(f"--context {chosen}: no such context in {settings_file()}; known: {known}")
    context = settings.contexts[chosen]
    if context.config is None:
        return chosen, context
    config = str(config_folder() / Path(context.config).expanduser())
    return chosen, Context(connect=context.connect, id=context.id, config=config)


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
