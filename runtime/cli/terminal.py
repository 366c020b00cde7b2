"""Output for terminals, into which no text from elsewhere can put a control character.

A name, a message or a file may hold escape sequences that change a terminal's title, clipboard or
input, and marks that reverse the order of what is read. Every process of Sidestep writes through
`PrintableText`; only `steer` sends one of the few sequences of our own.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final, Literal, TextIO, cast

REPLACEMENT: Final = "?"
DIM: Final = "\x1b[2m"
PLAIN: Final = "\x1b[0m"
LINE_START: Final = "\r"
CLEAR_LINE: Final = "\r\x1b[K"
Sequence = Literal["\r", "\r\x1b[K", "\x1b[2m", "\x1b[0m"]


def printable(text: str) -> str:
    """Replace each character that is not printable, line breaks included, by a question mark.

    Not printable are the control characters of C0 and C1, format characters such as those that
    change the direction of writing, line separators, and halves of surrogate pairs.
    """
    if text.isprintable():
        return text
    return "".join(letter if letter.isprintable() else REPLACEMENT for letter in text)


def printable_lines(text: str) -> str:
    """The same, but line feeds stay and tabs become spaces."""
    return "\n".join(printable(line) for line in text.replace("\t", " ").split("\n"))


class PrintableText:
    """A text stream whose `write` lets only printable characters and line feeds through."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        self.stream.write(printable_lines(text))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


def guarded(stream: TextIO) -> TextIO:
    """The stream behind a `PrintableText`, once however often it is asked for."""
    return stream if isinstance(stream, PrintableText) else cast(TextIO, PrintableText(stream))


def steer(stream: TextIO, sequence: Sequence) -> None:
    """Write one of our own control sequences."""
    target = stream.stream if isinstance(stream, PrintableText) else stream
    target.write(sequence)


@contextmanager
def guarded_output() -> Iterator[None]:
    """Guard standard output and standard error of this process while the block runs.

    After an exception they stay guarded: the interpreter prints its traceback later. One that was
    closed when the process began is None, and stays so.
    """
    before = sys.stdout, sys.stderr
    sys.stdout = sys.stdout and guarded(sys.stdout)
    sys.stderr = sys.stderr and guarded(sys.stderr)
    yield
    sys.stdout, sys.stderr = before
