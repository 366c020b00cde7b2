"""The names of the themes, which need no import of the terminal library."""

from typing import Final

THEMES: Final = ("dark", "light", "contrast", "ansi", "mono")
