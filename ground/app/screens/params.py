"""Params: all of the robot's parameters or none, found by name, changed, compared with defaults."""

from collections.abc import Mapping
from functools import partial

from ground.app.input.key_table import Layer
from ground.app.panels.params import ABOUT_ROWS, about_rows, differs, heading_row, parameter_row
from ground.app.playback.app_interface import Deck
from ground.app.screens.listing import Listing
from ground.app.screens.sheet import Action
from ground.client.parameter_rows import Row as Parameter


class ParamsScreen(Listing):
    key_layer = Layer.PARAMS

    def __init__(self, deck: Deck) -> None:
        super().__init__(deck)
        self._words = ""
        self._only_different = False

    def found(self) -> list[Parameter]:
        """Those that are searched for."""
        wanted = self._words.casefold()
        return [
            one
            for one in self.deck.station.parameters or ()
            if wanted in f"{one['name']} {one.get('doc', '')}".casefold()
            and (differs(one) or not self._only_different)
        ]

    @property
    def chosen(self) -> Parameter | None:
        found = self.found()
        return found[self.listed.at] if self.listed.at < len(found) else None

    def draw(self) -> None:
        station, found = self.deck.station, self.found()
        heading = heading_row(station, len(found), self._words, self._only_different)
        self.lines("heading").show([heading])
        self.listed.window(found, parameter_row)
        about = self.lines("about")
        about.styles.height = ABOUT_ROWS + 1
        about.show(about_rows(self.chosen))

    def actions(self) -> Mapping[str, Action]:
        return {
            **super().actions(),
            "find": partial(self.ask, "find", self._words, self.find),
            **dict.fromkeys(("param-edit", "row-choose"), self.change),
            "param-default": self.reset,
            "param-diff": self.differing,
            "param-read": self.deck.station.reread,
        }

    def find(self, words: str) -> None:
        """An empty search is one for all."""
        self._words = words.strip()
        self.listed.at = 0

    def differing(self) -> None:
        self._only_different = not self._only_different
        self.listed.at = 0

    def change(self) -> None:
        one = self.chosen
        if one is not None:
            name = str(one["name"])
            self.ask(f"set {name}", "", partial(self.set, name))

    def set(self, name: str, value: str) -> None:
        if value:
            self.deck.give(f"set {name} {value}")

    def reset(self) -> None:
        one = self.chosen
        if one is not None:
            self.deck.give(f"set {one['name']} {one['default']}")
