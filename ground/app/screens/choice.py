"""Let the operator choose one of a few, by arrows and Enter or by its number."""

from typing import ClassVar

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.screen import ModalScreen

from ground.app.widgets.lines import Lines
from ground.app.widgets.rows import Row, Span, faint, row


class ChoiceScreen(ModalScreen[str]):
    """A dialog that returns the choice, or "" after Escape. The stop keys work here, too."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up,k", "move(-1)"),
        Binding("down,j", "move(1)"),
        Binding("enter", "take"),
        Binding("escape,q", "dismiss('')"),
    ]
    AUTO_FOCUS = ""

    def __init__(self, title: str, choices: list[str]) -> None:
        super().__init__()
        self._title, self._choices = title, choices
        self._at = 0

    def compose(self) -> ComposeResult:
        """Compose the list of choices."""
        yield Lines(id="choices", classes="box")

    def on_mount(self) -> None:
        """Fit the box to the choices."""
        box = self.query_one(Lines)
        box.styles.width = max(24, *(len(choice) + 8 for choice in [*self._choices, self._title]))
        box.styles.height = len(self._choices) + 4
        self.show()

    def show(self) -> None:
        """Draw the choices."""
        self.query_one(Lines).show([row(Span(f" {self._title}", "accent")), *self.rows()])

    def rows(self) -> list[Row]:
        """Return one row for each choice."""
        return [
            row(faint(f" {number} " if number < 10 else "   "), Span(f" {choice} ", role))
            for number, choice in enumerate(self._choices, start=1)
            for role in ("reverse" if number - 1 == self._at else "text",)
        ]

    def action_move(self, step: int) -> None:
        """Move the selection by a step, around the ends."""
        self._at = (self._at + step) % len(self._choices)
        self.show()

    def action_take(self) -> None:
        """Return the selected choice."""
        self.dismiss(self._choices[self._at])

    def key_by_number(self, number: int) -> None:
        """Return the choice with this number."""
        if 1 <= number <= len(self._choices):
            self.dismiss(self._choices[number - 1])

    def on_key(self, event: events.Key) -> None:
        """Choose by a digit."""
        if event.key.isdigit():
            event.stop()
            self.key_by_number(int(event.key))
