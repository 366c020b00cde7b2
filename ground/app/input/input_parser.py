"""What was typed and pasted, as Textual's messages; nothing that is sent can stop the ears."""

from collections.abc import Iterable, Iterator
from typing import Final

from textual import events
from textual._xterm_parser import XTermParser
from textual.message import Message

from ground.app.input.escape_sequences import ESCAPE, single
from ground.app.input.paste_parser import Pastes, Piece

CHORD: Final = 2
"""Escape, or escape and a letter, is a key even where Textual knows no name for it."""
LONGEST_KNOWN: Final = 32
"""Textual takes a longer sequence apart, and one with an escape in it."""
KEPT: Final = ("last_x", "last_y", "mouse_pixels", "terminal_size", "terminal_pixel_size")


class Ears:
    """Textual's parser, given one key at a time: it keeps nothing from one to the next."""

    def __init__(self) -> None:
        self._pastes = Pastes()
        self._parser = XTermParser()

    def feed(self, text: str, now_s: float) -> Iterator[Message]:
        return self._messages(self._pastes.feed(text, now_s))

    def tick(self, now_s: float) -> Iterator[Message]:
        """What has waited long enough for more."""
        return self._messages(self._pastes.due(now_s))

    def _messages(self, pieces: Iterable[Piece]) -> Iterator[Message]:
        for text, pasted in pieces:
            if pasted:
                yield events.Paste(text)
            else:
                for key in single(text):
                    yield from self._parsed(key)

    def _parsed(self, key: str) -> list[Message]:
        """Nothing for a sequence that Textual does not know, or stumbles over."""
        if not key.startswith(ESCAPE):
            return list(self._parser.feed(key))
        found: list[Message] = []
        if len(key) <= LONGEST_KNOWN and ESCAPE not in key[1:]:
            try:
                found = list(self._parser.feed(key))
                if not found and len(key) <= CHORD:
                    self._parser._timeout_time = 0.0
                    found = list(self._parser.tick())
            except Exception:
                found = []
        if not found:  # it waits for more, or has ended
            before, self._parser = self._parser, XTermParser()
            for name in KEPT:
                setattr(self._parser, name, getattr(before, name))
        return found
