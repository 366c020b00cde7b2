"""Define the colours of every role in every theme.

No meaning is carried by colour alone.
"""

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Final

from rich.style import Style

from ground.text.wording import THEMES

PAINTS: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        # dark, light, contrast, ansi, mono
        "text":     ("#d5dce4",       "#1d2630",        "#ffffff",        "default",       "none"),
        "faint":    ("#66717e",       "#8b95a1",        "#b8b8b8",        "bright_black",  "dim"),
        "head":     ("#8797a8",       "#53606e",        "#ffffff",        "cyan",          "dim"),
        "key":      ("bold #6cb6ff",  "bold #0b5cad",   "bold #ffff00",   "bold blue",     "bold"),
        "rule":     ("#313c49",       "#c5ccd4",        "#ffffff",        "bright_black",  "dim"),
        "ok":       ("#7fd88f",       "#176f2c",        "bold #00ff66",   "green",         "none"),
        "caution":  ("#ecc46a",       "#8a5a00",        "bold #ffff00",   "yellow",        "bold"),
        "danger":   ("bold #ff6f6f",  "bold #b3121d",   "bold #ff5050",   "bold red",      "bold"),
        "alarm":    (
            "bold #ffffff on #a3232b", "bold #ffffff on #b3121d", "bold #ffffff on #d00000",
            "bold reverse red", "bold reverse",
        ),
        "failsafe": (
            "bold #10151c on #ecc46a", "bold #1d2630 on #f0b429", "bold #000000 on #ffff00",
            "bold reverse yellow", "bold reverse",
        ),
        "accent":   ("bold #6cb6ff",  "bold #0b5cad",   "bold #00ffff",   "bold blue",     "bold"),
        "reverse":  (
            "bold #10151c on #6cb6ff", "bold #ffffff on #0b5cad", "bold #000000 on #ffff00",
            "reverse", "reverse",
        ),
        "dead":     (
            "bold #10151c on #d68ad6", "bold #ffffff on #97309b", "bold #000000 on #ff80ff",
            "bold reverse magenta", "bold reverse",
        ),
        "wall":     ("#8e99a6",       "#5c6670",        "#ffffff",        "default",       "none"),
        "truth":    ("#5d6875",       "#98a2ad",        "#b8b8b8",        "bright_black",  "dim"),
        "seen":     ("#c9ced6",       "#2c3640",        "#ffffff",        "default",       "none"),
        "seen late": ("#98a2ad",      "#5f6a75",        "#b8b8b8",        "default",       "none"),
        "seen old": ("#6f7a86",       "#8a949e",        "#909090",        "bright_black",  "dim"),
        "trail":    ("#56cfd2",       "#007a80",        "#00ffff",        "cyan",          "none"),
        "robot":    ("bold #ffffff",  "bold #000000",   "bold #ffffff",   "bold",          "bold"),
        "true robot": ("#b8a1e8",     "#5b3fb5",        "#cc99ff",        "magenta",       "none"),
        "ellipse":  ("#d68ad6",       "#97309b",        "#ff80ff",        "magenta",       "none"),
        "goal":     ("bold #7fd88f",  "bold #176f2c",   "bold #00ff66",   "bold green",    "bold"),
        "virtual":  ("#6cb6ff",       "#0b5cad",        "bold #66b3ff",   "bold blue",     "bold"),
        "zone":     ("#a08d52",       "#a08226",        "#ffff00",        "yellow",        "dim"),
        "cone":     ("#3f4f61",       "#b9c3ce",        "#909090",        "bright_black",  "dim"),
        "echo":     ("#ecc46a",       "#a05a00",        "bold #ffff00",   "bold yellow",   "bold"),
        "dead sonar": ("#a86ea8",     "#97309b",        "#ff80ff",        "magenta",       "dim"),
        "hit":      ("bold #ff9b6b",  "bold #b8430b",   "bold #ff8800",   "bold red",      "none"),
        "leave":    ("bold #a6e3a1",  "bold #176f2c",   "bold #00ff66",   "bold green",    "none"),
        "fence":    ("#ff6f6f",       "#b3121d",        "bold #ff4040",   "red",           "none"),
        "mission":  ("#b7a3f5",       "#5b3fb5",        "bold #cc99ff",   "magenta",       "none"),
        "draft":    ("#9a8fd0",       "#7a66c2",        "#cc99ff",        "magenta",       "none"),
        "ghost":    ("#7b8896",       "#8b95a1",        "#b8b8b8",        "bright_black",  "dim"),
        "other 0":  ("bold #ecc46a",  "bold #8a5a00",   "bold #ffff00",   "bold yellow",   "none"),
        "other 1":  ("bold #d68ad6",  "bold #97309b",   "bold #ff80ff",   "bold magenta",  "none"),
        "other 2":  ("bold #6cb6ff",  "bold #0b5cad",   "bold #66b3ff",   "bold blue",     "none"),
        "other 3":  ("bold #ff9b6b",  "bold #b8430b",   "bold #ff8800",   "bold red",      "none"),
        "other 4":  ("bold #9bd77a",  "bold #3f6b12",   "bold #00ff66",   "bold green",    "none"),
        "other 5":  ("bold #56cfd2",  "bold #007a80",   "bold #00ffff",   "bold cyan",     "none"),
        "trail 0":  ("#8a7444",       "#c7a266",        "#c0c000",        "yellow",        "dim"),
        "trail 1":  ("#7d547d",       "#c78fc9",        "#c060c0",        "magenta",       "dim"),
        "trail 2":  ("#446e96",       "#86b2db",        "#4c84bf",        "blue",          "dim"),
        "trail 3":  ("#945d43",       "#dba283",        "#bf6600",        "red",           "dim"),
        "trail 4":  ("#5d7f4a",       "#9dbd77",        "#00bf4c",        "green",         "dim"),
        "trail 5":  ("#377b7d",       "#7fbfc2",        "#00bfbf",        "cyan",          "dim"),
        "cursor":   (
            "bold #fff3b0", "bold #7a4b00", "bold #000000 on #ffff00",
            "bold reverse", "reverse",
        ),
    }
)  # fmt: skip
"""The styles of each role in the five themes."""

ROLES: Final = tuple(PAINTS)


@cache
def styles_of(theme: str) -> Mapping[str, Style]:
    """Return a style for each role; an unknown theme gets the styles of the dark one."""
    column = THEMES.index(theme) if theme in THEMES else 0
    return MappingProxyType({role: Style.parse(words[column]) for role, words in PAINTS.items()})
