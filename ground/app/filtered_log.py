"""Keep the lines of a log that pass a filter, wrapped to rows.

New lines are appended. Letters appended to the filter examine only the lines that passed before.
"""

from collections.abc import Sequence
from types import MappingProxyType
from typing import Final, NamedTuple

from ground.app.lists.table import Column, Heads, ListFilter
from ground.app.panels.log import log_rows, pieces_of
from ground.app.widgets.rows import Row
from ground.station.history.event_log import EventLog, LogLine


class LogRow(NamedTuple):
    """One row of a wrapped line: the piece of this number."""

    line: LogLine
    number: int


class LogRequest(NamedTuple):
    """The log, the least severity, the width and the order that rows were computed for."""

    log: EventLog
    worst: int
    width: int
    sorted_by: int | None
    is_descending: bool


LEVELS: Final = {"E": "error", "W": "warning", "I": "info", "D": "debug"}
SOURCE: Final = 6
COLUMNS: Final = (
    Column[LogLine](
        "time",
        7,
        lambda line: f"{line.time_s:.1f}",
        lambda line: line.time_s,
        numeric=True,
    ),
    Column[LogLine](
        "level", 1, lambda line: LEVELS[line.letter], lambda line: line.severity, short="L"
    ),
    Column[LogLine]("source", SOURCE, lambda line: line.source),
    Column[LogLine]("text", 0, lambda line: line.text),
)
NAMES: Final = ("level", "source", "text")
LEAD: Final = 20
"""A line that leaves as many columns is never wrapped: time and level take less."""
ALIASES: Final = MappingProxyType({"robot": "source"})


class FilteredLog:
    """Filters a log: `lines` in order, and their `parts`, one for each row on the screen."""

    def __init__(self) -> None:
        self.heads = Heads(COLUMNS)
        self.lines: list[LogLine] = []
        self.parts: list[LogRow] = []
        self.filter = ListFilter()
        self._kept: list[LogLine] = []
        self._asked: LogRequest | None = None
        self._total = 0
        self.examined = 0
        """The number of lines that were examined so far, for measurements."""

    def update(self, log: EventLog, worst: int, width: int, words: str = "") -> None:
        """Filter by severity (a lower number is worse) and words; wrap to a width in columns."""
        order = self.heads.sorted_by, self.heads.is_descending
        asked, fresh = LogRequest(log, worst, width, *order), log.since(self._total)
        wanted = self.filter
        if words != wanted.words:
            wanted = ListFilter(words, NAMES, ALIASES)
        if asked != self._asked or not wanted.narrows(self.filter):
            self._begin(list(log), asked, wanted)
        elif wanted is not self.filter:
            self._begin([*self._kept, *fresh], asked, wanted)
        elif log.total != self._total:
            self._add(fresh, asked)
        self._total = log.total

    def _begin(self, lines: list[LogLine], asked: LogRequest, wanted: ListFilter) -> None:
        """Filter these lines anew; letters appended to a filter need only those that passed."""
        self._asked, self.filter = asked, wanted
        self._kept, self.parts = [], []
        self._add(lines, asked)

    def _add(self, lines: Sequence[LogLine], asked: LogRequest) -> None:
        self.examined += len(lines)
        new = [line for line in lines if line.severity <= asked.worst and self._passes(line)]
        self._kept += new
        surplus = max(0, len(self._kept) - len(asked.log))
        if asked.sorted_by is None:
            self.lines = self._kept
            self.parts += [part for line in new for part in self._parts(line, asked.width)]
            dropped = self._kept[:surplus]
            del self.parts[: sum(len(self._parts(line, asked.width)) for line in dropped)]
            del self._kept[:surplus]
        elif new or not self._kept:
            del self._kept[:surplus]
            self.lines = self.heads.sorted(self._kept)
            self.parts = [part for line in self.lines for part in self._parts(line, asked.width)]

    def _passes(self, line: LogLine) -> bool:
        if not self.filter.words:
            return True
        level = LEVELS[line.letter]
        return self.filter.passes({"level": level, "source": line.source, "text": line.text})

    def _parts(self, line: LogLine, width: int) -> list[LogRow]:
        if len(line.text) + len(line.source) + LEAD <= width:
            return [LogRow(line, 0)]
        return [
            LogRow(line, number) for number in range(len(pieces_of(line, width, source=SOURCE)))
        ]

    def paint(self, part: LogRow, at: LogLine | None) -> Row:
        """Return a row as text; the rows of the line `at` are marked as found."""
        width = 0 if self._asked is None else self._asked.width
        return log_rows(part.line, width, found=part.line is at, source=SOURCE)[part.number]

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

    def beside(self, line: LogLine | None, step: int) -> LogLine | None:
        """Return the line after (1) or before (-1) a line; without one, the last but one."""
        here = next((at for at, one in enumerate(self.lines) if one is line), len(self.lines) - 1)
        return self.lines[max(0, min(len(self.lines) - 1, here + step))] if self.lines else None
