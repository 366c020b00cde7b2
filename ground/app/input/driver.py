"""Define drivers of Textual, for a terminal and a browser, that no malformed input can stop.

Input is split into text and whole escape sequences (ECMA-48, and XTerm's own): Textual's parser
makes letters of unknown ones, which would be keys of the app. It also waits for the end of a paste
for ever; here a paste whose end is lost ends, and an escape within it makes no keys.
"""

import os
import re
import signal
from codecs import getincrementaldecoder
from collections.abc import Callable, Iterable, Iterator
from select import select
from time import monotonic
from typing import Final, NamedTuple

from textual import events
from textual._xterm_parser import XTermParser
from textual.driver import Driver
from textual.drivers._byte_stream import ByteStream
from textual.drivers.linux_driver import LinuxDriver
from textual.drivers.web_driver import WebDriver, _ExitInput
from textual.message import Message

ESCAPE: Final = "\x1b"
LONGEST: Final = 256
"""The most characters of an unfinished sequence; replies of terminals are shorter."""

_CSI: Final = r"\[[0-?]*[!-/]*"
_OPENS: Final = r"(?:\][0-9]|P[0-9!$+=>])"
_STRING: Final = rf"{_OPENS}[^\x07\x1b]*"
_KEY = re.compile(
    rf"{ESCAPE}(?:"
    r"\[\[[^\x1b]"  # Linux console
    r"|\[M[^\x1b]{3}"  # X10 mouse report
    r"|\[[0-9]+\$"  # rxvt
    rf"|{_CSI}[@-~]"
    r"|O[^\x1b]"
    rf"|{_STRING}(?:\x07|{ESCAPE}\\)"
    rf"|(?!{_OPENS})[^\x1b\[O])"
)
_BEGUN = re.compile(rf"{ESCAPE}(?:\[\[|\[M[^\x1b]{{0,2}}|{_CSI}|O|[\]P]|{_STRING}{ESCAPE}?)?\Z")
_BROKEN = re.compile(rf"{ESCAPE}(?:{_CSI}|O|{_STRING})?")
_TEXT = re.compile(r"[^\x1b]+")


def begun(text: str) -> int:
    """Return where an unfinished sequence begins at the end of the text, else its length."""
    found = _BEGUN.search(text)
    return len(text) if found is None or len(found[0]) > LONGEST else found.start()


def single(text: str) -> Iterator[str]:
    """Yield runs of characters, and escape sequences; of a broken one, the part there is."""
    at = 0
    while at < len(text):
        for pattern in (_TEXT, _KEY, _BROKEN):
            if found := pattern.match(text, at):
                yield found[0]
                at = found.end()
                break


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

    def _sigtstp_application(self, *_: object) -> None:
        """Restore the terminal, and only then stop the whole job.

        What has started this program, such as `make`, must stop, too, or the shell would wait for
        it; but once that has stopped, the shell takes the terminal, which could not be restored.
        """
        self.suspend_application_mode()
        self._must_signal_resume = True
        os.killpg(0, signal.SIGSTOP)


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
        # only in a browser

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


TYPED = "D"


class BrowserDriver(WebDriver):
    """Reads packets from the server: typed or pasted text, or news of the window."""

    def run_input_thread(self) -> None:
        """Read until the server sends the end."""
        reader, stream = InputReader(self.process_message), ByteStream()
        try:
            for data in self._input_reader:
                for kind, payload in stream.feed(data) if data else ():
                    if kind == TYPED:
                        reader.feed(payload)
                    else:
                        self._on_meta(kind, payload)
                reader.tick()
        except _ExitInput:
            pass
        finally:
            self._input_reader.close()
