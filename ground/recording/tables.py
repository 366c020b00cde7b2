"""Turn a recording into a table (CSV, or Parquet with pyarrow) or into time series for plots.

A long table has a row per value. A wide one has a row per instant of a fixed grid: a column holds
the last value that arrived, and is empty when that value is older than its topic's stale-after
time. An event is in one row only, the next one after its arrival. Where stamps jump, as after a
restart of the plant, another grid begins. A range without an echo is empty. A number is the
shortest text of its exact value.

All messages are on one time axis: seconds of the robot's stamps. A message without a stamp gets the
newest stamp before it. Stamps of operators belong to another clock and are ignored.
"""

import csv
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from math import ceil, cos, floor, inf, isfinite, nan, sin, sqrt
from pathlib import Path
from struct import pack
from typing import Any, Final, NamedTuple, TextIO

from ground.recording.log_reader import Log, LoggedFrame
from ground.recording.summary import Bookmark, changes
from protocol.ring import BEARINGS_RAD
from protocol.topics import TOPICS, Role
from protocol.wire.codec import decode
from protocol.wire.message import LAYOUT, Field, Message
from protocol.wire.messages import (
    AvoidanceDecision,
    GroundTruth,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
)
from runtime.errors import RemoteError, UserError
from runtime.units import NS_PER_MS, NS_PER_S


class FieldValue(NamedTuple):
    """One value; `kind` is text, integer, unsigned (64 bits) or float; None means nothing."""

    name: str
    kind: str
    text: str | None


def fields_of(message: Message) -> Iterator[FieldValue]:
    """Yield the fields of a message; each element of an array is a field.

    The dialect gives a range a meaning only where there was an echo: without one it is None.
    """
    silent = ~message.echo if isinstance(message, SonarScan) else 0
    for item in LAYOUT[type(message).__name__].fields:
        value, kind = getattr(message, item.name), kind_of(item)
        if item.is_text or not item.length:
            yield FieldValue(item.name, kind, text_of(item, value))
        else:
            for index, element in enumerate(value):
                is_none = item.name == "range_mm" and silent >> index & 1
                text = None if is_none else text_of(item, element)
                yield FieldValue(f"{item.name}[{index}]", kind, text)


def kind_of(field: Field) -> str:
    """Return the kind of a field."""
    if field.is_text:
        return "text"
    if field.limits is None:
        return "float"
    return "unsigned" if field.code == "Q" else "integer"


def text_of(field: Field, value: object) -> str:
    """Return the shortest text of a value at the precision of the wire."""
    if field.code == "f" and isinstance(value, float) and isfinite(value):
        return shortest_single(value)
    return repr(value) if isinstance(value, float) else str(value)


def shortest_single(value: float) -> str:
    """Return the shortest text of a 32-bit value: 0.1, not 0.10000000149011612."""
    wire = pack("<f", value)
    for digits in range(6, 9):
        text = f"{value:.{digits}g}"
        if pack("<f", float(text)) == wire:
            return text
    return f"{value:.9g}"


OPERATOR_PATHS: Final = tuple(f"/{one.path}" for one in TOPICS if one.publisher is Role.GROUND)


class Timed(NamedTuple):
    """A message, its topic path, its time on the axis, and its time of arrival in UTC."""

    time_s: float
    arrived_ns: int
    path: str
    message: Message


class TimeAxis:
    """Reads a recording once; messages that cannot be decoded are counted in `unreadable`."""

    def __init__(self, log: Log, begin_s: float | None = None, end_s: float | None = None) -> None:
        self.log = log
        self.unreadable = 0
        self._begin_s = float("-inf") if begin_s is None else begin_s
        self._end_s = float("inf") if end_s is None else end_s

    def __iter__(self) -> Iterator[Timed]:
        for timed in self._all():
            if self._begin_s <= timed.time_s <= self._end_s:
                yield timed

    def _all(self) -> Iterator[Timed]:
        unstamped: list[tuple[LoggedFrame, Message]] = []
        newest_ns: int | None = None
        for frame in self.log:
            try:
                message = decode(frame.frame).message
            except RemoteError:
                self.unreadable += 1
                continue
            stamp_ns = newest_ns
            if not frame.key.endswith(OPERATOR_PATHS):
                stamp_ns = getattr(message, "time_ns", newest_ns)
            if stamp_ns is None:
                unstamped.append((frame, message))
                continue
            for before in unstamped:
                yield self._timed(*before, stamp_ns)
            unstamped.clear()
            newest_ns = stamp_ns
            yield self._timed(frame, message, stamp_ns)
        for before in unstamped:
            yield self._timed(*before, 0)

    def _timed(self, frame: LoggedFrame, message: Message, stamp_ns: int) -> Timed:
        path = frame.key.partition(f"/{self.log.robot}/")[2] or frame.key
        return Timed(stamp_ns / NS_PER_S, frame.time_ns, path, message)


