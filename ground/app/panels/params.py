"""Parameters as rows: name, value, default, range, and what each is for."""

from math import isclose
from typing import Final

from ground.app.panels.aged import number
from ground.app.widgets.rows import Row, Span, faint, head, row
from ground.client.parameter_rows import Row as Parameter
from ground.station.station import Station

ABOUT_ROWS: Final = 3


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
