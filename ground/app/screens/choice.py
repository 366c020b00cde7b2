"""Let the operator choose one of a few: by arrows, by number, or by a filter."""

from collections.abc import Callable, Sequence
from typing import ClassVar, Final, NamedTuple

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Input

from ground.app.lists.table import ListFilter, filter_spans, hidden_spans, nothing_row
from ground.app.widgets.command_line import TypedLine
from ground.app.widgets.lines import Lines
from ground.app.widgets.rows import Row, Span, cut, faint, row

KEYS: Final = "Enter takes, / filters, Esc closes"
HIDDEN: Final = 44
"""Columns of a title for the counts of the filter and of the hidden choices."""
AROUND: Final = 6
"""Rows of the screen that the box does not use for choices."""


class Choice(NamedTuple):
    """One choice; `is_current` marks the one in force."""

    name: str
    description: str = ""
    is_current: bool = False


class ChoiceScreen(ModalScreen[str]):
    """A dialog that returns the choice, or "" after Escape. The stop keys work here, too.

    While the filter is typed, letters are text.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up,k", "move(-1)"),
        Binding("down,j", "move(1)"),
        Binding("enter", "take"),
        Binding("slash", "filter"),
        Binding("escape,q", "close"),
    ]
    AUTO_FOCUS = ""

    def __init__(
        self,
        title: str,
        choices: Sequence[str | Choice],
        is_held_back: Callable[[], bool] = lambda: False,
    ) -> None:
        """While `is_held_back` returns True, a click only selects."""
        super().__init__()
        self._title, self._is_held_back = title, is_held_back
        self._every = [Choice(one) if isinstance(one, str) else one for one in choices]
        self._choices, self._filtered_by = self._every, ""
        self._at = next((at for at, one in enumerate(self._every) if one.is_current), 0)

    def compose(self) -> ComposeResult:
        """Compose the list of choices and the filter."""
        with Vertical(id="box", classes="box"):
            yield Lines(id="choices")
            yield TypedLine(lambda _: self.action_take(), id="choice-filter")

    def on_mount(self) -> None:
        """Fit the box to the choices."""
        names = max(len(one.name) for one in self._every)
        about = max(len(one.description) for one in self._every)
        self._wide = names if about else 0
        box = self.query_one("#box")
        head = len(self._title) + (8 if len(self._every) <= self.room() else HIDDEN)
        box.styles.width = max(24, head, len(KEYS) + 4, names + about + 12)
        box.styles.max_width = "100%"
        box.styles.height = self.room() + 4
        self.query_one(Input).display = False
        self.show()

    def room(self) -> int:
        """Return how many choices are in sight."""
        return max(1, min(len(self._every), self.app.size.height - AROUND))

    def first(self) -> int:
        """Return the position of the first visible choice."""
        room = self.room()
        return max(0, min(self._at - room // 2, len(self._choices) - room))

    def show(self) -> None:
        """Draw the choices; rows change in number, the box does not."""
        self.filter_choices()
        panel, words = self.query_one(Lines), self.query_one(Input).value.strip()
        panel.styles.height = self.room() + 2 - self.query_one(Input).display
        counts = filter_spans(words, len(self._choices), len(self._every), typing=False)[:1]
        rows = self.rows() if self._choices else [nothing_row(words)]
        below = max(0, len(self._choices) - self.first() - self.room())
        hidden = hidden_spans(self.first(), below)
        title = row(Span(f" {self._title}", "accent"), *counts, *hidden)
        foot = [] if self.query_one(Input).display else [row(faint(f" {KEYS}"))]
        panel.show([title, *rows, *foot])

    def rows(self) -> list[Row]:
        """Return one row for each choice in sight; a dot marks the one in force."""
        room, first = self.room(), self.first()
        width = self.query_one("#box").size.width or 200
        return [
            cut(
                row(
                    faint(f" {number} " if number < 10 else "   "),
                    Span("● " if one.is_current else "  ", "ok"),
                    Span(f"{one.name:<{self._wide}} ", role),
                    faint(f" {one.description}"),
                ),
                width,
            )
            for number, one in enumerate(self._choices[first : first + room], start=first + 1)
            for role in ("reverse" if number - 1 == self._at else "text",)
        ]

    def action_move(self, step: int) -> None:
        """Move the selection by a step, around the ends."""
        self.filter_choices()
        if self._choices:
            self._at = (self._at + step) % len(self._choices)
            self.show()

    def action_take(self) -> None:
        """Return the selected choice."""
        self.filter_choices()
        if self._choices:
            self.dismiss(self._choices[self._at].name)

    def action_filter(self) -> None:
        """Let the operator type a filter."""
        line = self.query_one(Input)
        line.display = True
        self.set_focus(line)
        self.show()

    def action_close(self) -> None:
        """Clear the filter; without one, return no choice."""
        line = self.query_one(Input)
        if not line.display:
            self.dismiss("")
            return
        line.value, line.display = "", False
        self.set_focus(None)
        self.show()

    def on_input_changed(self, event: Input.Changed) -> None:
        """Show the choices that pass the filter."""
        event.stop()
        self.show()

    def filter_choices(self) -> None:
        """Show only the choices that match the typed filter."""
        words = self.query_one(Input).value
        if words == self._filtered_by:
            return
        self._filtered_by, found = words, ListFilter(words)
        self._choices = [
            one
            for one in self._every
            if found.passes({"name": one.name, "description": one.description})
        ]
        self._at = 0

    def on_click(self, event: events.Click) -> None:
        """Return the choice that was clicked; in an emergency stop only select it."""
        place = event.get_content_offset(self.query_one(Lines))
        if place is None or not 1 <= place.y <= self.room():
            return
        at = self.first() + place.y - 1
        if at < len(self._choices):
            self._at = at
            self.show()
            if not self._is_held_back():
                self.action_take()

    def take_key(self, key: str) -> bool:
        """Choose by a digit."""
        is_number = key.isdigit() and self.focused is None
        if is_number and 1 <= int(key) <= len(self._choices):
            self.dismiss(self._choices[int(key) - 1].name)
        return is_number
