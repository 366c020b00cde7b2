"""Define screens with a list that is longer than the screen."""

from abc import abstractmethod
from collections.abc import Mapping
from functools import partial
from typing import ClassVar, Final

from textual.app import ComposeResult

from ground.app.input.default_keys import Layer
from ground.app.screens.app_screen import Action, AppScreen
from ground.app.widgets.lines import Lines
from ground.app.widgets.list_view import ListView
from ground.app.widgets.log_view import LogView

ALL_ROWS: Final = 1_000_000


class ScrolledScreen(AppScreen):
    """A screen that scrolls by arrows, pages and ends."""

    @property
    @abstractmethod
    def list_view(self) -> ListView | LogView:
        """The widget that the keys scroll."""

    def key_layers(self) -> tuple[Layer, ...]:
        """Return the layers of the screen, those for lists first."""
        above = super().key_layers()
        return above if self.typing else (Layer.LIST, *above)

    def actions(self) -> Mapping[str, Action]:
        """Return the actions of the screen, with those that scroll."""
        move, page = self.list_view.move, max(1, self.list_view.size.height - 1)
        return {
            **super().actions(),
            "row-up": partial(move, -1),
            "row-down": partial(move, 1),
            "page-up": partial(move, -page),
            "page-down": partial(move, page),
            "row-first": partial(move, -ALL_ROWS),
            "row-last": partial(move, ALL_ROWS),
        }


class ListScreen(ScrolledScreen):
    """A heading, a list to choose from, and details of the chosen row."""

    focus_first: ClassVar[str] = "#rows"

    def compose_content(self) -> ComposeResult:
        """Compose heading, list and details."""
        yield Lines(id="heading")
        yield ListView(id="rows")
        yield Lines(id="about")

    @property
    def list_view(self) -> ListView:
        """The list."""
        return self.query_one(ListView)
