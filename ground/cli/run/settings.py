"""`config`: show and change the user's settings, and choose the context in force."""

import argparse
import json
from dataclasses import asdict, fields
from typing import Any

from ground.commands.command import add_json
from ground.text.output import Output
from ground.user.settings import Settings, load_settings, set_setting, settings_file, unset_setting
from runtime.cli.parsers import add_subcommands
from runtime.cli.verb_table import nearest
from runtime.errors import UserError

KEYS = tuple(one.name for one in fields(Settings))


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions of `config`, with their arguments."""
    actions = add_subcommands(parser, "config")
    text = "a key, such as theme (default all of them)"
    actions["get"].add_argument("key", nargs="?", metavar="KEY", help=text)
    text = f"{', '.join(KEYS)}; below a table as in contexts.lab.connect"
    actions["set"].add_argument("key", metavar="KEY", help=text)
    text = "a TOML value, or a string without quotes"
    actions["set"].add_argument("value", metavar="VALUE", help=text)
    text = "the context to use from now on (default: list them)"
    actions["context"].add_argument("name", nargs="?", metavar="NAME", help=text)
    actions["context"].add_argument("--none", action="store_true", help="use no context")
    for action in actions.values():
        add_json(action)


def run(options: argparse.Namespace, output: Output) -> int:
    """Run the action; return 0. Raises UserError or ConfigError for a value that is wrong."""
    runs = {"path": run_path, "get": run_get, "set": run_set, "context": run_context}
    runs[options.action](options, output)
    return 0


def run_path(options: argparse.Namespace, output: Output) -> None:
    """Print the path of the file."""
    path = settings_file()
    output.result({"ok": True, "file": str(path), "exists": path.exists()}, str(path))


def run_get(options: argparse.Namespace, output: Output) -> None:
    """Print one setting, or all of them."""
    settings: dict[str, Any] = asdict(load_settings())
    if options.key is None:
        output.result({"ok": True, "settings": settings}, "\n".join(lines_of(settings)))
        return
    found: Any = settings
    for name in options.key.split("."):
        if not isinstance(found, dict) or name not in found:
            known = list(found) if isinstance(found, dict) else KEYS
            raise UserError(f"{options.key}: there is no such setting{nearest(name, known)}")
        found = found[name]
    row: dict[str, object] = {"ok": True, "key": options.key, "value": found}
    output.result(row, found if isinstance(found, str) else json.dumps(found))


def lines_of(settings: dict[str, Any]) -> list[str]:
    """Return `key = value` for each setting; `--` for one that has no value."""
    found = []
    for key, value in settings.items():
        below = value if isinstance(value, dict) and value else None
        if below is None:
            found.append(f"{key} = {'--' if value in (None, {}) else json.dumps(value)}")
        else:
            found += [f"{key}.{line}" for line in lines_of(below)]
    return found


def run_set(options: argparse.Namespace, output: Output) -> None:
    """Change one setting in the file."""
    if options.key.partition(".")[0] == "keys":
        check_key(options.key, options.value)
    set_setting(options.key, options.value)
    row: dict[str, object] = {"ok": True, "key": options.key, "file": str(settings_file())}
    output.result(row, f"{settings_file()}: {options.key} = {options.value}")


def check_key(key: str, value: str) -> None:
    """Raise ConfigError unless a key of the app can be set to this."""
    from ground.app.input.keymap import TABLE, keymap_of  # imports the app; rarely needed

    chosen = {**load_settings().keys, key.partition(".")[2]: value}
    keymap_of({TABLE: chosen}, file=str(settings_file()))


def run_context(options: argparse.Namespace, output: Output) -> None:
    """List the contexts, or choose the one in force."""
    if options.none:
        unset_setting("context")
    elif options.name is not None:
        set_setting("context", json.dumps(options.name))
    settings = load_settings()
    rows = {name: asdict(context) for name, context in settings.contexts.items()}
    text = "\n".join(
        f"{'*' if name == settings.context else ' '} {name}  {context.connect or context.config}"
        for name, context in settings.contexts.items()
    )
    how = "no context: sidestep config set contexts.lab.connect tcp/HOST:7447"
    row: dict[str, object] = {"ok": True, "context": settings.context, "contexts": rows}
    output.result(row, text or how)
