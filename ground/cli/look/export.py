"""`export`: a recording as a table for other programs."""

import argparse
import sys
from collections.abc import Iterable
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Final, NamedTuple, TextIO

from ground.client.connection import add_json, within
from ground.recording.log_reader import opened
from ground.recording.tables.files import parquet, write_csv, write_parquet
from ground.recording.tables.rows import LONG, Column, Row, long_rows, wide_columns, wide_rows
from ground.recording.tables.time_axis import Axis
from ground.text.output import Says
from protocol.options import finite
from runtime.errors import UserError

USUAL_RATE_HZ: Final = 20.0
LOWEST_HZ: Final = 0.01
HIGHEST_HZ: Final = 1000.0


class Tally(NamedTuple):
    """What became of a log; `unreadable` frames are whole, but not of this dialect."""

    frames: int
    rows: int
    unreadable: int
    lost_bytes: int
    damage: str


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", metavar="FILE", help="a .tlog or .mcap")
    parser.add_argument("--format", choices=("csv", "parquet"), default="csv", help="(csv)")
    says = "a row per value that came, or per instant of a grid (long)"
    parser.add_argument("--shape", choices=("long", "wide"), default="long", help=says)
    says = "instants of wide: the last value not older than its stale-after, else empty (20)"
    parser.add_argument("--rate", type=finite, metavar="HZ", help=says)
    says = "begin at this second of the robot's stamps"
    parser.add_argument("--from", dest="begin", type=finite, metavar="S", help=says)
    parser.add_argument("--to", dest="end", type=finite, metavar="S", help="end there")
    parser.add_argument("--out", metavar="FILE", help="write here, not to standard output")
    add_json(parser)


def run(options: argparse.Namespace, says: Says) -> int:
    """0 when all of the file could be read, 1 when part of it is damaged."""
    check(options)
    axis = axis_of(options)
    try:
        columns, rows = table_of(options, axis)
        count = write(options, columns, rows)
    except BrokenPipeError:
        raise  # nobody reads the table any more, which is nobody's mistake
    except OSError as error:
        raise UserError(f"{error.filename or options.out}: {error.strerror}") from error
    log = axis.log
    tally = Tally(log.records, count, axis.unreadable, log.lost_bytes, log.damage())
    return tell(says, options, tally)


def check(options: argparse.Namespace) -> None:
    """Refuse what does not go together, before anything is read."""
    if options.format == "parquet":
        if options.out is None:
            raise UserError("Parquet is no text: add --out FILE.parquet")
        parquet()
    if options.out is not None and same_file(options.out, options.file):
        raise UserError(f"--out {options.out} is the recording itself: give another name")
    if options.json and options.out is None:
        raise UserError("--json and the table cannot both be standard output: add --out FILE")
    if options.rate is not None:
        if options.shape == "long":
            raise UserError("--rate is for --shape wide: long has every value as it came")
        within(options.rate, LOWEST_HZ, HIGHEST_HZ, "--rate", "Hz")
    if None not in (options.begin, options.end) and options.begin > options.end:
        raise UserError(f"--from {options.begin:g} is after --to {options.end:g}")


def same_file(one: str, other: str) -> bool:
    """By whatever names and links; what is not there is no file."""
    with suppress(OSError):
        return Path(one).samefile(other)
    return False


def axis_of(options: argparse.Namespace) -> Axis:
    return Axis(opened(Path(options.file)), options.begin, options.end)


def table_of(options: argparse.Namespace, axis: Axis) -> tuple[list[Column], Iterable[Row]]:
    """Wide is read twice: first for its columns."""
    if options.shape == "long":
        return list(LONG), long_rows(axis)
    columns = wide_columns(axis_of(options))
    return columns, wide_rows(axis, columns, options.rate or USUAL_RATE_HZ)


def write(options: argparse.Namespace, columns: list[Column], rows: Iterable[Row]) -> int:
    if options.format == "parquet":
        return write_parquet(Path(options.out), columns, rows)
    with target_of(options.out) as target:
        return write_csv(target, columns, rows)


def target_of(out: str | None) -> "nullcontext[TextIO] | TextIO":
    if out is None:
        return nullcontext(sys.stdout)
    return open(out, "w", encoding="utf-8", newline="")


def tell(says: Says, options: argparse.Namespace, tally: Tally) -> int:
    text = f"{options.file}: {tally.frames} frames, {tally.rows} rows"
    if tally.unreadable:
        text += f"; {tally.unreadable} frames are not of this dialect"
    if tally.damage:
        text += f"; DAMAGED: {tally.damage}"
    if options.out is None:
        says.note(text)
    else:
        says.result({"file": options.file, "out": options.out, **tally._asdict()}, text)
    return 1 if tally.damage else 0
