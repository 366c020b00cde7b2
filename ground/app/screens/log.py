"""Show the Log screen: all events, filtered by words and severity, and searched."""

from collections.abc import Mapping
from functools import partial
from typing import ClassVar, Final

from textual import events
from textual.app import ComposeResult

from ground.app.app_interface import AppInterface
from ground.app.chrome.key_bar import NextKey
from ground.app.filtered_log import FilteredLog
from ground.app.input.keymap import Layer
from ground.app.lists.table import ColumnHeads, nothing_row
from ground.app.panels.log import lead_of, zone_words
from ground.app.screens.app_screen import Action
from ground.app.screens.list_screen import ScrolledScreen
from ground.app.widgets.lines import Lines, LogView
from ground.app.widgets.rows import Row, Span, faint, row, words_of
from ground.station.history.event_log import LogLine
from protocol.wire.enums import Severity

WORST: Final = (
    (Severity.DEBUG, "all levels"),
    (Severity.WARNING, "warnings and errors"),
    (Severity.ERROR, "errors"),
)

SCROLLING: Final = ("page-up", "page-down", "row-first", "row-last")


class LogScreen(ScrolledScreen):
    """The log, in lines that scroll."""

    key_layer = Layer.LOG
    focus_first: ClassVar[str] = "#lines"

    def __init__(self, interface: AppInterface) -> None:
        super().__init__(interface)
        self.filtered = FilteredLog()
        self._worst = 0
        self._find_words = ""
        self._at: LogLine | None = None

    def compose_content(self) -> ComposeResult:
        """Compose heading and lines."""
        yield Lines(id="heading")
        yield ColumnHeads(self.filtered.heads, id="columns")
        yield LogView(id="lines")

    @property
    def list_view(self) -> LogView:
        """The lines."""
        return self.query_one(LogView)

    def draw(self) -> None:
        """Draw the lines in sight."""
        self.filter_log()
        self.lines("heading").show([self.heading()])
        self.query_one(ColumnHeads).draw()
        if self.filtered.lines or not self.words:
            self.list_view.window(
                self.filtered.parts, lambda part: self.filtered.paint(part, self._at)
            )
        else:
            self.list_view.show([nothing_row(self.words)])

    def filter_log(self) -> None:
        """Update the filtered log."""
        log, width = self.interface.station.log, self.list_view.size.width
        self.filtered.update(log, WORST[self._worst][0], width, self.words)

    def heading(self) -> Row:
        """Return the number of lines, the filter and the search."""
        is_following, shown = self.list_view.following, len(self.filtered.lines)
        follows = Span("following", "ok") if is_following else Span("paused (f follows)", "caution")
        levels = WORST[self._worst][1]
        lines = self.filtered.lines
        unit = f"{zone_words(lines[-1])}, " if lines else ""
        filtered = self.filter_spans(shown, len(self.interface.station.log))
        counts = faint(f" {unit}{levels}, " if filtered else f" {shown} lines, {unit}{levels}, ")
        found = f"   find {self._find_words!r}" if self._find_words else ""
        return row(counts, follows, *filtered, Span(found, "accent"))

    def following_keys(self) -> tuple[NextKey, ...]:
        """Return the keys of the filter, and those whose state the key bar names."""
        following = "on" if self.list_view.following else "off"
        return (
            *super().following_keys(),
            NextKey("log-follow", f"Follow: {following}"),
            NextKey("sort", f"Sort: {self.filtered.heads.order_words}"),
        )

    def actions(self) -> Mapping[str, Action]:
        """Return the actions that are possible now, by id."""
        above = super().actions()
        return {
            **above,
            **{id: partial(self.scroll, above[id]) for id in SCROLLING},
            **dict.fromkeys(("row-up", "filter-up"), partial(self.choose_beside, -1)),
            **dict.fromkeys(("row-down", "filter-down"), partial(self.choose_beside, 1)),
            "sort": self.filtered.heads.sort_by_next,
            "sort-turn": self.filtered.heads.turn,
            "log-follow": self.follow,
            "log-severity": self.next_severity,
            "find-next": partial(self.step, 1),
            "find-before": partial(self.step, -1),
        }

    def scroll(self, move: Action) -> None:
        """Scroll; no line is chosen any more."""
        self._at = None
        move()

    def choose_beside(self, step: int) -> None:
        """Choose the line after (1) or before (-1) the chosen one; the last one is followed."""
        parts, view = self.filtered.parts, self.list_view
        if self._at is None and not view.following and parts:
            edge = view.line_at(0 if step > 0 else view.size.height - 1)
            self._at = parts[min(edge, len(parts) - 1)].line
        self._at = self.filtered.beside(self._at, step)
        if self._at is None or (step > 0 and self._at is self.filtered.lines[-1]):
            self._at, self.list_view.following = None, True
        else:
            self.list_view.reveal(self.filtered.row_of(self._at))

    def on_click(self, event: events.Click) -> None:
        """Choose the line that was clicked."""
        if event.widget is self.list_view:
            row = self.list_view.line_at(event.y)
            if row < len(self.filtered.parts):
                self._at, self.list_view.following = self.filtered.parts[row].line, False
                self.redraw()

    def row_text(self) -> str:
        """Return the chosen line, else the newest one."""
        line = self._at or (self.filtered.lines[-1] if self.filtered.lines else None)
        return "" if line is None else f"{words_of(lead_of(line)).strip()} {line.text}"

    def follow(self) -> None:
        """Follow the newest line, or pause."""
        self._at = None
        self.list_view.following = not self.list_view.following

    def next_severity(self) -> None:
        """Switch to the next least severity."""
        self._worst = (self._worst + 1) % len(WORST)

    def find(self, words: str) -> None:
        """Find the last line with these words; `n` continues from there."""
        self._find_words, self._at = words, None
        self.filter_log()
        self.step(-1)

    def step(self, step: int) -> None:
        """Move to the next match (1) or the one before (-1), around the end."""
        if not self._find_words:
            self.interface.note("nothing to find: type find TEXT, or / to filter the log")
            return
        self._at = self.filtered.find(self._find_words, self._at, step)
        if self._at is None:
            self.interface.note(f"no line contains {self._find_words!r}")
            return
        self.list_view.go(self.filtered.row_of(self._at))
        self.redraw()
