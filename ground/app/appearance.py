"""Determine the appearance of the app from its options, else from the terminal's environment."""

import argparse
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

from ground.text.theme_names import THEMES

FEW_COLOURS: Final = ("linux", "vt100", "vt220", "ansi", "dumb")
LOCALES: Final = ("LC_ALL", "LC_CTYPE", "LANG")
DRIVER: Final = "TEXTUAL_DRIVER"
"""Set when the app is served to a browser: it has a screen without a terminal."""
RATES_HZ: Final = (2.0, 5.0, 10.0, 20.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Appearance:
    """Theme, character set, frame rate and bell; with `hz` 0 there is no timer (for tests)."""

    theme: str = "dark"
    ascii_only: bool = False
    hz: float = 10.0
    quiet_bell: bool = False


class AppOptions(Protocol):
    """The options of a verb that opens the app; `theme` None selects one that fits the terminal."""

    theme: str | None
    ascii: bool
    hz: float
    keys: Path | None
    quiet_bell: bool


def add_appearance_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of a verb that opens the app."""
    group = parser.add_argument_group("on a terminal")
    group.add_argument("--theme", choices=THEMES, help="(dark; mono with NO_COLOR)")
    group.add_argument("--ascii", action="store_true", help="for fonts without braille")
    group.add_argument(
        "--hz", type=float, choices=RATES_HZ, default=10.0, help="frames per second (10)"
    )
    group.add_argument(
        "--quiet-bell", action="store_true", help="no bell when a robot stops or arrives"
    )
    group.add_argument("--keys", type=Path, metavar="FILE", help="a TOML file that changes keys")


def appearance_of(options: AppOptions, environment: Mapping[str, str] = os.environ) -> Appearance:
    """Return the appearance that the options and the environment ask for."""
    return Appearance(
        theme=options.theme or default_theme(environment),
        ascii_only=options.ascii or is_ascii_terminal(environment),
        hz=options.hz,
        quiet_bell=options.quiet_bell,
    )


def default_theme(environment: Mapping[str, str]) -> str:
    """Return `mono` with NO_COLOR (no-color.org), `ansi` with sixteen colours, else `dark`."""
    if environment.get("NO_COLOR"):
        return "mono"
    if in_browser(environment):
        return "dark"
    return "ansi" if environment.get("TERM", "") in FEW_COLOURS else "dark"


def is_ascii_terminal(environment: Mapping[str, str]) -> bool:
    """Return whether the console has no braille, or the locale promises only ASCII."""
    if in_browser(environment):
        return False
    locale = next((environment[name] for name in LOCALES if environment.get(name)), "")
    return environment.get("TERM", "") == "linux" or locale in ("C", "POSIX")


def in_browser(environment: Mapping[str, str]) -> bool:
    """Return whether the app is shown in a browser instead of this terminal."""
    return bool(environment.get(DRIVER))
