"""Define Textual's drivers with a parser that no malformed input can stop."""

import os
from codecs import getincrementaldecoder
from collections.abc import Callable, Iterable, Iterator
from select import select
from time import monotonic
from typing import Final

from textual import events
from textual._xterm_parser import XTermParser
from textual.driver import Driver
from textual.drivers.linux_driver import LinuxDriver
from textual.message import Message

from ground.app.input.escape_sequences import ESCAPE, single
from ground.app.input.paste_parser import InputPiece, PasteParser

AT_ONCE: Final = 4096
MOST_AT_ONCE: Final = 16 * AT_ONCE
TICK_S: Final = 0.1
WEB: Final = "WebDriver"
CHORD: Final = 2
"""A key is escape, or escape and a letter, even if Textual has no name for it."""
ESCAPE_AND_STOP: Final = f"{ESCAPE} "
"""Escape and space in quick succession: the one closes what is open, so that the other stops."""
LONGEST_KNOWN: Final = 32
"""Textual splits a longer sequence, and one that contains an escape, into letters."""
KEPT: Final = ("last_x", "last_y", "mouse_pixels", "terminal_size", "terminal_pixel_size")


class TerminalDriver(LinuxDriver):
    """Reads as its parent does, but goes on where that would block for ever or end the app."""

    def run_input_thread(self) -> None:
        """Read until the app ends or the terminal is closed."""
        reader = InputReader(self.process_message)
        while not self.exit_event.is_set():
            if select([self.fileno], [], [], TICK_S)[0]:
                data = read(self.fileno)
                if not data:
                    return
                reader.feed(data)
            reader.tick()


class InputReader:
    """Decodes bytes, and passes messages to the app."""

    def __init__(self, process: Callable[[Message], None]) -> None:
        self._process = process
        self._parser = InputParser()
        self._decode = getincrementaldecoder("utf-8")("replace").decode

    def feed(self, data: bytes) -> None:
        """Parse these bytes."""
        self._pass_on(self._parser.feed(self._decode(data), monotonic()))

    def tick(self) -> None:
        """Parse what has waited too long for the rest of a sequence."""
        self._pass_on(self._parser.tick(monotonic()))

    def _pass_on(self, messages: Iterable[Message]) -> None:
        for message in messages:
            self._process(message)


def read(descriptor: int) -> bytes:
    """Read what is available, up to a limit; return b"" when the terminal is closed."""
    data = b""
    try:
        while len(data) < MOST_AT_ONCE and (more := os.read(descriptor, AT_ONCE)):
            data += more
            if not select([descriptor], [], [], 0.0)[0]:
                break
    except OSError:  # the terminal was closed
        pass
    return data


def with_robust_input(driver: type[Driver]) -> type[Driver]:
    """Replace Textual's driver of a terminal or a browser by ours."""
    if driver.__name__ == WEB:
        from ground.app.input.browser_driver import BrowserDriver  # only in a browser

        return BrowserDriver
    return TerminalDriver if driver is LinuxDriver else driver


class InputParser:
    """Gives Textual's parser one key at a time, so that it keeps nothing from one to the next."""

    def __init__(self) -> None:
        self._pastes = PasteParser()
        self._parser = XTermParser()

    def feed(self, text: str, now_s: float) -> Iterator[Message]:
        """Return the messages of a text."""
        return self._messages(self._pastes.feed(text, now_s))

    def tick(self, now_s: float) -> Iterator[Message]:
        """Return the messages of what has waited too long for the rest of a sequence."""
        return self._messages(self._pastes.due(now_s))

    def _messages(self, pieces: Iterable[InputPiece]) -> Iterator[Message]:
        for text, pasted in pieces:
            if pasted:
                yield events.Paste(text)
            else:
                for key in single(text):
                    yield from self._parsed(key)

    def _parsed(self, key: str) -> list[Message]:
        """Return nothing for a sequence that Textual does not know or fails on."""
        if key == ESCAPE_AND_STOP:
            return [*self._parsed(ESCAPE), *self._parsed(key[1:])]
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
        if not found:  # the parser waits for more, or has ended
            before, self._parser = self._parser, XTermParser()
            for name in KEPT:
                setattr(self._parser, name, getattr(before, name))
        return found
