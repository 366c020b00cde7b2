"""Textual's drivers of a terminal and of a browser, with ears that nothing they hear can stop."""

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
"""Escape, or escape and a letter, is a key even where Textual knows no name for it."""
LONGEST_KNOWN: Final = 32
"""Textual takes a longer sequence apart, and one with an escape in it."""
KEPT: Final = ("last_x", "last_y", "mouse_pixels", "terminal_size", "terminal_pixel_size")


class TerminalDriver(LinuxDriver):
    """Reads as its parent does, and goes on where that would wait for ever or end the app."""

    def run_input_thread(self) -> None:
        """Until the app ends, or the terminal is gone."""
        reader = InputReader(self.process_message)
        while not self.exit_event.is_set():
            if select([self.fileno], [], [], TICK_S)[0]:
                data = read(self.fileno)
                if not data:
                    return
                reader.feed(data)
            reader.tick()


class InputReader:
    """Bytes come in, and messages go to the app."""

    def __init__(self, process: Callable[[Message], None]) -> None:
        self._process = process
        self._parser = InputParser()
        self._decode = getincrementaldecoder("utf-8")("replace").decode

    def feed(self, data: bytes) -> None:
        self._hand_on(self._parser.feed(self._decode(data), monotonic()))

    def tick(self) -> None:
        """What has waited long enough for more."""
        self._hand_on(self._parser.tick(monotonic()))

    def _hand_on(self, messages: Iterable[Message]) -> None:
        for message in messages:
            self._process(message)


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


def with_robust_input(driver: type[Driver]) -> type[Driver]:
    """Ours in the place of Textual's, where that reads a terminal or a browser."""
    if driver.__name__ == WEB:
        from ground.app.input.browser_driver import BrowserDriver  # only where there is one

        return BrowserDriver
    return TerminalDriver if driver is LinuxDriver else driver


class InputParser:
    """Textual's parser, given one key at a time: it keeps nothing from one to the next."""

    def __init__(self) -> None:
        self._pastes = PasteParser()
        self._parser = XTermParser()

    def feed(self, text: str, now_s: float) -> Iterator[Message]:
        return self._messages(self._pastes.feed(text, now_s))

    def tick(self, now_s: float) -> Iterator[Message]:
        """What has waited long enough for more."""
        return self._messages(self._pastes.due(now_s))

    def _messages(self, pieces: Iterable[InputPiece]) -> Iterator[Message]:
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
