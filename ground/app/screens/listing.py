"""A screen that is a heading, a list to choose from, and something about what is chosen."""

from collections.abc import Mapping
from functools import partial
from typing import ClassVar

from textual.app import ComposeResult

from ground.app.keys import Layer
from ground.app.screens.sheet import Action, Sheet
from ground.widgets.lines import Lines
from ground.widgets.table import Table


class Listing(Sheet):
    focus_first: ClassVar[str] = "#rows"

    def middle(self) -> ComposeResult:
        yield Lines(id="heading")
        yield Table(id="rows")
        yield Lines(id="about")

    @property
    def table(self) -> Table:
        return self.query_one(Table)

    def key_layers(self) -> tuple[Layer, ...]:
        above = super().key_layers()
        return above if self.typing else (Layer.LIST, *above)

    def choose(self) -> None:
        """Enter, on the chosen row."""

    def actions(self) -> Mapping[str, Action]:
        move, page = self.table.move, max(1, self.table.size.height - 1)
        return {
            **super().actions(),
            "row-up": partial(move, -1),
            "row-down": partial(move, 1),
            "page-up": partial(move, -page),
            "page-down": partial(move, page),
            "row-first": partial(move, -100_000),
            "row-last": partial(move, 100_000),
            "row-choose": self.choose,
        }
