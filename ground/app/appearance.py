"""How the app is to look: what is asked for, else what the terminal seems to be able to show."""

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
"""Set by what shows the app in a browser: then there is a screen without a terminal."""
RATES_HZ: Final = (2.0, 5.0, 10.0, 20.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Appearance:
    """`hz` 0: no timer; whoever tests calls `sample`."""

    theme: str = "dark"
    ascii_only: bool = False
    hz: float = 10.0


class AppOptions(Protocol):
    """What a verb that opens the app has read; `theme` None: the one that fits the terminal."""

    theme: str | None
    ascii: bool
    hz: float
    keys: Path | None


def add_appearance_options(parser: argparse.ArgumentParser) -> None:
    """Options of whatever opens the app."""
    group = parser.add_argument_group("on a terminal")
    group.add_argument("--theme", choices=THEMES, help="(dark; mono with NO_COLOR)")
    group.add_argument("--ascii", action="store_true", help="for fonts without braille")
    group.add_argument(
        "--hz", type=float, choices=RATES_HZ, default=10.0, help="drawn so often a second (10)"
    )
    group.add_argument("--keys", type=Path, metavar="FILE", help="a TOML file with other keys")


def appearance_of(options: AppOptions, environment: Mapping[str, str] = os.environ) -> Appearance:
    return Appearance(
        theme=options.theme or default_theme(environment),
        ascii_only=options.ascii or is_ascii_terminal(environment),
        hz=options.hz,
    )


def default_theme(environment: Mapping[str, str]) -> str:
    """What the terminal asks for: no colour at all (no-color.org), sixteen, or dark."""
    if environment.get("NO_COLOR"):
        return "mono"
    if in_browser(environment):
        return "dark"
    return "ansi" if environment.get("TERM", "") in FEW_COLOURS else "dark"


def is_ascii_terminal(environment: Mapping[str, str]) -> bool:
    """A console without braille, or a locale that promises nothing but ASCII."""
    if in_browser(environment):
        return False
    locale = next((environment[name] for name in LOCALES if environment.get(name)), "")
    return environment.get("TERM", "") == "linux" or locale in ("C", "POSIX")


def in_browser(environment: Mapping[str, str]) -> bool:
    """Whether the terminal whose variables these are is not the one that is looked at."""
    return bool(environment.get(DRIVER))
