"""Links: processes, streams, rates, loss, round trip, restarts, and who holds the lease."""

from typing import ClassVar

from textual.app import ComposeResult

from ground.app.panels.links import link_rows
from ground.app.screens.listed import Listed
from ground.app.widgets.log_view import LogView
from ground.app.widgets.rows import Row


class LinksScreen(Listed):
    focus_first: ClassVar[str] = "#lines"

    def middle(self) -> ComposeResult:
        yield LogView(id="lines")

    def on_mount(self) -> None:
        self.listed.following = False
        super().on_mount()

    @property
    def listed(self) -> LogView:
        return self.query_one(LogView)

    def draw(self) -> None:
        self.listed.window(link_rows(self.deck.station), as_it_is)


def as_it_is(one: Row) -> Row:
    return one
