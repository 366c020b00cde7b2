"""The live line: in a terminal one line that never wraps, elsewhere one line after another."""

import json
import os
import pty
from collections.abc import Iterator
from io import StringIO
from struct import pack
from typing import TextIO

import pytest

from ground.text.output import Output
from ground.text.status_parts import Part
from runtime.cli.terminal import DIM

LINE = (Part("driving"), Part("3.25 m to go", "3.25 m", age_s=0.2))
MARK = "\0"


class Terminal:
    """The two ends of a terminal of our own."""

    def __init__(self) -> None:
        self._far, near = pty.openpty()
        self.near: TextIO = os.fdopen(near, "w", encoding="utf-8")

    def resize(self, columns: int) -> None:
        import fcntl
        import termios

        fcntl.ioctl(self.near, termios.TIOCSWINSZ, pack("HHHH", 24, columns, 0, 0))

    def seen(self) -> str:
        """Read all output since the last call, up to a mark that is written now.

        One `read` of a terminal may return a part only.
        """
        self.near.write(MARK)
        self.near.flush()
        found = b""
        while not found.endswith(MARK.encode()):
            found += os.read(self._far, 10_000)
        return found.decode().removesuffix(MARK)

    def close(self) -> None:
        self.near.close()
        os.close(self._far)


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[Terminal]:
    monkeypatch.delenv("NO_COLOR", raising=False)
    one = Terminal()
    yield one
    one.close()


def test_elsewhere_each_line_stays_and_is_whole() -> None:
    err = StringIO()
    output = Output(as_json=False, err=err)
    output.line(LINE)
    output.line((Part("reached"),))
    assert err.getvalue() == "driving  3.25 m to go (0.2 s)\nreached\n"


def test_a_terminal_shows_one_line_with_the_old_dimmed(terminal: Terminal) -> None:
    terminal.resize(40)
    output = Output(as_json=False, err=terminal.near)
    output.line(LINE)
    assert terminal.seen() == f"\rdriving  {DIM}3.25 m to go\x1b[0m"
    output.line((Part("reached"),))
    assert terminal.seen() == "\rreached" + " " * 14
    output.note("done")
    assert terminal.seen() == "\r\ndone\r\n"


def test_no_color_is_heeded(terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    terminal.resize(40)
    Output(as_json=False, err=terminal.near).line(LINE)
    assert terminal.seen() == "\rdriving  3.25 m to go (0.2 s)"


def test_a_window_that_gets_narrower_is_not_overrun(terminal: Terminal) -> None:
    output = Output(as_json=False, err=terminal.near)
    for columns in (40, 20, 8):
        terminal.resize(columns)
        output.line(LINE)
        shown = terminal.seen().removeprefix("\r").replace(DIM, "").replace("\x1b[0m", "")
        assert len(shown) < columns


def test_json_escapes_what_is_not_printable_and_loses_nothing() -> None:
    out = StringIO()
    found: dict[str, object] = {"text": "\x1b]0;x\x07 \x9b \u202e \U000e0041 \u2028 Grüße"}
    Output(as_json=True, out=out).result(found, "")
    assert out.getvalue().removesuffix("\n").isprintable()
    assert "Grüße" in out.getvalue()
    assert json.loads(out.getvalue()) == found


def test_a_note_can_neither_steer_nor_dim_the_terminal(terminal: Terminal) -> None:
    output = Output(as_json=False, err=terminal.near)
    terminal.resize(40)
    output.note(f"\x1b]0;OWNED\x07{DIM}\r")
    output.line((Part(f"{DIM}\u202ea"),))
    assert terminal.seen() == "?]0;OWNED??[2m?\r\n\r?[2m?a"
