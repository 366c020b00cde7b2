"""A screen with something longer than itself: arrows, pages and ends move through it."""

from abc import abstractmethod
from collections.abc import Mapping
from functools import partial
from typing import ClassVar, Final

from textual.app import ComposeResult

from ground.app.input.key_table import Layer
from ground.app.screens.app_screen import Action, AppScreen
from ground.app.widgets.lines import Lines
from ground.app.widgets.list_view import ListView
from ground.app.widgets.log_view import LogView

TO_THE_END: Final = 1_000_000


class ScrolledScreen(AppScreen):
    @property
    @abstractmethod
    def list_view(self) -> ListView | LogView:
        """What the keys move through."""

    def key_layers(self) -> tuple[Layer, ...]:
        above = super().key_layers()
        return above if self.typing else (Layer.LIST, *above)

    def actions(self) -> Mapping[str, Action]:
        move, page = self.list_view.move, max(1, self.list_view.size.height - 1)
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

    def compose_content(self) -> ComposeResult:
        yield Lines(id="heading")
        yield ListView(id="rows")
        yield Lines(id="about")

    @property
    def list_view(self) -> ListView:
        return self.query_one(ListView)
