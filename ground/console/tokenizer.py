"""What was typed, as words: quotes as in a shell, nothing that cannot be seen."""

import shlex
from typing import Final

from runtime.errors import UserError

LONGEST: Final = 1000


def words_of(text: str) -> list[str]:
    """The words of one command; UserError when it cannot be one."""
    if len(text) > LONGEST:
        raise UserError(f"{len(text)} characters are no command: at most {LONGEST}")
    line = text.replace("\t", " ").strip().removeprefix(":").strip()
    if odd := next((letter for letter in line if not letter.isprintable()), ""):
        raise UserError(f"{odd!r} cannot be part of a command: one line of plain text")
    try:
        return shlex.split(line)
    except ValueError:
        raise UserError("a quotation has no end: close it, or put \\ before the quote") from None


def last_word(text: str) -> tuple[list[str], str]:
    """The words before the one that is being typed, and that one, empty after a blank."""
    for closing in ("", "'", '"'):
        try:
            words = shlex.split(f"{text}{closing}")
        except ValueError:
            continue
        if words and (closing or text[-1:] not in (" ", "\t")):
            return words[:-1], words[-1]
        return words, ""
    return [], text
