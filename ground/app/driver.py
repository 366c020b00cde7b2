"""Textual's driver of a terminal, with ears that nothing the terminal sends can stop."""

import os
from codecs import getincrementaldecoder
from collections.abc import Iterable, Iterator
from select import select
from time import monotonic
from typing import Final

from textual import events
from textual._xterm_parser import XTermParser
from textual.driver import Driver
from textual.drivers.linux_driver import LinuxDriver
from textual.message import Message

from ground.app.pastes import Pastes, Piece

ESCAPE: Final = "\x1b"
AT_ONCE: Final = 4096
MOST_AT_ONCE: Final = 16 * AT_ONCE
TICK_S: Final = 0.1


class Ears:
    """What was typed and pasted, as Textual's messages."""

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


class Terminal(LinuxDriver):
    """Reads as its parent does, and goes on where that would wait for ever or end the app."""

    def run_input_thread(self) -> None:
        """Until the app ends, or the terminal is gone."""
        ears, decode = Ears(), getincrementaldecoder("utf-8")("replace").decode
        while not self.exit_event.is_set():
            if select([self.fileno], [], [], TICK_S)[0]:
                data = read(self.fileno)
                if not data:
                    return
                self._process(ears.feed(decode(data), monotonic()))
            self._process(ears.tick(monotonic()))

    def _process(self, messages: Iterable[Message]) -> None:
        for message in messages:
            self.process_message(message)


def read(descriptor: int) -> bytes:
    """What is there now, as far as it goes together; nothing when nobody writes any more."""
    data = b""
    try:
        while len(data) < MOST_AT_ONCE and (more := os.read(descriptor, AT_ONCE)):
            data += more
            if not select([descriptor], [], [], 0.0)[0]:
                break
    except OSError:  # the terminal is gone
        pass
    return data


def steady(driver: type[Driver]) -> type[Driver]:
    """Ours in the place of Textual's, where that is what reads a terminal."""
    return Terminal if driver is LinuxDriver else driver
