"""What a terminal sends, told apart: keys, and what is pasted, whole, however it ends.

Textual's parser waits for the end of a paste for ever, and makes keys of an escape within it.
"""

from typing import Final, NamedTuple

from ground.app.input.escape_sequences import begun

START: Final = "\x1b[200~"
END: Final = "\x1b[201~"
MOST: Final = 10_000
"""So many characters of a paste are kept: the command line takes one line of 400."""
SILENT_S: Final = 0.3
"""A paste of which nothing has come for so long is over, whatever has become of its end."""
SLOWEST_PER_S: Final = 200.0
"""Fewer characters are typed: whoever beats on the keys does not make a paste go on."""
HELD_S: Final = 0.1
"""The first half of a mark, or of a key, waits so long for the other one."""
LONGEST_KEY: Final = 32
"""Whoever types sends less at once; what is left of a paste comes in longer pieces."""


class InputPiece(NamedTuple):
    """Some of what came: whole keys as the terminal sends them, or all that was pasted at once."""

    text: str
    pasted: bool = False


class PasteParser:
    """`feed` is given what came, `due` is asked from time to time; seconds of any one clock."""

    def __init__(self) -> None:
        self._held = ""
        self._pasted: list[str] | None = None
        self._room = MOST
        self._cut = False
        self._fed_s = self._over_s = 0.0

    def feed(self, text: str, now_s: float) -> list[InputPiece]:
        self._over_s = min(now_s + SILENT_S, self._over_s + len(text) / SLOWEST_PER_S)
        text, self._held, self._fed_s = self._held + text, "", now_s
        pieces: list[InputPiece] = []
        while text:
            text = self._keys(text, pieces) if self._pasted is None else self._paste(text, pieces)
        return pieces

    def due(self, now_s: float) -> list[InputPiece]:
        """What need not wait any longer for what has not come."""
        if self._pasted is not None and now_s >= self._over_s:
            self._held, self._cut = "", True
            return [self._taken()]
        if self._pasted is None and self._held and now_s - self._fed_s >= HELD_S:
            held, self._held = self._held, ""
            return [InputPiece(held)]
        return []

    def _keys(self, text: str, pieces: list[InputPiece]) -> str:
        """Up to the next paste; what is left of the text."""
        keys, mark, rest = text.partition(START)
        if not mark:
            at = begun(keys)
            keys, self._held = keys[:at], keys[at:]
        if self._cut and keys:
            keys = self._after_the_cut(keys)
        if keys:
            pieces.append(InputPiece(keys))
        if mark:
            self._pasted, self._room, self._cut = [], MOST, False
            self._over_s = self._fed_s + SILENT_S
        return rest

    def _after_the_cut(self, keys: str) -> str:
        """Without what is the rest of a paste that was given up: nobody has typed that."""
        end = keys.rfind(END)
        if end < 0 and len(keys) > LONGEST_KEY:
            return ""
        self._cut = False
        return keys if end < 0 else keys[end + len(END) :]

    def _paste(self, text: str, pieces: list[InputPiece]) -> str:
        """Up to the last end before another start: what is pasted may hold an end, too."""
        end = text.find(END)
        if end < 0:
            body, self._held = halved(text, END)
            self._keep(body)
            return ""
        again = text.find(START, end)
        end = text.rfind(END, end, again if again >= 0 else len(text))
        self._keep(text[:end])
        pieces.append(self._taken())
        return text[end + len(END) :]

    def _keep(self, text: str) -> None:
        if self._pasted is not None and self._room > 0:
            self._pasted.append(text[: self._room])
            self._room -= len(text)

    def _taken(self) -> InputPiece:
        text, self._pasted = "".join(self._pasted or ()), None
        return InputPiece(plain(text), pasted=True)


def halved(text: str, mark: str) -> tuple[str, str]:
    """The text, and its end when that may be the beginning of the mark."""
    for length in range(min(len(mark) - 1, len(text)), 0, -1):
        if mark.startswith(text[-length:]):
            return text[:-length], text[-length:]
    return text, ""


def plain(text: str) -> str:
    """Lines of what can be seen: nothing that could steer a terminal."""
    lines = text.replace("\r\n", "\n").replace("\r", "\n").replace("\t", " ")
    return "".join(mark for mark in lines if mark == "\n" or mark.isprintable())
