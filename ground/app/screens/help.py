"""Show the keys that are active now."""

from collections.abc import Sequence
from typing import ClassVar, Final

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.screen import ModalScreen

from ground.app.input.default_keys import KeyBinding
from ground.app.input.keymap import shown
from ground.app.widgets.lines import Lines
from ground.app.widgets.rows import Row, Span, faint, row

WIDTH: Final = 72


class HelpScreen(ModalScreen[None]):
    """A dialog that scrolls by arrows; Escape, q, ?, F1 and Enter close it. The stop keys work."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up,k", "move(-1)"),
        Binding("down,j", "move(1)"),
        Binding("pageup", "move(-10)"),
        Binding("pagedown", "move(10)"),
        Binding("escape,q,question_mark,f1,enter", "dismiss"),
    ]
    AUTO_FOCUS = ""

    def __init__(self, keys: Sequence[KeyBinding]) -> None:
        super().__init__()
        self._rows = help_rows(keys)
        self._top = 0

    def compose(self) -> ComposeResult:
        """Compose the list of keys."""
        yield Lines(id="help", classes="box")

    def on_mount(self) -> None:
        """Draw the list."""
        self.show()

    def on_resize(self) -> None:
        """Draw the list in the new size."""
        self.show()

    def show(self) -> None:
        """Draw the rows that fit."""
        box = self.query_one(Lines)
        box.styles.height = min(len(self._rows) + 2, max(3, self.size.height - 2))
        box.styles.width = min(WIDTH, max(10, self.size.width - 2))
        self.query_one(Lines).show(self._rows[self._top :])

    def action_move(self, step: int) -> None:
        """Scroll by rows."""
        last = max(0, len(self._rows) - self.query_one(Lines).size.height)
        self._top = max(0, min(last, self._top + step))
        self.show()


def help_rows(keys: Sequence[KeyBinding]) -> list[Row]:
    """Return the keys, grouped by layer."""
    rows: list[Row] = []
    layer = None
    for key in keys:
        if key.layer is not layer:
            layer = key.layer
            rows += (
                [(), row(Span(f" {layer.value}", "accent"))]
                if rows
                else [row(Span(f" {layer.value}", "accent"), faint("   arrows scroll, esc closes"))]
            )
        rows.append(row(Span(f" {shown(key.keys):>18}", "key"), Span(f"  {key.description}")))
    return rows
