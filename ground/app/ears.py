"""What was typed and pasted, as Textual's messages; nothing that is sent can stop the ears."""

from collections.abc import Iterable, Iterator
from typing import Final

from textual import events
from textual._xterm_parser import XTermParser
from textual.message import Message

from ground.app.pastes import Pastes, Piece

ESCAPE: Final = "\x1b"


class Ears:
    """Textual's parser, asked only for keys."""

    def __init__(self) -> None:
        self._pastes = Pastes()
        self._parser = XTermParser()

    def feed(self, text: str, now_s: float) -> Iterator[Message]:
        yield from self._messages(self._pastes.feed(text, now_s))

    def tick(self, now_s: float) -> Iterator[Message]:
        """What has waited long enough for more."""
        for piece in self._pastes.due(now_s):
            if piece.text == ESCAPE:  # the parser would wait for the rest of a key once more
                yield events.Key("escape", ESCAPE)
            else:
                yield from self._messages([piece])
        yield from self._parsed(self._parser.tick())

    def _messages(self, pieces: Iterable[Piece]) -> Iterator[Message]:
        for text, pasted in pieces:
            if pasted:
                yield events.Paste(text)
            else:
                yield from self._parsed(self._parser.feed(text))

    def _parsed(self, messages: Iterable[Message]) -> Iterator[Message]:
        """A parser that has stumbled over a sequence hears nothing any more: another one does."""
        try:
            yield from messages
        except Exception:
            before, self._parser = self._parser, XTermParser()
            self._parser.mouse_pixels = before.mouse_pixels
            self._parser.terminal_size = before.terminal_size
            self._parser.terminal_pixel_size = before.terminal_pixel_size
