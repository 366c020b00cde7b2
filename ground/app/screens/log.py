"""Log: everything that was said, found by words, filtered by how bad it is."""

from collections.abc import Mapping
from functools import partial
from typing import ClassVar, Final

from textual.app import ComposeResult

from ground.app.filtered_log import FilteredLog
from ground.app.input.key_table import Layer
from ground.app.playback.app_interface import AppInterface
from ground.app.screens.app_screen import Action
from ground.app.screens.list_screen import ScrolledScreen
from ground.app.widgets.lines import Lines
from ground.app.widgets.log_view import LogView
from ground.app.widgets.rows import Row, Span, faint, row
from ground.station.history.event_log import Line
from protocol.wire.enums import Severity

WORST: Final = (
    (Severity.DEBUG, "everything"),
    (Severity.WARNING, "warnings and errors"),
    (Severity.ERROR, "errors"),
)


class LogScreen(ScrolledScreen):
    key_layer = Layer.LOG
    focus_first: ClassVar[str] = "#lines"

    def __init__(self, interface: AppInterface) -> None:
        super().__init__(interface)
        self._filtered = FilteredLog()
        self._worst = 0
        self._words = ""
        self._at: Line | None = None

    def compose_content(self) -> ComposeResult:
        yield Lines(id="heading")
        yield LogView(id="lines")

    @property
    def list_view(self) -> LogView:
        return self.query_one(LogView)

    def draw(self) -> None:
        self.read()
        self.lines("heading").show([self.heading()])
        self.list_view.window(
            self._filtered.parts, lambda part: self._filtered.paint(part, self._at)
        )

    def read(self) -> None:
        self._filtered.update(
            self.interface.station.log, WORST[self._worst][0], self.list_view.size.width
        )

    def heading(self) -> Row:
        follows = Span("following", "ok") if self.list_view.following else Span("stays", "caution")
        found = f"   find {self._words!r}" if self._words else ""
        counts = f" {len(self._filtered.lines)} lines, {WORST[self._worst][1]}   "
        return row(faint(counts), follows, Span(found, "accent"))

    def actions(self) -> Mapping[str, Action]:
        return {
            **super().actions(),
            "log-follow": self.follow,
            "log-severity": self.filter,
            "find": partial(self.ask, "find", self._words, self.find),
            "find-next": partial(self.step, 1),
            "find-before": partial(self.step, -1),
        }

    def follow(self) -> None:
        self.list_view.following = not self.list_view.following

    def filter(self) -> None:
        self._worst = (self._worst + 1) % len(WORST)

    def find(self, words: str) -> None:
        """The last line with these words; `n` goes on from there."""
        self._words, self._at = words, None
        self.read()
        self.step(-1)

    def step(self, step: int) -> None:
        """To the next find, round the end."""
        if not self._words:
            self.interface.note("find what? press /")
            return
        self._at = self._filtered.find(self._words, self._at, step)
        if self._at is None:
            self.interface.note(f"nothing found: {self._words!r}")
            return
        self.list_view.go(self._filtered.row_of(self._at))
        self.redraw()
