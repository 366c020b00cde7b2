"""Params: all of the robot's parameters or none, found by name, changed, compared with defaults."""

from collections.abc import Mapping
from functools import partial
from math import isclose
from typing import Final

from ground.app.input.key_table import Layer
from ground.app.panels.aged import number
from ground.app.playback.app_interface import AppInterface
from ground.app.screens.listed import ListScreen
from ground.app.screens.sheet import Action
from ground.app.widgets.rows import Row, Span, faint, head, row
from ground.client.parameter_rows import Row as Parameter
from ground.station.station import Station

ABOUT_ROWS: Final = 3


class ParamsScreen(ListScreen):
    key_layer = Layer.PARAMS

    def __init__(self, deck: AppInterface) -> None:
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


def heading_row(station: Station, shown: int, words: str, only_different: bool) -> Row:
    """How many there are, or that they are missing: part of a list is never shown as the list."""
    if station.parameters is None:
        return row(Span(f" {station.parameters_words}", "caution"))
    different = sum(map(differs, station.parameters))
    spans = [
        Span(f" {len(station.parameters)} parameters, "),
        Span(f"{different} changed", "accent"),
    ]
    if words:
        spans.append(Span(f"   find {words!r}: {shown}", "accent"))
    if only_different:
        spans.append(Span("   only those changed", "caution"))
    return row(*spans)


def differs(one: Parameter) -> bool:
    value, default = one["value"], one.get("default")
    if isinstance(value, int | float) and isinstance(default, int | float):
        return not isclose(value, default, rel_tol=1e-6, abs_tol=1e-12)
    return default is not None and value != default


def parameter_row(one: Parameter, chosen: bool) -> Row:
    """A changed one has a mark, not only a colour."""
    changed = differs(one)
    name = Span(f" {one['name']!s:<16}", "reverse" if chosen else "text")
    return row(
        name,
        Span(" *" if changed else "  ", "caution"),
        Span(f"{value_of(one, 'value'):>11}", "caution" if changed else "text"),
        head(f" {one.get('unit', '')!s:<8}"),
        faint(f"{value_of(one, 'default'):>10}  "),
        Span(str(one.get("doc", ""))),
    )


def value_of(one: Parameter, name: str) -> str:
    value = one.get(name)
    return number(value, ".6g") if isinstance(value, int | float) else str(value)


def about_rows(one: Parameter | None) -> list[Row]:
    if one is None:
        return [row(faint(" nothing is chosen"))]
    limits = f"{value_of(one, 'minimum')} to {value_of(one, 'maximum')} {one.get('unit', '')}"
    whole = ", whole numbers" if one.get("integer") else ""
    kept = "survives a restart" if one.get("saved") else "until the robot restarts"
    return [
        row(Span(f" {one['name']}", "accent"), Span(f"  {one.get('doc', '')}")),
        row(
            head(" range   "),
            Span(f"{limits}{whole}"),
            head("   default "),
            value_of(one, "default"),
        ),
        row(head(" kept    "), Span(kept)),
    ]
