"""Define the characters of the map, for each pattern of dots in a cell and for each mark."""

from functools import cache, lru_cache
from typing import Final
from unicodedata import combining, east_asian_width

DOTS: Final = (0x01, 0x08, 0x02, 0x10, 0x04, 0x20, 0x40, 0x80)
"""The bit of the dot at [2 * (y % 4) + x % 2] in Unicode's braille patterns."""

BLANK: Final = " "
UNKNOWN: Final = "?"

MARKS: Final = {
    "seen": ("▒", ":"),
    "seen late": ("·", ","),
    "goal": ("◎", "O"),
    "virtual": ("◇", "o"),
    "cursor": ("✛", "+"),
    "hit": ("H", "H"),
    "leave": ("L", "L"),
    "waypoint": ("•", "*"),
    "draft": ("◦", "%"),
    "other": ("◆", "r"),
    "mover": ("●", "@"),
    "lost": ("?", "?"),
    "dead sonar": ("×", "X"),
    "reached": ("✓", "="),
    "collided": ("✕", "x"),
    "unreachable": ("∅", "0"),
    "ghost lost": ("¿", "&"),
    "stuck": ("■", "#"),
    "ended": ("□", "~"),
    "bar left": ("├", "|"),
    "bar": ("─", "-"),
    "bar right": ("┤", "|"),
}
"""The character of each meaning, in Unicode and in ASCII."""

DOTTED: Final = "⠿"
"""Echoes in colour: dots without a character of their own."""

HEADINGS: Final = ("▶◥▲◤◀◣▼◢", ">/^\\</v\\")
"""Arrowheads in steps of 45 degrees, counter-clockwise from the x axis."""

POINTERS: Final = ("→↗↑↖←↙↓↘", ">/^\\</v\\")
"""Arrows towards places outside the map, in the same order."""


def braille(bits: bytes | bytearray) -> str:
    """Return braille characters, one for each byte of dots; a cell without dots becomes a blank."""
    pairs = bytearray(b"\x00\x28" * len(bits))
    pairs[::2] = bits
    return pairs.decode("utf-16-le").replace("\u2800", BLANK)


def ascii_art(bits: bytes | bytearray) -> str:
    """Return ASCII characters, one for each byte of dots, for fonts without braille."""
    return bits.translate(_strokes()).decode("ascii")


@cache
def _strokes() -> bytes:
    return "".join(map(stroke, range(256))).encode("ascii")


def stroke(bits: int) -> str:
    """Return the ASCII character that looks most like a pattern of dots."""
    left = [row for row in range(4) if bits & DOTS[2 * row]]
    right = [row for row in range(4) if bits & DOTS[2 * row + 1]]
    rows = {*left, *right}
    if not rows:
        return BLANK
    if not left or not right:
        return "|" if len(rows) > 1 else "'" if rows <= {0, 1} else "."
    if len(rows) == 1:
        return "_" if rows == {3} else "-"
    if len(left) + len(right) >= 5:
        return "#" if len(left) + len(right) >= 7 else "+"
    lean = sum(left) / len(left) - sum(right) / len(right)
    if abs(lean) < 0.5:
        return "+" if len(rows) > 2 else "-"
    return "/" if lean > 0.0 else "\\"


@lru_cache(1024)
def printable(text: str, ascii_only: bool) -> str:
    """Replace each character that does not take exactly one printable cell by a question mark."""
    return "".join(
        character if _fits(character) and (character.isascii() or not ascii_only) else UNKNOWN
        for character in text
    )


def _fits(character: str) -> bool:
    wide = east_asian_width(character) in "WF"
    return character.isprintable() and not wide and not combining(character)
