"""Determine the appearance of the app, and define its five themes for Textual.

Options come first, then the user's settings, then the terminal. Colours by role are in
`ground.app.widgets.role_colours`.
"""

import argparse
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

from textual.theme import Theme

from ground.text.wording import THEMES
from ground.user.settings import RATES_HZ, USUAL_HZ, Settings

FEW_COLOURS: Final = ("linux", "vt100", "vt220", "ansi", "dumb", "xterm", "screen", "tmux", "rxvt")
"""Terminals with sixteen colours, unless COLORTERM announces more."""
MANY_COLOURS: Final = ("truecolor", "24bit")
DUMB: Final = "dumb"
ASCII_LOCALES: Final = ("C", "POSIX")
UNICODE: Final = ("utf8", "utf-8")
LOCALES: Final = ("LC_ALL", "LC_CTYPE", "LANG")
DRIVER: Final = "TEXTUAL_DRIVER"
"""Set when the app is served to a browser: it has a screen without a terminal."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Appearance:
    """Theme, character set, frame rate and calls; with `hz` 0 there is no timer (for tests).

    The calls are bell, `hook` and `desktop`, as in the settings. `startup` are lines for the
    command line, which the app runs when it opens.
    """

    theme: str = "dark"
    ascii_only: bool = False
    hz: float = 10.0
    quiet_bell: bool = False
    hook: str | None = None
    desktop: bool = False
    startup: tuple[str, ...] = ()


class AppOptions(Protocol):
    """The options of a verb that opens the app; None means the user's setting or the default."""

    theme: str | None
    ascii: bool
    hz: float | None
    keys: Path | None
    quiet_bell: bool


def add_appearance_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of a verb that opens the app."""
    group = parser.add_argument_group("on a terminal")
    help = "colours (default dark; mono with NO_COLOR, ansi with sixteen colours)"
    group.add_argument("--theme", choices=THEMES, help=help)
    group.add_argument("--ascii", action="store_true", help="for fonts without braille")
    help = f"frames per second (default {USUAL_HZ:g})"
    group.add_argument("--hz", type=float, choices=RATES_HZ, help=help)
    group.add_argument(
        "--quiet-bell", action="store_true", help="no bell when a robot stops or arrives"
    )
    group.add_argument("--keys", type=Path, metavar="FILE", help="a TOML file that changes keys")


def appearance_of(
    options: AppOptions, settings: Settings, environment: Mapping[str, str] = os.environ
) -> Appearance:
    """Return the appearance that the options, the settings and the environment ask for."""
    fits = default_theme(environment)
    return Appearance(
        theme=options.theme or (settings.theme if has_colours(environment) else None) or fits,
        ascii_only=options.ascii or is_ascii_terminal(environment),
        hz=options.hz or settings.hz,
        quiet_bell=options.quiet_bell or not settings.bell,
        hook=settings.hook,
        desktop=settings.desktop,
        startup=settings.startup,
    )


def default_theme(environment: Mapping[str, str]) -> str:
    """Return `mono` with NO_COLOR (no-color.org), `ansi` with sixteen colours, else `dark`."""
    if environment.get("NO_COLOR"):
        return "mono"
    return "dark" if has_colours(environment) else "ansi"


def has_colours(environment: Mapping[str, str]) -> bool:
    """Return whether the terminal shows the colours of any theme."""
    if environment.get("NO_COLOR"):
        return False
    if in_browser(environment) or environment.get("COLORTERM", "").lower() in MANY_COLOURS:
        return True
    return environment.get("TERM", "") not in FEW_COLOURS


def is_ascii_terminal(environment: Mapping[str, str]) -> bool:
    """Return whether the console has no braille, or the locale promises only ASCII."""
    if in_browser(environment):
        return False
    locale = next((environment[name] for name in LOCALES if environment.get(name)), "")
    _, has_encoding, encoding = locale.partition("@")[0].partition(".")
    is_other = bool(has_encoding) and encoding.lower() not in UNICODE
    return environment.get("TERM", "") == "linux" or locale in ASCII_LOCALES or is_other


def in_browser(environment: Mapping[str, str]) -> bool:
    """Return whether the app is shown in a browser instead of this terminal."""
    return bool(environment.get(DRIVER))


RULE: Final = "rule-color"


def _native(name: str, accent: str, warning: str, error: str, success: str) -> Theme:
    """Return a theme that leaves the colours to the terminal."""
    plain = "ansi_default"
    return Theme(
        name=name,
        primary=accent,
        warning=warning,
        error=error,
        success=success,
        foreground=plain,
        background=plain,
        surface=plain,
        panel=plain,
        boost=plain,
        ansi=True,
        variables={
            RULE: plain,
            "ansi-background": "ansi_black",
            "ansi-foreground": "ansi_white",
            "input-cursor-text-style": "reverse",
            "input-cursor-background": plain,
            "input-cursor-foreground": plain,
            "block-cursor-background": plain,
            "block-cursor-foreground": plain,
            "block-cursor-text-style": "reverse",
        },
    )


TEXTUAL_THEMES: Final = (
    Theme(
        name="dark",
        primary="#6cb6ff",
        secondary="#56cfd2",
        warning="#ecc46a",
        error="#ff6f6f",
        success="#7fd88f",
        accent="#6cb6ff",
        foreground="#d5dce4",
        background="#10151c",
        surface="#161d26",
        panel="#1b232e",
        variables={RULE: "#313c49"},
    ),
    Theme(
        name="light",
        primary="#0b5cad",
        secondary="#007a80",
        warning="#8a5a00",
        error="#b3121d",
        success="#176f2c",
        accent="#0b5cad",
        foreground="#1d2630",
        background="#fafbfc",
        surface="#f0f2f5",
        panel="#e6eaee",
        dark=False,
        variables={RULE: "#c5ccd4"},
    ),
    Theme(
        name="contrast",
        primary="#ffff00",
        secondary="#00ffff",
        warning="#ffff00",
        error="#ff4040",
        success="#00ff66",
        accent="#ffff00",
        foreground="#ffffff",
        background="#000000",
        surface="#000000",
        panel="#000000",
        variables={RULE: "#ffffff"},
    ),
    _native("ansi", "ansi_blue", "ansi_yellow", "ansi_red", "ansi_green"),
    _native("mono", *("ansi_default",) * 4),
)
