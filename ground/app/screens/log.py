"""Log: everything that was said, found by words, filtered by how bad it is."""

from collections.abc import Mapping
from functools import partial
from typing import ClassVar, Final

from textual.app import ComposeResult

from ground.app.filtered_log import FilteredLog
from ground.app.input.key_table import Layer
from ground.app.playback.app_interface import AppInterface
from ground.app.screens.listed import ScrolledScreen
from ground.app.screens.sheet import Action
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

    def __init__(self, deck: AppInterface) -> None:
        super().__init__(deck)
        self._sifted = FilteredLog()
        self._worst = 0
        self._words = ""
        self._at: Line | None = None

    def middle(self) -> ComposeResult:
        yield Lines(id="heading")
        yield LogView(id="lines")

    @property
    def listed(self) -> LogView:
        return self.query_one(LogView)

    def draw(self) -> None:
        self.read()
        self.lines("heading").show([self.heading()])
        self.listed.window(self._sifted.parts, lambda part: self._sifted.paint(part, self._at))

    def read(self) -> None:
        self._sifted.look(self.deck.station.log, WORST[self._worst][0], self.listed.size.width)

    def heading(self) -> Row:
        follows = Span("following", "ok") if self.listed.following else Span("stays", "caution")
        found = f"   find {self._words!r}" if self._words else ""
        counts = f" {len(self._sifted.lines)} lines, {WORST[self._worst][1]}   "
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
        self.listed.following = not self.listed.following

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
            self.deck.say("find what? press /")
            return
        self._at = self._sifted.find(self._words, self._at, step)
        if self._at is None:
            self.deck.say(f"nothing found: {self._words!r}")
            return
        self.listed.go(self._sifted.row_of(self._at))
        self.look()