STALE_S: Final = {topic.path: topic.stale_after_ns / NS_PER_MS / 1000.0 for topic in TOPICS}
SEVERAL: Final = frozenset(topic.path for topic in TOPICS if len(topic.messages) > 1)
DEFAULT_RATE_HZ: Final = 20.0
EPSILON: Final = 1e-9
MAX_BACK_S: Final = 1.0
MAX_AHEAD_S: Final = 600.0
"""Limits on the distance of stamps within one run."""


class TableColumn(NamedTuple):
    """A column; `kind` is that of its values."""

    name: str
    kind: str


Row = list[str | None]
"""Values as text; None is an empty cell."""

LONG: Final = (
    TableColumn("time_s", "float"),
    TableColumn("utc_s", "float"),
    TableColumn("topic", "text"),
    TableColumn("message", "text"),
    TableColumn("field", "text"),
    TableColumn("value", "text"),
)
TIME: Final = LONG[0]


def name_in_dialect(message: Message) -> str:
    """Return the name of a message in the dialect."""
    return LAYOUT[type(message).__name__].name


def long_rows(timed: Iterable[Timed]) -> Iterator[Row]:
    """Yield a row for each field of each message."""
    for one in timed:
        times = f"{one.time_s:.6f}", f"{one.arrived_ns / NS_PER_S:.6f}"
        for cell in fields_of(one.message):
            yield [*times, one.path, name_in_dialect(one.message), cell.name, cell.text]


