"""Share the Drive screen between the map, the values and the log."""

from math import ceil
from typing import Final, NamedTuple

from ground.map.canvas import DOTS_HIGH, DOTS_WIDE
from ground.map.view import MARGIN_DOTS

LEAST_SIDE: Final = 34
LEAST_WIDE_SIDE: Final = 44
"""The least columns of the values, border included."""
WIDE: Final = 110
LEAST_ROWS_BESIDE: Final = 22
"""From so many columns and rows on, the log is beside the map."""
LEAST_MAP: Final = 24
LOG: Final = 4
LOG_BESIDE: Final = 7
TALL: Final = 27
TALL_LOG: Final = 10
EXPLAINED: Final = 11
"""Rows of the log, its border included; the last is with an explanation instead of the log."""

Size = tuple[float, float]


class DriveLayout(NamedTuple):
    """Columns of the map, and rows of the lower part; `beside`: the map has all rows."""

    map_columns: int
    lower_rows: int
    beside: bool


def drive_layout(
    columns: int, rows: int, floor_m: Size | None, *, explaining: bool = False
) -> DriveLayout:
    """Return the layout that leaves a map of this floor as little empty space as possible."""
    beside = columns >= WIDE and rows >= LEAST_ROWS_BESIDE
    lower = LOG_BESIDE if beside else TALL_LOG if rows >= TALL else LOG
    lower = max(lower, EXPLAINED) if explaining else lower
    map_rows = rows if beside else rows - lower
    room = columns - (LEAST_WIDE_SIDE if beside else LEAST_SIDE)
    wanted = room if floor_m is None else columns_for(floor_m, map_rows)
    return DriveLayout(max(LEAST_MAP, min(wanted, room)), lower, beside)


def columns_for(floor_m: Size, rows: int) -> int:
    """Return the columns that a map of so many rows fills with this floor, legend excluded."""
    width_m, height_m = floor_m
    if not (width_m > 0.0 and height_m > 0.0):
        return LEAST_MAP
    down = DOTS_HIGH * (rows - 1) - 2 * MARGIN_DOTS
    return ceil((max(1, down) * width_m / height_m + 2 * MARGIN_DOTS) / DOTS_WIDE)
