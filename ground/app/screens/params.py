"""Show the Params screen: find, compare and change the robot's parameters."""

from collections.abc import Mapping
from functools import partial
from math import isclose
from typing import Final

from ground.app.input.default_keys import Layer
from ground.app.panels.aged import number
from ground.app.playback.app_interface import AppInterface
from ground.app.screens.app_screen import Action
from ground.app.screens.list_screen import ListScreen
from ground.app.widgets.rows import Row, Span, faint, head, row
from ground.client.operations import SetParameter
from ground.client.parameter import Parameter
from ground.station.station import Station

ABOUT_ROWS: Final = 3


class ParamsScreen(ListScreen):
    """The list of all parameters; an incomplete list is not shown."""

    key_layer = Layer.PARAMS

    def __init__(self, interface: AppInterface) -> None:
        super().__init__(interface)
        self._words = ""
        self._only_different = False

    def found(self) -> list[Parameter]:
        """Return the parameters that match the search."""
        wanted = self._words.casefold()
        return [
            one
            for one in self.interface.station.parameters or ()
            if wanted in f"{one.name} {one.doc}".casefold()
            and (differs(one) or not self._only_different)
        ]

    @property
    def chosen(self) -> Parameter | None:
        """The chosen parameter, if any."""
        found = self.found()
        return found[self.list_view.at] if self.list_view.at < len(found) else None

    def draw(self) -> None:
        """Draw the list and the details of the chosen parameter."""
        station, found = self.interface.station, self.found()
        heading = heading_row(station, len(found), self._words, self._only_different)
        self.lines("heading").show([heading])
        self.list_view.window(found, parameter_row)
        about = self.lines("about")
        about.styles.height = ABOUT_ROWS + 1
        about.show(about_rows(self.chosen))

    def actions(self) -> Mapping[str, Action]:
        """Return the actions that are possible now, by id."""
        return {
            **super().actions(),
            "find": partial(self.ask, "find", self._words, self.find),
            **dict.fromkeys(("param-edit", "row-choose"), self.change),
            "param-default": self.reset,
            "param-diff": self.differing,
            "param-read": self.interface.station.reread,
        }

    def find(self, words: str) -> None:
        """Show parameters with these words; empty words show all."""
        self._words = words.strip()
        self.list_view.at = 0

    def differing(self) -> None:
        """Show only changed parameters, or all."""
        self._only_different = not self._only_different
        self.list_view.at = 0

    def change(self) -> None:
        """Let the operator type a value for the chosen parameter."""
        one = self.chosen
        if one is not None:
            self.ask(f"set {one.name}", "", partial(self.set, one.name))

    def set(self, name: str, value: str) -> None:
        """Set a parameter to the value that was typed."""
        if value:
            self.interface.commands.run_line(f"set {name} {value}")

    def reset(self) -> None:
        """Set the chosen parameter to its default."""
        one = self.chosen
        if one is not None and one.default is not None:
            self.interface.commands.perform(SetParameter(name=one.name, value=one.default))


def heading_row(station: Station, shown: int, words: str, only_different: bool) -> Row:
    """Return the number of parameters, or that the list is incomplete."""
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
    """Return whether a parameter differs from its default."""
    return one.default is not None and not isclose(
        one.value, one.default, rel_tol=1e-6, abs_tol=1e-12
    )


def parameter_row(one: Parameter, chosen: bool) -> Row:
    """Return the row of a parameter; a changed one has a mark, not only a colour."""
    changed = differs(one)
    name = Span(f" {one.name:<16}", "reverse" if chosen else "text")
    return row(
        name,
        Span(" *" if changed else "  ", "caution"),
        Span(f"{shown(one.value):>11}", "caution" if changed else "text"),
        head(f" {one.unit:<8}"),
        faint(f"{shown(one.default):>10}  "),
        Span(one.doc),
    )


def shown(value: float | None) -> str:
    """Format a value."""
    return str(value) if value is None else number(value, ".6g")


def about_rows(one: Parameter | None) -> list[Row]:
    """Return the details of a parameter."""
    if one is None:
        return [row(faint(" no parameter is chosen"))]
    limits = f"{shown(one.minimum)} to {shown(one.maximum)} {one.unit}"
    whole = ", whole numbers" if one.integer else ""
    kept = "survives a restart" if one.saved else "until the robot restarts"
    return [
        row(Span(f" {one.name}", "accent"), Span(f"  {one.doc}")),
        row(
            head(" range   "),
            Span(f"{limits}{whole}"),
            head("   default "),
            shown(one.default),
        ),
        row(head(" kept    "), Span(kept)),
    ]
