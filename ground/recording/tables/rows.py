"""Turn a recording into a table: long (a row per value) or wide (a row per instant).

A wide table is sampled on a fixed grid. A column holds the last value that arrived, and is empty
when that value is older than its topic's stale-after time. An event is in one row only, the next
one after its arrival. Where stamps jump, as after a restart of the plant, another grid begins.
"""

from collections.abc import Iterable, Iterator
from math import ceil, floor
from typing import Final, NamedTuple

from ground.recording.tables.message_fields import FieldValue, fields_of
from ground.recording.tables.time_axis import Timed
from protocol.topics import TOPICS
from protocol.wire.message import LAYOUT, Message
from runtime.units import NS_PER_MS

STALE_S: Final = {topic.path: topic.stale_after_ns / NS_PER_MS / 1000.0 for topic in TOPICS}
SEVERAL: Final = frozenset(topic.path for topic in TOPICS if len(topic.messages) > 1)
DEFAULT_RATE_HZ: Final = 20.0
EPSILON: Final = 1e-9
MAX_BACK_S: Final = 1.0
MAX_AHEAD_S: Final = 600.0
"""Limits on the distance of stamps within one run."""


class Column(NamedTuple):
    """A column; `kind` is that of its values."""

    name: str
    kind: str


Row = list[str | None]
"""Values as text; None is an empty cell."""

LONG: Final = (
    Column("time_s", "float"),
    Column("utc_s", "float"),
    Column("topic", "text"),
    Column("message", "text"),
    Column("field", "text"),
    Column("value", "text"),
)
TIME: Final = LONG[0]


def name_in_dialect(message: Message) -> str:
    """Return the name of a message in the dialect."""
    return LAYOUT[type(message).__name__].name


def long_rows(timed: Iterable[Timed]) -> Iterator[Row]:
    """Yield a row for each field of each message."""
    for one in timed:
        times = f"{one.time_s:.6f}", f"{one.utc_s:.6f}"
        for cell in fields_of(one.message):
            yield [*times, one.path, name_in_dialect(one.message), cell.name, cell.text]


def wide_columns(timed: Iterable[Timed]) -> list[Column]:
    """Return time and a column for each field that occurs, in the order of the topics."""
    order = {topic.path: place for place, topic in enumerate(TOPICS)}
    found: dict[tuple[str, type[Message]], list[Column]] = {}
    for one in timed:
        kind = one.path, type(one.message)
        if kind not in found:
            found[kind] = [
                Column(name_of(one.path, one.message, cell), cell.kind)
                for cell in fields_of(one.message)
            ]
    ranked = sorted(found, key=lambda kind: (order.get(kind[0], len(order)), kind[1].__name__))
    return [TIME, *(column for kind in ranked for column in found[kind])]


def name_of(path: str, message: Message, cell: FieldValue) -> str:
    """Return a column name such as `tlm/odometry.x_m`, with the message if needed."""
    which = f".{name_in_dialect(message)}" if path in SEVERAL else ""
    return f"{path}{which}.{cell.name}"


class _Newest(NamedTuple):
    """Time of arrival, end of validity, and the texts by column of a message."""

    came_s: float
    until_s: float
    cells: dict[int, str]


def wide_rows(
    timed: Iterable[Timed], columns: list[Column], rate_hz: float = DEFAULT_RATE_HZ
) -> Iterator[Row]:
    """Yield a row for each instant of the grid between the first and the last message."""
    place_of = {column.name: place for place, column in enumerate(columns)}
    newest: dict[tuple[str, type[Message]], _Newest] = {}
    step: int | None = None
    for one in timed:
        if step is not None and not -MAX_BACK_S < one.time_s - step / rate_hz < MAX_AHEAD_S:
            yield _row(step / rate_hz, newest, len(columns))
            newest.clear()
            step = None
        if step is None:
            step = floor(one.time_s * rate_hz + EPSILON)
        while step / rate_hz < one.time_s - EPSILON:
            yield _row(step / rate_hz, newest, len(columns))
            step += 1
        cells = {
            place_of[name_of(one.path, one.message, cell)]: cell.text
            for cell in fields_of(one.message)
        }
        until_s = one.time_s + STALE_S.get(one.path, 0.0)
        if not STALE_S.get(one.path):  # an event: shown in the next row, and in no other
            until_s = ceil(one.time_s * rate_hz - EPSILON) / rate_hz
        newest[one.path, type(one.message)] = _Newest(one.time_s, until_s, cells)
    if step is not None:
        yield _row(step / rate_hz, newest, len(columns))


def _row(time_s: float, newest: dict[tuple[str, type[Message]], _Newest], width: int) -> Row:
    row: Row = [None] * width
    row[0] = f"{time_s:.6f}"
    for value in newest.values():
        if value.came_s <= time_s + EPSILON and time_s <= value.until_s + EPSILON:
            for place, text in value.cells.items():
                row[place] = text
    return row
