"""Write to terminals without control characters from untrusted text.

A name, a message or a file may contain escape sequences that change a terminal's title, clipboard
or input, and marks that reverse the reading order. Every process of Sidestep writes through
`PrintableText`; only `steer` writes one of a few control sequences.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final, Literal, TextIO, cast

REPLACEMENT: Final = "?"
DIM: Final = "\x1b[2m"
PLAIN: Final = "\x1b[0m"
LINE_START: Final = "\r"
TAB: Final = "\t"
CLEAR_LINE: Final = "\r\x1b[K"
Sequence = Literal["\t", "\r", "\r\x1b[K", "\x1b[2m", "\x1b[0m"]


def printable(text: str) -> str:
    """Replace each non-printable character, line breaks included, by a question mark.

    These are the control characters of C0 and C1, format characters such as those that change the
    direction of writing, line separators, and halves of surrogate pairs.
    """
    if text.isprintable():
        return text
    return "".join(letter if letter.isprintable() else REPLACEMENT for letter in text)


def printable_lines(text: str) -> str:
    """Replace non-printable characters, but keep line feeds; tabs become spaces."""
    return "\n".join(printable(line) for line in text.replace("\t", " ").split("\n"))


def encodable(text: str, encoding: str) -> str:
    """Replace the characters that an encoding does not have; a degree sign becomes `deg`."""
    if text.isascii():
        return text
    try:
        text.encode(encoding)
    except UnicodeEncodeError:
        return text.replace("°", " deg").encode(encoding, "replace").decode(encoding)
    return text


class PrintableText:
    """A text stream whose `write` passes only printable characters and line feeds."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        """Write text without control characters; return its length."""
        self.stream.write(encodable(printable_lines(text), self.stream.encoding or "utf-8"))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


def guarded(stream: TextIO) -> TextIO:
    """Return the stream behind a `PrintableText`, unless it is one already."""
    return stream if isinstance(stream, PrintableText) else cast(TextIO, PrintableText(stream))


def steer(stream: TextIO, sequence: Sequence) -> None:
    """Write one of our own control sequences."""
    target = stream.stream if isinstance(stream, PrintableText) else stream
    target.write(sequence)


@contextmanager
def guarded_output() -> Iterator[None]:
    """Guard standard output and standard error of this process while the block runs.

    After an exception they stay guarded, because the interpreter prints its traceback later. A
    stream that was closed at the start is None, and stays so.
    """
    before = sys.stdout, sys.stderr
    sys.stdout = sys.stdout and guarded(sys.stdout)
    sys.stderr = sys.stderr and guarded(sys.stderr)
    yield
    sys.stdout, sys.stderr = before
