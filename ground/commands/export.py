"""`export`: write a recording as a table, or as a bag of ROS 2, for other programs."""

import sys
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple, Self

from ground.client.connection import within
from ground.client.outcomes import Progress
from ground.commands.command import choice, command, option
from ground.commands.recordings import SUFFIXES, RecordingCommand
from ground.recording.log_reader import open_log
from ground.recording.tables import (
    DEFAULT_RATE_HZ,
    LONG,
    Row,
    TableColumn,
    TimeAxis,
    long_rows,
    parquet,
    wide_columns,
    wide_rows,
    write_csv,
    write_parquet,
)
from protocol.options import finite
from runtime.cli.verb import REC
from runtime.errors import UserError
from runtime.files import drafted

MIN_RATE_HZ: Final = 0.01
MAX_RATE_HZ: Final = 1000.0
NEEDS_ROS2: Final = "a bag needs {}, which is not installed: pip install 'sidestep[ros2]'"


class Tally(NamedTuple):
    """Counts of an export: rows of a table, or messages of a bag.

    `unreadable` frames are valid, but of another dialect.
    """

    frames: int
    rows: int
    unreadable: int
    lost_bytes: int
    damage: str


@dataclass(frozen=True, slots=True)
class Exported:
    """A table or bag that was written.

    `ok` unless the recording is empty or part of it is damaged.
    """

    file: str
    out: str | None
    tally: Tally
    unit: str = "rows"

    @property
    def ok(self) -> bool:
        """True unless the recording is empty or part of it is damaged."""
        return bool(self.tally.frames) and not self.tally.damage

    @property
    def text(self) -> str:
        """The counts, and the damage if there is any."""
        tally = self.tally
        text = f"{self.file}: {tally.frames} frames, {tally.rows} {self.unit}"
        if not tally.frames and not tally.damage:
            text += ": the recording is empty; `sidestep rec list` shows the others"
        if tally.unreadable:
            text += f"; {tally.unreadable} frames are of MAVLink 1 or of another dialect"
        return f"{text}; DAMAGED: {tally.damage}" if tally.damage else text

    @property
    def is_printed(self) -> bool:
        """True if the table went to standard output."""
        return self.out is None

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return files and counts as a row."""
        return {"file": self.file, "out": self.out, **self.tally._asdict()}


@command(REC, 40, "rec export drive.mcap --out drive.csv", suffixes=SUFFIXES)
class Export(RecordingCommand):
    """Convert a recording to a CSV or Parquet table, or to a bag of ROS 2.

    `shape` long: one row per received value; wide: one row per instant of a grid of `rate_hz` (20).
    `begin_s` and `end_s` are seconds of the robot's time stamps. Without `out` the table goes to
    standard output. `ros2` is a new folder, for a bag with the topics of `run ros2`.
    """

    format: str = choice(
        ("csv", "parquet"), "--format", default="csv", parse=str, help="(default csv)"
    )
    shape: str = choice(
        ("long", "wide"),
        "--shape",
        default="long",
        parse=str,
        help="a row per value that came, or per instant of a grid (default long)",
    )
    rate_hz: float | None = option(
        "--rate",
        default=None,
        parse=finite,
        metavar="HZ",
        help="instants of wide: the last value unless it is stale, else empty (default 20)",
    )
    begin_s: float | None = option(
        "--from",
        default=None,
        parse=finite,
        metavar="S",
        help="begin at this second of the robot's stamps",
    )
    end_s: float | None = option("--to", default=None, parse=finite, metavar="S", help="end there")
    out: str | None = option(
        "--out", default=None, metavar="FILE", help="write here, not to standard output"
    )
    ros2: str | None = option(
        "--ros2",
        default=None,
        metavar="DIR",
        help="write a bag of ROS 2 instead: a new folder with an .mcap and a metadata.yaml",
    )

    @classmethod
    def parsed(cls, found: Any) -> Self:
        """Return the command; UserError if table and JSON are wanted on standard output."""
        if found.json and found.out is None and found.ros2 is None:
            both = "--json and the table cannot both use standard output"
            raise UserError(f"{both}: add --out FILE")
        return super(Export, cls).parsed(found)  # noqa: UP008 - slots make a new class

    def __post_init__(self) -> None:
        check(self)

    def run(self, progress: Progress) -> Exported:
        """Write the table; UserError if the file cannot be written."""
        if self.remark:
            progress.note(self.remark)
        if self.ros2 is not None:
            return as_bag(self, self.ros2)
        axis = axis_of(self)
        try:
            columns, rows = table_of(self, axis)
            count = write(self, columns, rows)
        except BrokenPipeError:
            raise  # the reader has closed the pipe, which is not an error
        except OSError as error:
            raise UserError(f"{error.filename or self.out}: {error.strerror}") from error
        log = axis.log
        tally = Tally(log.records, count, axis.unreadable, log.lost_bytes, log.damage())
        return Exported(self.file, self.out, tally)


def check(asked: Export) -> None:
    """Reject options that exclude each other, before reading the file."""
    if asked.ros2 is not None:
        if (asked.format, asked.shape, asked.rate_hz, asked.out) != ("csv", "long", None, None):
            raise UserError("--ros2 writes a bag: leave --format, --shape, --rate and --out out")
        if Path(asked.ros2).exists():
            raise UserError(f"--ros2 {asked.ros2} exists: a bag is a new folder; give another name")
    if asked.format == "parquet":
        if asked.out is None:
            raise UserError("Parquet is binary: add --out FILE.parquet")
        parquet()
    if asked.out is not None and same_file(asked.out, asked.file):
        raise UserError(f"--out {asked.out} is the recording itself: give another name")
    if asked.rate_hz is not None:
        if asked.shape == "long":
            raise UserError("--rate needs --shape wide: long has every value as received")
        within(asked.rate_hz, MIN_RATE_HZ, MAX_RATE_HZ, "--rate", "Hz")
    if asked.begin_s is not None and asked.end_s is not None and asked.begin_s > asked.end_s:
        raise UserError(f"--from {asked.begin_s:g} is after --to {asked.end_s:g}")


def as_bag(asked: Export, folder: str) -> Exported:
    """Write a bag; UserError if that fails."""
    try:
        from ground.ros2.recorded import RecordedRun, write_bag  # their libraries are optional
    except ModuleNotFoundError as error:
        raise UserError(NEEDS_ROS2.format(error.name)) from None
    run = RecordedRun(Path(asked.file), asked.begin_s, asked.end_s)
    try:
        count = write_bag(run, Path(folder))
    except OSError as error:
        raise UserError(f"{folder}: {error.strerror or error}") from error
    log = run.axis.log
    tally = Tally(log.records, count, run.axis.unreadable, log.lost_bytes, log.damage())
    return Exported(asked.file, folder, tally, "messages")


def same_file(one: str, other: str) -> bool:
    """Return whether two paths lead to the same existing file."""
    with suppress(OSError):
        return Path(one).samefile(other)
    return False


def axis_of(asked: Export) -> TimeAxis:
    """Open the recording and limit it to the requested time."""
    return TimeAxis(open_log(Path(asked.file)), asked.begin_s, asked.end_s)


def table_of(asked: Export, axis: TimeAxis) -> tuple[list[TableColumn], Iterable[Row]]:
    """Return columns and rows; a wide table reads the recording twice."""
    if asked.shape == "long":
        return list(LONG), long_rows(axis)
    columns = wide_columns(axis_of(asked))
    return columns, wide_rows(axis, columns, asked.rate_hz or DEFAULT_RATE_HZ)


def write(asked: Export, columns: list[TableColumn], rows: Iterable[Row]) -> int:
    """Write the rows and return their number."""
    if asked.out is None:
        return write_csv(sys.stdout, columns, rows)
    with drafted(Path(asked.out)) as path:
        if asked.format == "parquet":
            return write_parquet(path, columns, rows)
        with path.open("w", encoding="utf-8", newline="") as target:
            return write_csv(target, columns, rows)
