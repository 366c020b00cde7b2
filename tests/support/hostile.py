"""Texts that would command a terminal, and how to see that none got there."""

from typing import Final

OWNED: Final = "OWNED"
LETTERS: Final = (
    "\x00\x07\x08\x0b\x0c\r\x1b\x7f\x80\x84\x85\x8d\x90\x9b\x9c\x9d\x9f"
    "\u061c\u200e\u200f\u2028\u2029\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"
)
TEXT: Final = f"\x1b]0;{OWNED}\x07\x1b[2J\x9b1A\r\u202e\u2066\x7f\u2028"
"""A title, a screen that is emptied, a line overwritten, and the order of reading reversed."""


def raw_in(output: str) -> list[str]:
    """Return the control characters in an output."""
    return sorted({repr(one) for one in output if one != "\n" and not one.isprintable()})
