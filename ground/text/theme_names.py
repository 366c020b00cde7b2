"""The themes by name; for this much nobody needs a terminal."""

from typing import Final

THEMES: Final = ("dark", "light", "contrast", "ansi", "mono")
