"""A screen that is a heading, a list to choose from, and something about what is chosen."""

from typing import ClassVar

from textual.app import ComposeResult

from ground.app.screens.listed import Listed
from ground.app.widgets.lines import Lines
from ground.app.widgets.table import Table


class Listing(Listed):
    focus_first: ClassVar[str] = "#rows"

    def middle(self) -> ComposeResult:
        yield Lines(id="heading")
        yield Table(id="rows")
        yield Lines(id="about")

    @property
    def listed(self) -> Table:
        return self.query_one(Table)
