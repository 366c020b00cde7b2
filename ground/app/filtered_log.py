"""The lines of a log that pass a filter, as rows of one width; made anew only where they change."""

from collections.abc import Iterable
from typing import NamedTuple

from ground.app.panels.log import log_rows, pieces_of
from ground.app.widgets.rows import Row
from ground.station.history.event_log import Line, Log


class LogRow(NamedTuple):
    """One row of a line: the text's piece of that number."""

    line: Line
    number: int


class LogFilter(NamedTuple):
    """What is shown of which log."""

    log: Log
    worst: int
    width: int


class FilteredLog:
    """`lines` in order, and the `parts` of them that are rows on the screen."""

    def __init__(self) -> None:
        self.lines: list[Line] = []
        self.parts: list[LogRow] = []
        self._asked: LogFilter | None = None
        self._total = 0

    def update(self, log: Log, worst: int, width: int) -> None:
        """Lines at least as bad as that; what has come since the last look, when it was alike."""
        asked = LogFilter(log, worst, width)
        if asked != self._asked:
            self._asked, self._total = asked, log.total
            self.lines, self.parts = [], []
            self._add(log, asked)
        elif log.total != self._total:
            fresh, self._total = log.since(self._total), log.total
            self._add(fresh, asked)

    def _add(self, lines: Iterable[Line], asked: LogFilter) -> None:
        new = [line for line in lines if line.severity <= asked.worst]
        self.lines += new
        self.parts += [part for line in new for part in self._parts(line, asked.width)]
        surplus = max(0, len(self.lines) - len(asked.log))
        gone = sum(len(self._parts(line, asked.width)) for line in self.lines[:surplus])
        del self.lines[:surplus], self.parts[:gone]

    def _parts(self, line: Line, width: int) -> list[LogRow]:
        return [LogRow(line, number) for number in range(len(pieces_of(line, width)))]

    def paint(self, part: LogRow, at: Line | None) -> Row:
        """A row; all those of the line `at` are marked as found."""
        width = 0 if self._asked is None else self._asked.width
        return log_rows(part.line, width, found=part.line is at)[part.number]

    def find(self, words: str, at: Line | None, step: int) -> Line | None:
        """The next line with these words, or the one before, from `at` on and round the end."""
        wanted = words.casefold()
        found = [
            number
            for number, line in enumerate(self.lines)
            if wanted in f"{line.source} {line.text}".casefold()
        ]
        if not found:
            return None
        here = next((number for number, line in enumerate(self.lines) if line is at), None)
        if here is None:
            return self.lines[found[0 if step > 0 else -1]]
        later = [number for number in found if number > here]
        before = [number for number in found if number < here]
        number = (later or found)[0] if step > 0 else (before or found)[-1]
        return self.lines[number]

    def row_of(self, line: Line) -> int:
        """Where its first row is."""
        return next((at for at, part in enumerate(self.parts) if part.line is line), 0)
