"""Splits a typed line into words: quotes as in a shell, printable characters only."""

import shlex
from typing import Final

from runtime.errors import UserError

MAX_LENGTH: Final = 1000


def words_of(text: str) -> list[str]:
    """Return the words of a command; UserError if the line cannot be split."""
    if len(text) > MAX_LENGTH:
        raise UserError(f"a command has at most {MAX_LENGTH} characters, not {len(text)}")
    line = text.replace("\t", " ").strip().removeprefix(":").strip()
    if odd := next((letter for letter in line if not letter.isprintable()), ""):
        raise UserError(f"{odd!r} cannot be part of a command: one line of plain text")
    try:
        return shlex.split(line)
    except ValueError:
        raise UserError("unbalanced quote: close it, or put \\ before it") from None


def last_word(text: str) -> tuple[list[str], str]:
    """Return the words before the one being typed, and that one, empty after a blank."""
    for closing in ("", "'", '"'):
        try:
            words = shlex.split(f"{text}{closing}")
        except ValueError:
            continue
        if words and (closing or text[-1:] not in (" ", "\t")):
            return words[:-1], words[-1]
        return words, ""
    return [], text
