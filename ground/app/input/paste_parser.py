"""Separate keys from pasted text in a terminal's input, also when the end of a paste is lost.

Textual's parser waits for the end of a paste for ever, and makes keys of an escape within it.
"""

from typing import Final, NamedTuple

from ground.app.input.escape_sequences import begun

START: Final = "\x1b[200~"
END: Final = "\x1b[201~"
MAX_LENGTH: Final = 10_000
"""The characters of a paste that are kept; the command line takes one line of 400."""
SILENT_S: Final = 0.3
"""A paste ends when nothing more has come for this time, even without its end mark."""
SLOWEST_PER_S: Final = 200.0
"""A slower stream does not extend a paste, so that pressing keys quickly ends it."""
HELD_S: Final = 0.1
"""The first part of a mark, or of a key, waits this long for the rest."""
LONGEST_KEY: Final = 32
"""Typing sends less at once; the rest of a paste arrives in longer pieces."""


class InputPiece(NamedTuple):
    """Whole keys as the terminal sends them, or all the text of a paste."""

    text: str
    pasted: bool = False


class PasteParser:
    """Splits input: `feed` takes text, `due` is called regularly.

    Times are seconds of one clock.
    """

    def __init__(self) -> None:
        self._held = ""
        self._pasted: list[str] | None = None
        self._room = MAX_LENGTH
        self._gave_up = False
        self._fed_s = self._over_s = 0.0

    def feed(self, text: str, now_s: float) -> list[InputPiece]:
        """Return the pieces that are complete."""
        self._over_s = min(now_s + SILENT_S, self._over_s + len(text) / SLOWEST_PER_S)
        text, self._held, self._fed_s = self._held + text, "", now_s
        pieces: list[InputPiece] = []
        while text:
            text = self._keys(text, pieces) if self._pasted is None else self._paste(text, pieces)
        return pieces

    def due(self, now_s: float) -> list[InputPiece]:
        """Return the pieces that have waited too long for their rest."""
        if self._pasted is not None and now_s >= self._over_s:
            self._held, self._gave_up = "", True
            return [self._finish_paste()]
        if self._pasted is None and self._held and now_s - self._fed_s >= HELD_S:
            held, self._held = self._held, ""
            return [InputPiece(held)]
        return []

    def _keys(self, text: str, pieces: list[InputPiece]) -> str:
        """Read keys up to the next paste; return the remaining text."""
        keys, mark, rest = text.partition(START)
        if not mark:
            at = begun(keys)
            keys, self._held = keys[:at], keys[at:]
        if self._gave_up and keys:
            keys = self._without_late_rest(keys)
        if keys:
            pieces.append(InputPiece(keys))
        if mark:
            self._pasted, self._room, self._gave_up = [], MAX_LENGTH, False
            self._over_s = self._fed_s + SILENT_S
        return rest

    def _without_late_rest(self, keys: str) -> str:
        """Remove the late rest of a paste that was given up."""
        end = keys.rfind(END)
        if end < 0 and len(keys) > LONGEST_KEY:
            return ""
        self._gave_up = False
        return keys if end < 0 else keys[end + len(END) :]

    def _paste(self, text: str, pieces: list[InputPiece]) -> str:
        """Read up to the last end mark before another start mark.

        Pasted text may contain an end mark, too.
        """
        end = text.find(END)
        if end < 0:
            body, self._held = split_partial_mark(text, END)
            self._keep(body)
            return ""
        again = text.find(START, end)
        end = text.rfind(END, end, again if again >= 0 else len(text))
        self._keep(text[:end])
        pieces.append(self._finish_paste())
        return text[end + len(END) :]

    def _keep(self, text: str) -> None:
        if self._pasted is not None and self._room > 0:
            self._pasted.append(text[: self._room])
            self._room -= len(text)

    def _finish_paste(self) -> InputPiece:
        text, self._pasted = "".join(self._pasted or ()), None
        return InputPiece(printable_lines(text), pasted=True)


def split_partial_mark(text: str, mark: str) -> tuple[str, str]:
    """Split off the end of the text when it may be the beginning of the mark."""
    for length in range(min(len(mark) - 1, len(text)), 0, -1):
        if mark.startswith(text[-length:]):
            return text[:-length], text[-length:]
    return text, ""


def printable_lines(text: str) -> str:
    """Return the text without control characters except newlines."""
    lines = text.replace("\r\n", "\n").replace("\r", "\n").replace("\t", " ")
    return "".join(mark for mark in lines if mark == "\n" or mark.isprintable())
