"""Define screens with a list that is longer than the screen."""

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import ClassVar, Final, Generic, TypeVar

from textual.app import ComposeResult
from textual.widgets import Input

from ground.app.app_interface import AppInterface
from ground.app.chrome.key_bar import NextKey, keys_when
from ground.app.input.key_queue import SecondPress, confirmation
from ground.app.input.keymap import Layer, Situation
from ground.app.lists.table import ColumnHeads, Table, filter_spans, hidden_spans, nothing_row
from ground.app.screens.app_screen import Action, AppScreen
from ground.app.widgets.lines import Lines, ListView, LogView
from ground.app.widgets.rows import Row
from ground.console.app_commands import Undo

T = TypeVar("T")
ALL_ROWS: Final = 1_000_000
PROMPT: Final = "filter"


class ScrolledScreen(AppScreen):
    """A screen that scrolls by arrows, pages and ends, and whose rows can be filtered.

    While a filter is typed, no single key is a command. The filter stays until Escape clears it.
    """

    def __init__(self, interface: AppInterface) -> None:
        super().__init__(interface)
        self._kept_words = ""
        self._is_filtering = False
        self._undoing = SecondPress(lambda: interface.station.time_s)

    @property
    @abstractmethod
    def list_view(self) -> ListView | LogView:
        """The widget that the keys scroll."""

    @property
    def filtering(self) -> bool:
        """True while a filter is typed."""
        return self._is_filtering and self.typing

    @property
    def words(self) -> str:
        """The words of the filter."""
        return (self.command_line.value if self._is_filtering else self._kept_words).strip()

    def key_layers(self) -> tuple[Layer, ...]:
        """Return the layers of the screen, those for lists first."""
        if self.filtering:
            return (Layer.FILTER,)
        above = super().key_layers()
        return above if self.typing else (Layer.LIST, *above)

    def actions(self) -> Mapping[str, Action]:
        """Return the actions of the screen, with those that scroll."""
        move, page = self.list_view.move, max(1, self.list_view.size.height - 1)
        return {
            **super().actions(),
            "find": self.begin_filter,
            "undo-here": self.undo,
            "copy": self.copy_row,
            "filter-drop": self.clear_filter,
            **dict.fromkeys(("row-up", "filter-up"), partial(move, -1)),
            **dict.fromkeys(("row-down", "filter-down"), partial(move, 1)),
            "page-up": partial(move, -page),
            "page-down": partial(move, page),
            "row-first": partial(move, -ALL_ROWS),
            "row-last": partial(move, ALL_ROWS),
        }

    def undo(self) -> None:
        """Take back the last change at the second press."""
        if self._undoing.is_second():
            self.interface.commands.perform(Undo())
        else:
            key = self.interface.key_shown("undo-here")
            self.interface.note(confirmation(key, "undo the last change"))

    def row_text(self) -> str:
        """Return the chosen row as text for the clipboard; empty without one."""
        return ""

    def copy_row(self) -> None:
        """Copy the chosen row to the clipboard."""
        text = self.row_text()
        if text:
            self.app.copy_to_clipboard(text)
        self.interface.note(f"copied: {text}" if text else "no row to copy")

    # The filter.

    def prompt(self, words: str, then: Callable[[str], None]) -> None:
        """Show what to type; the filter is not typed any more."""
        self._is_filtering = False
        super().prompt(words, then)

    def begin_filter(self) -> None:
        """Let the operator type a filter; the one before is selected, so typing replaces it."""
        self.ask(PROMPT, self._kept_words, self.keep_filter)
        self.command_line.select_all()
        self._is_filtering = True

    def keep_filter(self, words: str) -> None:
        """Keep the filter that was typed."""
        self._kept_words = words.strip()

    def following_keys(self) -> tuple[NextKey, ...]:
        """Return the keys of the filter; the key that clears it only while there is a filter."""
        first = keys_when(Situation.FILTERED) if self.words else super().following_keys()
        return (*first, *keys_when(Situation.LIST))

    def close_what_is_open(self) -> None:
        """Clear the filter."""
        self.clear_filter()

    def clear_filter(self) -> None:
        """Show all rows again."""
        self._kept_words = ""
        self.leave_line()

    def on_input_changed(self, event: Input.Changed) -> None:
        """Apply the filter at each letter."""
        super().on_input_changed(event)
        if self.filtering:
            self.redraw()

    def filter_spans(self, shown: int, total: int) -> Row:
        """Return the filter and its counts, for the heading."""
        return filter_spans(self.words, shown, total, typing=self.filtering)


class ListScreen(ScrolledScreen, Generic[T]):
    """A heading, a list of columns to choose a row from, and details of the chosen row."""

    focus_first: ClassVar[str] = "#rows"

    def __init__(self, interface: AppInterface, table: Table[T]) -> None:
        super().__init__(interface)
        self.table = table

    def compose_content(self) -> ComposeResult:
        """Compose heading, heads of the columns, list and details."""
        yield Lines(id="heading")
        yield ColumnHeads(self.table, id="columns")
        yield ListView(id="rows")
        yield Lines(id="about")

    @property
    def list_view(self) -> ListView:
        """The list."""
        return self.query_one(ListView)

    @property
    def chosen(self) -> T | None:
        """The chosen row, if any."""
        return self.table.at(self.list_view.at)

    def actions(self) -> Mapping[str, Action]:
        """Return the actions of the screen, with those that sort."""
        return {
            **super().actions(),
            "sort": self.table.sort_by_next,
            "sort-turn": self.table.turn,
        }

    def row_text(self) -> str:
        """Return the cells of the chosen row."""
        one = self.chosen
        return "" if one is None else "  ".join(filter(None, self.table.cells(one).values()))

    def draw_rows(self, items: Sequence[T], about: Row) -> None:
        """Draw the heading with the filter, the heads, and the rows that pass."""
        view = self.list_view
        view.at = self.table.update(items, self.words, view.at)
        counts = self.filter_spans(len(self.table.rows), self.table.total)
        self.query_one(ColumnHeads).draw()
        if self.table.rows or not self.table.total or not self.words:
            view.window(self.table.rows, self.table.paint)
        else:
            view.window((), self.table.paint)
            view.show([nothing_row(self.words)])
        self.lines("heading").show([(*about, *counts, *hidden_spans(*view.hidden))])
