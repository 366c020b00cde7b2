"""Log: everything that was said, found by words, filtered by how bad it is."""

from collections.abc import Mapping
from functools import partial
from typing import ClassVar, Final

from textual.app import ComposeResult

from ground.app.deck import Deck
from ground.app.faces.log import log_row
from ground.app.keys import Layer
from ground.app.screens.sheet import Action, Sheet
from ground.station.log import Line
from ground.widgets.lines import Lines
from ground.widgets.log_view import LogView
from ground.widgets.rows import Row, Span, faint, row
from protocol.enums import Severity

WORST: Final = (
    (Severity.DEBUG, "everything"),
    (Severity.WARNING, "warnings and errors"),
    (Severity.ERROR, "errors"),
)


class LogScreen(Sheet):
    key_layer = Layer.LOG
    focus_first: ClassVar[str] = "#lines"

    def __init__(self, deck: Deck) -> None:
        super().__init__(deck)
        self._lines: list[Line] = []
        self._read: tuple[object, ...] = ()
        self._worst = 0
        self._words = ""
        self._at: Line | None = None

    def middle(self) -> ComposeResult:
        yield Lines(id="heading")
        yield LogView(id="lines")

    @property
    def view(self) -> LogView:
        return self.query_one(LogView)

    def draw(self) -> None:
        self.read()
        self.lines("heading").show([self.heading()])
        self.view.window(self._lines, self.paint)

    def read(self) -> None:
        """The lines that pass the filter, anew only when there are new ones."""
        log = self.deck.station.log
        severity = WORST[self._worst][0]
        state = (log, log.total, severity)
        if state == self._read:
            return
        same = self._read[:1] == state[:1] and self._read[2:] == state[2:]
        self._read, before = state, self._read
        if not same:
            self._lines = [line for line in log if line.severity <= severity]
            return
        fresh = log.since(int(str(before[1])))
        self._lines += [line for line in fresh if line.severity <= severity]
        del self._lines[: max(0, len(self._lines) - len(log))]

    def heading(self) -> Row:
        follows = Span("following", "ok") if self.view.following else Span("stays", "caution")
        found = f"   find {self._words!r}" if self._words else ""
        counts = f" {len(self._lines)} lines, {WORST[self._worst][1]}   "
        return row(faint(counts), follows, Span(found, "accent"))

    def paint(self, line: Line) -> Row:
        return log_row(line, found=line is self._at)

    def actions(self) -> Mapping[str, Action]:
        page = max(1, self.view.size.height - 1)
        return {
            **super().actions(),
            "row-up": partial(self.view.scroll, -1),
            "row-down": partial(self.view.scroll, 1),
            "page-up": partial(self.view.scroll, -page),
            "page-down": partial(self.view.scroll, page),
            "row-first": partial(self.view.scroll, -len(self._lines)),
            "row-last": partial(self.view.scroll, len(self._lines)),
            "log-follow": self.follow,
            "log-severity": self.filter,
            "find": partial(self.ask, "find", self._words, self.find),
            "find-next": partial(self.step, 1),
            "find-before": partial(self.step, -1),
        }

    def key_layers(self) -> tuple[Layer, ...]:
        above = super().key_layers()
        return above if self.typing else (Layer.LIST, *above)

    def follow(self) -> None:
        self.view.following = not self.view.following

    def filter(self) -> None:
        self._worst = (self._worst + 1) % len(WORST)

    def find(self, words: str) -> None:
        """The last line with these words; `n` goes on from there."""
        self._words, self._at = words, None
        self.read()
        self.step(-1)

    def step(self, step: int) -> None:
        """To the next find, round the end."""
        wanted = self._words.casefold()
        found = [
            number
            for number, line in enumerate(self._lines)
            if wanted and wanted in f"{line.source} {line.text}".casefold()
        ]
        if not found:
            self.deck.say(f"nothing found: {self._words!r}" if wanted else "find what? press /")
            return
        here = self._lines.index(self._at) if self._at in self._lines else -1
        later = [number for number in found if number > here]
        before = [number for number in found if here < 0 or number < here]
        number = (later or found)[0] if step > 0 else (before or found)[-1]
        self._at = self._lines[number]
        self.view.go(number)
        self.look()
