"""Read the user's settings, in `~/.config/sidestep/config.toml`: appearance, keys, contexts.

One setting can be changed; comments and order of the file stay.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ground.text.wording import THEMES
from ground.user.folders import config_folder
from protocol.bus.network import check_endpoint
from protocol.topic import robot_name
from runtime.config import line_located, parse, read_toml
from runtime.errors import ConfigError, UserError
from runtime.files import make_folder, replace, text_in
from runtime.toml_reader import MAX_BYTES, MAX_DOTS, check_size

if TYPE_CHECKING:
    from tomlkit import TOMLDocument

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

    `startup` are lines for the app's command line, run at its start. `hook` is a shell command that
    the app runs when a robot stops or arrives, and with `desktop` it sends a notification to the
    desktop of its terminal. `context` is the name of the context in force. `keys` has the form of a
    key file.
    """

    theme: str | None = None
    hz: float = USUAL_HZ
    bell: bool = True
    hook: str | None = None
    desktop: bool = False
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
    try:
        config = str(config_folder() / Path(context.config).expanduser())
    except RuntimeError:
        raise UserError(
            f"context {chosen}: {context.config}: that user has no home; give the whole path"
        ) from None
    return chosen, Context(connect=context.connect, id=context.id, config=config)


PLAIN: Final = re.compile(r"[A-Za-z0-9_-]+\Z")


def set_setting(key: str, text: str) -> Settings:
    """Set a key, such as `theme` or `contexts.lab.connect`, and return the settings.

    `text` is a TOML value, or a string without quotes. Raises UserError or ConfigError, and leaves
    the file as it was, if the result would not be valid.
    """
    names = key.split(".")
    if len(names) > MAX_DOTS or not all(map(PLAIN.match, names)):
        raise UserError(f"{key!r} is not a key, such as theme or contexts.lab.connect")
    errors: list[ConfigError] = []
    for value in values_of(key, text):
        document = document_of(settings_file())
        table: Any = document
        for name in names[:-1]:
            table = table.setdefault(name, {})
            if not isinstance(table, dict):
                raise UserError(f"{settings_file()}: {key}: {name} is a value, not a table")
        table[names[-1]] = value
        try:
            return write(document)
        except ConfigError as error:
            errors.append(error)
    raise errors[0]


def unset_setting(key: str) -> None:
    """Remove a key of the top level, if it is set."""
    document = document_of(settings_file())
    if document.pop(key, None) is not None:
        write(document)


def values_of(key: str, text: str) -> Iterator[Any]:
    """Yield the TOML value, if it is one, and the string."""
    import tomlkit  # slow, and wanted only for changes

    try:
        check_size(text)
    except ValueError as error:
        raise UserError(f"the value of {key}: {error}") from error
    with suppress(ValueError):
        yield tomlkit.value(text)
    yield text


def document_of(path: Path) -> "TOMLDocument":
    """Return the file with its comments; UserError if no parser should have it."""
    import tomlkit

    try:
        text = text_in(path, MAX_BYTES) if path.exists() else ""
        check_size(text)
        return tomlkit.parse(text)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise UserError(f"{path}: {why}: correct the file, or remove it") from error


def write(document: "TOMLDocument") -> Settings:
    """Check the settings, write the file as a whole, and return them."""
    path = settings_file()
    settings = settings_in(document.unwrap(), path)
    try:
        make_folder(path.parent)
        replace(path, document.as_string())
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from error
    return settings
