"""Show a row with parts that can be clicked."""

from collections.abc import Sequence
from typing import NamedTuple

from textual import events

from ground.app.widgets.lines import Lines
from ground.app.widgets.rows import Row, Span, cut, width_of


class Button(NamedTuple):
    """A part of a row; a click runs `action`, such as `do('arm')`, unless it is empty."""

    row: Row
    action: str = ""


def buttons_width(buttons: Sequence[Button]) -> int:
    """Return the width of all buttons in columns."""
    return sum(width_of(one.row) for one in buttons)


class ButtonRow(Lines):
    """A row of buttons from the left, and others at the right end."""

    def __init__(self, *, id: str | None = None) -> None:
        super().__init__(id=id)
        self._buttons: tuple[Button, ...] = ()

    def show_buttons(self, left: Sequence[Button], right: Sequence[Button] = ()) -> None:
        """Show these buttons; the space between both groups is empty."""
        width = self.size.width
        gap = max(0, width - buttons_width(left) - buttons_width(right))
        self._buttons = (*left, Button((Span(" " * gap),)), *right)
        self.show([cut(tuple(span for one in self._buttons for span in one.row), width)])

    def action_at(self, column: int) -> str:
        """Return the action of the button in a column; empty when there is none."""
        end = 0
        for one in self._buttons:
            end += width_of(one.row)
            if column < end:
                return one.action
        return ""

    async def on_click(self, event: events.Click) -> None:
        """Run the action that was clicked, if it is possible now."""
        event.stop()
        action = self.action_at(event.x)
        if action:
            await self.app.run_action(f"clicked({action!r})")
