"""A screen that is a heading, a list to choose from, and something about what is chosen."""

from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from textual.app import ComposeResult

from ground.app.screens.listed import Listed
from ground.app.screens.sheet import Action
from ground.widgets.lines import Lines
from ground.widgets.table import Table


class Listing(Listed):
    focus_first: ClassVar[str] = "#rows"

    def middle(self) -> ComposeResult:
        yield Lines(id="heading")
        yield Table(id="rows")
        yield Lines(id="about")

    @property
    def listed(self) -> Table:
        return self.query_one(Table)

    @abstractmethod
    def choose(self) -> None:
        """Enter, on the chosen row."""

    def actions(self) -> Mapping[str, Action]:
        return {**super().actions(), "row-choose": self.choose}