def wide_columns(timed: Iterable[Timed]) -> list[TableColumn]:
    """Return time and a column for each field that occurs, in the order of the topics."""
    order = {topic.path: place for place, topic in enumerate(TOPICS)}
    found: dict[tuple[str, type[Message]], list[TableColumn]] = {}
    for one in timed:
        kind = one.path, type(one.message)
        if kind not in found:
            found[kind] = [
                TableColumn(name_of(one.path, one.message, cell), cell.kind)
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
    cells: dict[int, str | None]


def wide_rows(
    timed: Iterable[Timed], columns: list[TableColumn], rate_hz: float = DEFAULT_RATE_HZ
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


GROUP: Final = 10_000


def write_csv(target: TextIO, columns: Sequence[TableColumn], rows: Iterable[Row]) -> int:
    """Write rows as CSV and return their number; an empty cell is an empty text."""
    table = csv.writer(target, lineterminator="\n")
    table.writerow([column.name for column in columns])
    count = 0
    for row in rows:
        table.writerow(["" if cell is None else cell for cell in row])
        count += 1
    return count


def parquet() -> Any:
    """Return pyarrow; the UserError without it names the command that installs it."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        fix = "pip install 'sidestep[study]', or take --format csv"
        raise UserError(f"Parquet needs pyarrow, which is not installed: {fix}") from None
    return pyarrow


def write_parquet(path: Path, columns: Sequence[TableColumn], rows: Iterable[Row]) -> int:
    """Write rows as Parquet, return their number; numbers have 64 bits, empty is null."""
    arrow = parquet()
    types = {
        "text": arrow.string(),
        "integer": arrow.int64(),
        "unsigned": arrow.uint64(),
        "float": arrow.float64(),
    }
    schema = arrow.schema([(column.name, types[column.kind]) for column in columns])
    count = 0
    with arrow.parquet.ParquetWriter(path, schema) as writer:
        source = iter(rows)
        while group := list(islice(source, GROUP)):
            arrays = [
                arrow.array(list(_values(column, place, group)), types[column.kind])
                for place, column in enumerate(columns)
            ]
            writer.write_table(arrow.Table.from_arrays(arrays, schema=schema))
            count += len(group)
    return count


def _values(column: TableColumn, place: int, rows: Iterable[Row]) -> Iterator[str | float | None]:
    for row in rows:
        text = row[place]
        if text is None or column.kind == "text":
            yield text
        else:
            yield float(text) if column.kind == "float" else int(text)


Place = tuple[float, float, float]
"""Metres, metres, radians."""


@dataclass(slots=True)
class TimedValues:
    """Values over time; NaN is a gap."""

    times_s: list[float] = field(default_factory=list)
    values: list[float] = field(default_factory=list)

    def add(self, time_s: float, value: float) -> None:
        """Append a value."""
        self.times_s.append(time_s)
        self.values.append(value)


@dataclass(slots=True)
class RunSeries:
    """Series of a run; `error_m` is the error of the estimate where the truth is known."""

    estimated: list[Place] = field(default_factory=list)
    true: list[Place] = field(default_factory=list)
    covariances: list[tuple[float, float, float]] = field(default_factory=list)
    echoes: list[tuple[float, float]] = field(default_factory=list)
    goals: list[Place] = field(default_factory=list)
    marks: tuple[Bookmark, ...] = ()
    nearest_m: TimedValues = field(default_factory=TimedValues)
    zone_m: TimedValues = field(default_factory=TimedValues)
    speed_m_s: TimedValues = field(default_factory=TimedValues)
    commanded_m_s: TimedValues = field(default_factory=TimedValues)
    yaw_rate_rad_s: TimedValues = field(default_factory=TimedValues)
    sigma_m: TimedValues = field(default_factory=TimedValues)
    error_m: TimedValues = field(default_factory=TimedValues)


def collect_series(timed: Iterable[Timed], radius_m: float) -> RunSeries:
    """Collect the series; `radius_m` of the robot, as sonars measure from its rim."""
    run = RunSeries()
    truths: dict[int, tuple[float, float]] = {}
    statuses: list[tuple[int, Message]] = []
    for one in timed:
        message, time_s = one.message, one.time_s
        if isinstance(message, PlanarOdometry):
            _add_odometry(run, message, time_s)
        elif isinstance(message, GroundTruth):
            run.true.append((message.x_m, message.y_m, message.heading_rad))
            truths[message.time_ns] = (message.x_m, message.y_m)
        elif isinstance(message, SonarScan):
            _add_scan(run, message, time_s, radius_m)
        elif isinstance(message, AvoidanceDecision):
            run.commanded_m_s.add(time_s, message.speed_m_s)
            if isfinite(message.zone_m):
                run.zone_m.add(time_s, message.zone_m)
        elif isinstance(message, NavigatorStatus):
            statuses.append((round(time_s * NS_PER_S), message))
            goal = (message.goal_x_m, message.goal_y_m, message.goal_heading_rad)
            if goal[0] == goal[0] and (not run.goals or run.goals[-1][:2] != goal[:2]):
                run.goals.append(goal)
    run.marks = tuple(changes(statuses))
    run.error_m = _errors(run, truths)
    return run


def _errors(run: RunSeries, truths: dict[int, tuple[float, float]]) -> TimedValues:
    """Return the distance between estimate and truth of the same stamp."""
    errors = TimedValues()
    for time_s, (x_m, y_m, _) in zip(run.speed_m_s.times_s, run.estimated, strict=True):
        true = truths.get(round(time_s * NS_PER_S))
        if true is not None:
            errors.add(time_s, sqrt((true[0] - x_m) ** 2 + (true[1] - y_m) ** 2))
    return errors


def _add_odometry(run: RunSeries, odometry: PlanarOdometry, time_s: float) -> None:
    run.estimated.append((odometry.x_m, odometry.y_m, odometry.heading_rad))
    run.covariances.append((odometry.cov_xx_m2, odometry.cov_xy_m2, odometry.cov_yy_m2))
    run.speed_m_s.add(time_s, odometry.speed_m_s)
    run.yaw_rate_rad_s.add(time_s, odometry.yaw_rate_rad_s)
    variance_m2 = odometry.cov_xx_m2 + odometry.cov_yy_m2
    run.sigma_m.add(time_s, sqrt(max(variance_m2, 0.0)))  # NaN, of an unknown place, is kept


def _add_scan(run: RunSeries, scan: SonarScan, time_s: float, radius_m: float) -> None:
    """Add a scan; a missing echo is a gap, not a distance."""
    nearest_m = inf
    for sonar, range_mm in enumerate(scan.range_mm):
        if not scan.echo & scan.valid & 1 << sonar:
            continue
        nearest_m = min(nearest_m, range_mm / 1000.0)
        if run.estimated:
            x_m, y_m, heading_rad = run.estimated[-1]
            bearing_rad = heading_rad + BEARINGS_RAD[sonar]
            far_m = radius_m + range_mm / 1000.0
            run.echoes.append((x_m + far_m * cos(bearing_rad), y_m + far_m * sin(bearing_rad)))
    run.nearest_m.add(time_s, nan if nearest_m == inf else nearest_m)
