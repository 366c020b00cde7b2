"""Links: processes, streams, rates, loss, round trip, restarts, and who holds the lease."""

from collections.abc import Mapping
from functools import partial
from typing import ClassVar

from textual.app import ComposeResult

from ground.app.faces.links import link_rows
from ground.app.keys import Layer
from ground.app.screens.sheet import Action, Sheet
from ground.widgets.log_view import LogView
from ground.widgets.rows import Row


class LinksScreen(Sheet):
    focus_first: ClassVar[str] = "#lines"

    def middle(self) -> ComposeResult:
        yield LogView(id="lines")

    def on_mount(self) -> None:
        self.view.following = False
        super().on_mount()

    @property
    def view(self) -> LogView:
        return self.query_one(LogView)

    def draw(self) -> None:
        self.view.window(link_rows(self.deck.station), as_it_is)

    def key_layers(self) -> tuple[Layer, ...]:
        above = super().key_layers()
        return above if self.typing else (Layer.LIST, *above)

    def actions(self) -> Mapping[str, Action]:
        return {
            **super().actions(),
            "row-up": partial(self.view.scroll, -1),
            "row-down": partial(self.view.scroll, 1),
            "page-up": partial(self.view.scroll, -10),
            "page-down": partial(self.view.scroll, 10),
        }


def as_it_is(one: Row) -> Row:
    return one
