"""Show the Log screen: all events, searched by words and filtered by severity."""

from collections.abc import Mapping
from functools import partial
from typing import ClassVar, Final

from textual.app import ComposeResult

from ground.app.filtered_log import FilteredLog
from ground.app.input.default_keys import Layer
from ground.app.playback.app_interface import AppInterface
from ground.app.screens.app_screen import Action
from ground.app.screens.list_screen import ScrolledScreen
from ground.app.widgets.lines import Lines
from ground.app.widgets.log_view import LogView
from ground.app.widgets.rows import Row, Span, faint, row
from ground.station.history.event_log import LogLine
from protocol.wire.enums import Severity

WORST: Final = (
    (Severity.DEBUG, "everything"),
    (Severity.WARNING, "warnings and errors"),
    (Severity.ERROR, "errors"),
)


class LogScreen(ScrolledScreen):
    """The log, in lines that scroll."""

    key_layer = Layer.LOG
    focus_first: ClassVar[str] = "#lines"

    def __init__(self, interface: AppInterface) -> None:
        super().__init__(interface)
        self._filtered = FilteredLog()
        self._worst = 0
        self._words = ""
        self._at: LogLine | None = None

    def compose_content(self) -> ComposeResult:
        """Compose heading and lines."""
        yield Lines(id="heading")
        yield LogView(id="lines")

    @property
    def list_view(self) -> LogView:
        """The lines."""
        return self.query_one(LogView)

    def draw(self) -> None:
        """Draw the lines in sight."""
        self.filter_log()
        self.lines("heading").show([self.heading()])
        self.list_view.window(
            self._filtered.parts, lambda part: self._filtered.paint(part, self._at)
        )

    def filter_log(self) -> None:
        """Update the filtered log."""
        self._filtered.update(
            self.interface.station.log, WORST[self._worst][0], self.list_view.size.width
        )

    def heading(self) -> Row:
        """Return the number of lines, the filter and the search."""
        follows = Span("following", "ok") if self.list_view.following else Span("paused", "caution")
        found = f"   find {self._words!r}" if self._words else ""
        counts = f" {len(self._filtered.lines)} lines, {WORST[self._worst][1]}   "
        return row(faint(counts), follows, Span(found, "accent"))

    def actions(self) -> Mapping[str, Action]:
        """Return the actions that are possible now, by id."""
        return {
            **super().actions(),
            "log-follow": self.follow,
            "log-severity": self.next_severity,
            "find": partial(self.ask, "find", self._words, self.find),
            "find-next": partial(self.step, 1),
            "find-before": partial(self.step, -1),
        }

    def follow(self) -> None:
        """Follow the newest line, or pause."""
        self.list_view.following = not self.list_view.following

    def next_severity(self) -> None:
        """Switch to the next least severity."""
        self._worst = (self._worst + 1) % len(WORST)

    def find(self, words: str) -> None:
        """Find the last line with these words; `n` continues from there."""
        self._words, self._at = words, None
        self.filter_log()
        self.step(-1)

    def step(self, step: int) -> None:
        """Move to the next match (1) or the one before (-1), around the end."""
        if not self._words:
            self.interface.note("no words to find: press / to enter some")
            return
        self._at = self._filtered.find(self._words, self._at, step)
        if self._at is None:
            self.interface.note(f"no line contains {self._words!r}")
            return
        self.list_view.go(self._filtered.row_of(self._at))
        self.redraw()
