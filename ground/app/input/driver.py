"""Textual's drivers of a terminal and of a browser, with ears that nothing they hear can stop."""

import os
from codecs import getincrementaldecoder
from collections.abc import Callable, Iterable
from select import select
from time import monotonic
from typing import Final

from textual.driver import Driver
from textual.drivers.linux_driver import LinuxDriver
from textual.message import Message

from ground.app.input.input_parser import Ears

AT_ONCE: Final = 4096
MOST_AT_ONCE: Final = 16 * AT_ONCE
TICK_S: Final = 0.1
WEB: Final = "WebDriver"


class Terminal(LinuxDriver):
    """Reads as its parent does, and goes on where that would wait for ever or end the app."""

    def run_input_thread(self) -> None:
        """Until the app ends, or the terminal is gone."""
        hearing = Hearing(self.process_message)
        while not self.exit_event.is_set():
            if select([self.fileno], [], [], TICK_S)[0]:
                data = read(self.fileno)
                if not data:
                    return
                hearing.hear(data)
            hearing.tick()


class Hearing:
    """Bytes come in, and messages go to the app."""

    def __init__(self, process: Callable[[Message], None]) -> None:
        self._process = process
        self._ears = Ears()
        self._decode = getincrementaldecoder("utf-8")("replace").decode

    def hear(self, data: bytes) -> None:
        self._hand_on(self._ears.feed(self._decode(data), monotonic()))

    def tick(self) -> None:
        """What has waited long enough for more."""
        self._hand_on(self._ears.tick(monotonic()))

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


def steady(driver: type[Driver]) -> type[Driver]:
    """Ours in the place of Textual's, where that reads a terminal or a browser."""
    if driver.__name__ == WEB:
        from ground.app.input.browser_driver import Browser  # only where there is one

        return Browser
    return Terminal if driver is LinuxDriver else driver
