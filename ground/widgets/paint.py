"""The colours of every role in every theme. Meaning is never carried by colour alone."""

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Final

from rich.style import Style

ROLES: Final = tuple(
    "text faint head key rule ok caution danger alarm accent reverse"  # noqa: SIM905 - a list of words
    " wall truth seen trail robot ellipse goal virtual zone cone echo hit leave fence mission"
    " ghost other cursor".split()
)

DARK: Final[Mapping[str, str]] = MappingProxyType(
    {
        "text": "#d5dce4",
        "faint": "#66717e",
        "head": "#8797a8",
        "key": "bold #6cb6ff",
        "rule": "#313c49",
        "ok": "#7fd88f",
        "caution": "#ecc46a",
        "danger": "bold #ff6f6f",
        "alarm": "bold #ffffff on #a3232b",
        "accent": "bold #6cb6ff",
        "reverse": "bold #10151c on #6cb6ff",
        "wall": "#8e99a6",
        "truth": "#5d6875",
        "seen": "#c9ced6",
        "trail": "#56cfd2",
        "robot": "bold #ffffff",
        "ellipse": "#d68ad6",
        "goal": "bold #7fd88f",
        "virtual": "#6cb6ff",
        "zone": "#a08d52",
        "cone": "#3f4f61",
        "echo": "#ecc46a",
        "hit": "bold #ff9b6b",
        "leave": "bold #a6e3a1",
        "fence": "#ff6f6f",
        "mission": "#b7a3f5",
        "ghost": "#7b8896",
        "other": "bold #ecc46a",
        "cursor": "bold #fff3b0",
    }
)

LIGHT: Final[Mapping[str, str]] = MappingProxyType(
    {
        "text": "#1d2630",
        "faint": "#8b95a1",
        "head": "#53606e",
        "key": "bold #0b5cad",
        "rule": "#c5ccd4",
        "ok": "#176f2c",
        "caution": "#8a5a00",
        "danger": "bold #b3121d",
        "alarm": "bold #ffffff on #b3121d",
        "accent": "bold #0b5cad",
        "reverse": "bold #ffffff on #0b5cad",
        "wall": "#5c6670",
        "truth": "#98a2ad",
        "seen": "#2c3640",
        "trail": "#007a80",
        "robot": "bold #000000",
        "ellipse": "#97309b",
        "goal": "bold #176f2c",
        "virtual": "#0b5cad",
        "zone": "#a08226",
        "cone": "#b9c3ce",
        "echo": "#a05a00",
        "hit": "bold #b8430b",
        "leave": "bold #176f2c",
        "fence": "#b3121d",
        "mission": "#5b3fb5",
        "ghost": "#8b95a1",
        "other": "bold #8a5a00",
        "cursor": "bold #7a4b00",
    }
)

CONTRAST: Final[Mapping[str, str]] = MappingProxyType(
    dict.fromkeys(ROLES, "#ffffff")
    | {
        "faint": "#b8b8b8",
        "key": "bold #ffff00",
        "rule": "#ffffff",
        "ok": "bold #00ff66",
        "caution": "bold #ffff00",
        "danger": "bold #ff5050",
        "alarm": "bold #ffffff on #d00000",
        "accent": "bold #00ffff",
        "reverse": "bold #000000 on #ffff00",
        "truth": "#b8b8b8",
        "trail": "#00ffff",
        "robot": "bold #ffffff",
        "ellipse": "#ff80ff",
        "goal": "bold #00ff66",
        "virtual": "bold #66b3ff",
        "zone": "#ffff00",
        "cone": "#909090",
        "echo": "bold #ffff00",
        "hit": "bold #ff8800",
        "leave": "bold #00ff66",
        "fence": "bold #ff4040",
        "mission": "bold #cc99ff",
        "ghost": "#b8b8b8",
        "cursor": "bold #000000 on #ffff00",
    }
)

ANSI: Final[Mapping[str, str]] = MappingProxyType(
    dict.fromkeys(ROLES, "default")
    | {
        "faint": "bright_black",
        "head": "cyan",
        "key": "bold blue",
        "rule": "bright_black",
        "ok": "green",
        "caution": "yellow",
        "danger": "bold red",
        "alarm": "bold reverse red",
        "accent": "bold blue",
        "reverse": "reverse",
        "truth": "bright_black",
        "trail": "cyan",
        "robot": "bold",
        "ellipse": "magenta",
        "goal": "bold green",
        "virtual": "bold blue",
        "zone": "yellow",
        "cone": "bright_black",
        "echo": "bold yellow",
        "hit": "bold red",
        "leave": "bold green",
        "fence": "red",
        "mission": "magenta",
        "ghost": "bright_black",
        "cursor": "bold reverse",
    }
)

MONO: Final[Mapping[str, str]] = MappingProxyType(
    dict.fromkeys(ROLES, "none")
    | {
        "faint": "dim",
        "head": "dim",
        "key": "bold",
        "rule": "dim",
        "caution": "bold",
        "danger": "bold",
        "alarm": "bold reverse",
        "accent": "bold",
        "reverse": "reverse",
        "truth": "dim",
        "robot": "bold",
        "goal": "bold",
        "virtual": "bold",
        "cone": "dim",
        "zone": "dim",
        "echo": "bold",
        "ghost": "dim",
        "cursor": "reverse",
    }
)

PAINTS: Final[Mapping[str, Mapping[str, str]]] = MappingProxyType(
    {"dark": DARK, "light": LIGHT, "contrast": CONTRAST, "ansi": ANSI, "mono": MONO}
)


@cache
def styles_of(theme: str) -> Mapping[str, Style]:
    """A style for each role; a theme of somebody else's is painted as the dark one."""
    words = PAINTS.get(theme, DARK)
    return MappingProxyType({role: Style.parse(words[role]) for role in ROLES})
