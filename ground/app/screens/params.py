"""Show the Params screen: filter, compare and change the robot's parameters."""

from collections.abc import Mapping
from functools import partial
from math import isclose
from typing import Final

from ground.app.app_interface import AppInterface
from ground.app.input.keymap import Layer
from ground.app.lists.table import Column, Table
from ground.app.panels.aged import number
from ground.app.screens.app_screen import Action
from ground.app.screens.list_screen import ListScreen
from ground.app.widgets.rows import Row, Span, faint, head, row
from ground.client.parameter import Parameter
from ground.client.vocabulary import value_in_words, value_words
from ground.commands.param import SetParameter
from ground.console.completion import Assistance
from ground.station.station import Station
from protocol.wire.enums import Severity
from runtime.errors import UserError

ABOUT_ROWS: Final = 3


class ParamsScreen(ListScreen[Parameter]):
    """The list of all parameters; an incomplete list is not shown."""

    key_layer = Layer.PARAMS

    def __init__(self, interface: AppInterface) -> None:
        super().__init__(interface, Table(COLUMNS, key=lambda one: one.name))
        self._only_different = False

    def draw(self) -> None:
        """Draw the list and the details of the chosen parameter."""
        station = self.interface.station
        listed = [
            one for one in station.parameters or () if differs(one) or not self._only_different
        ]
        self.draw_rows(listed, heading_row(station, self._only_different))
        about = self.lines("about")
        about.styles.height = ABOUT_ROWS + 1
        about.show(about_rows(self.chosen))

    def actions(self) -> Mapping[str, Action]:
        """Return the actions that are possible now, by id."""
        return {
            **super().actions(),
            **dict.fromkeys(("param-edit", "row-choose"), self.change),
            "param-default": self.reset,
            "param-diff": self.differing,
            "param-read": self.interface.station.reread,
        }

    def differing(self) -> None:
        """Show only changed parameters, or all."""
        self._only_different = not self._only_different
        self.list_view.at = 0

    def change(self) -> None:
        """Let the operator type a value for the chosen parameter."""
        one = self.chosen
        if one is not None:
            hint = f"{range_words(one)} {one.unit}".strip()
            assist = partial(hinted, f"{hint}, now {value_words(one.name, one.value)}")
            self.ask(f"set {one.name}", "", partial(self.set, one.name), assist)

    def set(self, name: str, value: str) -> None:
        """Set a parameter to the value that was typed, a number or a name."""
        if not value:
            return
        line = f"set {name} {value}"
        try:
            command = SetParameter(name=name, value=value_in_words(name, value))
        except UserError as error:
            self.interface.station.note(f"{line}: {error}", Severity.WARNING)
        else:
            self.interface.commands.perform(command, line)

    def row_text(self) -> str:
        """Return the command that sets the chosen parameter to its present value."""
        one = self.chosen
        return "" if one is None else f"param set {one.name} {shown(one.value)}"

    def reset(self) -> None:
        """Let the operator confirm the default of the chosen parameter."""
        one = self.chosen
        if one is not None and one.default is not None:
            default = shown_as(one, one.default)
            self.ask(f"set {one.name}", default, partial(self.set, one.name))


def hinted(hint: str, text: str) -> Assistance:
    """Return a hint for an empty line."""
    return Assistance(hint="" if text else hint)


def heading_row(station: Station, only_different: bool) -> Row:
    """Return the number of parameters, or that the list is incomplete."""
    if station.parameters is None:
        return row(Span(f" {station.parameters_words}", "caution"))
    different = sum(map(differs, station.parameters))
    spans = [
        Span(f" {len(station.parameters)} parameters, "),
        Span(f"{different} changed", "accent"),
    ]
    if only_different:
        spans.append(Span("   only those changed", "caution"))
    return row(*spans)


def differs(one: Parameter) -> bool:
    """Return whether a parameter differs from its default."""
    return one.default is not None and not isclose(
        one.value, one.default, rel_tol=1e-6, abs_tol=1e-12
    )


def shown(value: float | None) -> str:
    """Format a value."""
    return str(value) if value is None else number(value, ".6g")


def shown_as(one: Parameter, value: float | None) -> str:
    """Format a value of a parameter, by its name if it has one."""
    return shown(value) if value is None else value_words(one.name, value)


def range_words(one: Parameter) -> str:
    """Return the range of a parameter."""
    return f"{shown(one.minimum)} to {shown(one.maximum)}"


COLUMNS: Final = (
    Column[Parameter]("name", 16, lambda one: one.name),
    Column[Parameter](
        "changed", 7, lambda one: "* yes" if differs(one) else "", role=lambda _: "caution"
    ),
    Column[Parameter](
        "value", 10, lambda one: value_words(one.name, one.value), lambda one: one.value,
        lambda one: "caution" if differs(one) else "text", numeric=True,
    ),
    Column[Parameter](
        "default", 10, lambda one: shown_as(one, one.default), lambda one: one.default,
        lambda _: "faint", numeric=True,
    ),
    Column[Parameter]("unit", 6, lambda one: one.unit, role=lambda _: "head"),
    Column[Parameter]("range", 13, range_words, lambda one: one.maximum, lambda _: "faint"),
    Column[Parameter]("meaning", 0, lambda one: one.doc),
)  # fmt: skip


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
            shown_as(one, one.default),
        ),
        row(head(" kept    "), Span(kept)),
    ]
