"""Keep the lines of a log that pass a filter, wrapped to rows.

Rows are computed again only when the filter changes; new lines are appended.
"""

from collections.abc import Iterable
from typing import NamedTuple

from ground.app.panels.log import log_rows, pieces_of
from ground.app.widgets.rows import Row
from ground.station.history.event_log import EventLog, LogLine


class LogRow(NamedTuple):
    """One row of a wrapped line: the piece of this number."""

    line: LogLine
    number: int


class LogFilter(NamedTuple):
    """The log, the least severity and the width that rows were computed for."""

    log: EventLog
    worst: int
    width: int


class FilteredLog:
    """Filters a log: `lines` in order, and their `parts`, one for each row on the screen."""

    def __init__(self) -> None:
        self.lines: list[LogLine] = []
        self.parts: list[LogRow] = []
        self._asked: LogFilter | None = None
        self._total = 0

    def update(self, log: EventLog, worst: int, width: int) -> None:
        """Filter by severity (a lower number is worse), and wrap to a width in columns."""
        asked = LogFilter(log, worst, width)
        if asked != self._asked:
            self._asked, self._total = asked, log.total
            self.lines, self.parts = [], []
            self._add(log, asked)
        elif log.total != self._total:
            fresh, self._total = log.since(self._total), log.total
            self._add(fresh, asked)

    def _add(self, lines: Iterable[LogLine], asked: LogFilter) -> None:
        new = [line for line in lines if line.severity <= asked.worst]
        self.lines += new
        self.parts += [part for line in new for part in self._parts(line, asked.width)]
        surplus = max(0, len(self.lines) - len(asked.log))
        gone = sum(len(self._parts(line, asked.width)) for line in self.lines[:surplus])
        del self.lines[:surplus], self.parts[:gone]

    def _parts(self, line: LogLine, width: int) -> list[LogRow]:
        return [LogRow(line, number) for number in range(len(pieces_of(line, width)))]

    def paint(self, part: LogRow, at: LogLine | None) -> Row:
        """Return a row as text; the rows of the line `at` are marked as found."""
        width = 0 if self._asked is None else self._asked.width
        return log_rows(part.line, width, found=part.line is at)[part.number]

    def find(self, words: str, at: LogLine | None, step: int) -> LogLine | None:
        """Return the next line with these words after `at`, or the one before it.

        The search wraps around the end. Return None when no line has these words.
        """
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

    def row_of(self, line: LogLine) -> int:
        """Return the index of the first row of a line."""
        return next((at for at, part in enumerate(self.parts) if part.line is line), 0)
