"""A screen with something longer than itself: arrows, pages and ends move through it."""

from abc import abstractmethod
from collections.abc import Mapping
from functools import partial
from typing import ClassVar, Final

from textual.app import ComposeResult

from ground.app.input.key_table import Layer
from ground.app.screens.sheet import Action, AppScreen
from ground.app.widgets.lines import Lines
from ground.app.widgets.log_view import LogView
from ground.app.widgets.table import Table

TO_THE_END: Final = 1_000_000


class ScrolledScreen(AppScreen):
    @property
    @abstractmethod
    def listed(self) -> Table | LogView:
        """What the keys move through."""

    def key_layers(self) -> tuple[Layer, ...]:
        above = super().key_layers()
        return above if self.typing else (Layer.LIST, *above)

    def actions(self) -> Mapping[str, Action]:
        move, page = self.listed.move, max(1, self.listed.size.height - 1)
        return {
            **super().actions(),
            "row-up": partial(move, -1),
            "row-down": partial(move, 1),
            "page-up": partial(move, -page),
            "page-down": partial(move, page),
            "row-first": partial(move, -TO_THE_END),
            "row-last": partial(move, TO_THE_END),
        }


class ListScreen(ScrolledScreen):
    """A heading, a list to choose from, and details of the chosen row."""

    focus_first: ClassVar[str] = "#rows"

    def middle(self) -> ComposeResult:
        yield Lines(id="heading")
        yield Table(id="rows")
        yield Lines(id="about")

    @property
    def listed(self) -> Table:
        return self.query_one(Table)
