"""The output of a verb: exactly one result on standard output, the rest on standard error."""

import json
import os
import sys
from collections.abc import Sequence
from math import isfinite
from typing import Final, TextIO

from ground.text.wording import NUMBER, Part, fitted, in_words, spoken
from runtime.cli.terminal import DIM, LINE_START, PLAIN, guarded, steer
from runtime.clock import Clock
from runtime.units import NS_PER_S

DEFAULT_WIDTH: Final = 80


READ_NS: Final = 10 * NS_PER_S
"""A screen reader takes six to nine seconds for a line."""


class SpokenLines:
    """Prints lines for a screen reader: when the first words change, else every ten seconds."""

    def __init__(self, output: "Output", clock: Clock) -> None:
        self._output, self._clock = output, clock
        self._lead = ""
        self._due_ns = clock.now_ns()

    def show(self, parts: Sequence[Part]) -> None:
        """Print the present state, if it is time; a number is no word."""
        now_ns, text = self._clock.now_ns(), in_words(parts)
        lead = NUMBER.sub("", parts[0].text) if parts else ""
        if lead != self._lead or now_ns >= self._due_ns:
            self._lead, self._due_ns = lead, now_ns + READ_NS
            self._output.note(spoken(text))


class Output:
    """Prints notes, a live line and the result; only in a terminal `line` rewrites itself."""

    def __init__(self, *, as_json: bool, out: TextIO | None = None, err: TextIO | None = None):
        self.as_json = as_json
        self._out = guarded(out or sys.stdout)
        self._err = guarded(err or sys.stderr)
        self.live = self._err.isatty()
        self._dims = self.live and not os.environ.get("NO_COLOR")  # no-color.org
        self._open = 0
        self.has_result = False

    def note(self, text: str) -> None:
        """Print a message that is not the result."""
        self.end_line()
        print(text, file=self._err, flush=True)

    def line(self, parts: Sequence[Part]) -> None:
        """Show the present state: in a terminal in place of the last one, else on a new line."""
        if not self.live:
            self.note(in_words(parts))
            return
        # The last column stays free: some terminals wrap as soon as it is written.
        width = self._width() - 1
        steer(self._err, LINE_START)
        length = 0
        for text, dim in fitted(parts, width, dims=self._dims):
            self._paint(text, dim=dim)
            length += len(text)
        self._err.write(" " * (min(self._open, width) - length))
        self._err.flush()
        self._open = length

    def _paint(self, text: str, *, dim: bool) -> None:
        if dim:
            steer(self._err, DIM)
        self._err.write(text)
        if dim:
            steer(self._err, PLAIN)

    def _width(self) -> int:
        """Return the width of the terminal, which may change at any time."""
        try:
            return os.get_terminal_size(self._err.fileno()).columns or DEFAULT_WIDTH
        except OSError:
            return DEFAULT_WIDTH

    def end_line(self) -> None:
        """End the live line, if there is one."""
        if self._open:
            self._err.write("\n")
            self._err.flush()
            self._open = 0

    def result(self, found: dict[str, object], text: str) -> None:
        """Print the one result, as JSON or in words."""
        self.end_line()
        self.has_result = True
        print(dumps(found) if self.as_json else text, file=self._out, flush=True)


def dumps(found: dict[str, object]) -> str:
    """Return strict JSON: values that are not finite become null, odd characters are escaped."""
    text = json.dumps(_finite(found), allow_nan=False, ensure_ascii=False)
    if text.isprintable():
        return text
    return "".join(one if one.isprintable() else json.dumps(one)[1:-1] for one in text)


def _finite(value: object) -> object:
    if isinstance(value, float) and not isfinite(value):
        return None
    if isinstance(value, dict):
        return {str(key): _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    return value
