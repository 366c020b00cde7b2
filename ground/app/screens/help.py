"""Show the help in a pane that scrolls."""

from collections.abc import Sequence
from typing import ClassVar, Final

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.screen import ModalScreen

from ground.app.chrome.help_rows import Section
from ground.app.widgets.lines import Lines
from ground.app.widgets.rows import Row, Span, faint, row

WIDTH: Final = 90
HOW: Final = "   arrows scroll, tab: next part, esc closes"


class HelpScreen(ModalScreen[None]):
    """A pane of sections; `at` is the title of the one to begin with. The stop keys work."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up,k", "move(-1)"),
        Binding("down,j", "move(1)"),
        Binding("pageup", "move(-10)"),
        Binding("pagedown", "move(10)"),
        Binding("home", "move(-10000)"),
        Binding("end", "move(10000)"),
        Binding("tab,n", "part(1)"),
        Binding("shift+tab,N", "part(-1)"),
        Binding("escape,q,question_mark,f1,enter", "dismiss"),
    ]
    AUTO_FOCUS = ""

    def __init__(self, sections: Sequence[Section], at: str = "") -> None:
        super().__init__()
        self._rows: list[Row] = []
        self._parts: dict[str, int] = {}
        for title, rows in sections:
            self._parts[title] = len(self._rows)
            how = "" if self._rows else HOW
            self._rows += [row(Span(f" {title}", "accent"), faint(how)), *rows, ()]
        self._top = self._parts.get(at, 0)

    def compose(self) -> ComposeResult:
        """Compose the pane."""
        yield Lines(id="help", classes="box")

    def on_mount(self) -> None:
        """Draw the rows."""
        self.show()

    def on_resize(self) -> None:
        """Draw the rows in the new size."""
        self.show()

    def show(self) -> None:
        """Draw the rows that fit."""
        box = self.query_one(Lines)
        box.styles.height = min(len(self._rows) + 2, max(3, self.size.height - 2))
        box.styles.width = min(WIDTH, max(10, self.size.width - 2))
        box.show(self._rows[self._top :])

    def action_move(self, step: int) -> None:
        """Scroll by rows."""
        last = max(0, len(self._rows) - self.query_one(Lines).size.height)
        self._top = max(0, min(last, self._top + step))
        self.show()

    def action_part(self, step: int) -> None:
        """Scroll to the next part (1) or the one before (-1)."""
        places = list(self._parts.values())
        there = [at for at in places if (at - self._top) * step > 0]
        if there:
            self._top = there[0] if step > 0 else there[-1]
            self.show()

    def on_mouse_scroll_up(self, event: events.MouseScrollUp) -> None:
        """Scroll up."""
        event.stop()
        self.action_move(-3)

    def on_mouse_scroll_down(self, event: events.MouseScrollDown) -> None:
        """Scroll down."""
        event.stop()
        self.action_move(3)
