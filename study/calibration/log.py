"""The log of a calibration drive: a CSV file from a real robot or from the plant.

One line per control period (50 ms): `run,direction,left,right,x_m,y_m,heading_deg`. `run` is the
number of the run, `direction` cw or ccw, `left` and `right` are the encoder counters. Only the last
line of a run carries the pose measured at its end. That pose is relative to the robot's start: x
forward, y to the left, heading counter-clockwise.
"""

import csv
from collections.abc import Iterable, Iterator, Sequence
from io import StringIO
from itertools import groupby
from math import degrees, isfinite, radians
from pathlib import Path
from typing import Final, NamedTuple

from robot.core.geometry import wrap
from robot.core.values import Pose
from runtime.errors import ConfigError
from runtime.regular_file import text_in
from study.calibration.runs import DIRECTIONS, SquareRun

COLUMNS: Final = ("run", "direction", "left", "right", "x_m", "y_m", "heading_deg")
MEASURED: Final = COLUMNS[4:]
MAX_BYTES: Final = 1 << 26
MIN_TICKS: Final = 2
MIN_RUNS: Final = 2


class CalibrationLogLine(NamedTuple):
    """One line of the file."""

    number: int
    run: str
    direction: str
    ticks: tuple[int, int]
    measured: Pose | None


def write(path: Path, runs: Iterable[SquareRun]) -> None:
    """Write a log; raise OSError."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for number, run in enumerate(runs, 1):
            x_m, y_m, heading_rad = run.measured
            for left, right in run.ticks[:-1]:
                writer.writerow((number, run.direction, left, right, "", "", ""))
            end = (f"{x_m:.7f}", f"{y_m:.7f}", f"{degrees(heading_rad):.6f}")
            writer.writerow((number, run.direction, *run.ticks[-1], *end))


def read(path: Path) -> list[SquareRun]:
    """Read a log; raise ConfigError that names file, line, fault and remedy."""
    try:
        lines = list(_lines(path, csv.reader(StringIO(text_in(path, MAX_BYTES), newline=""))))
    except OSError as error:
        raise _refusal(path, "", str(error.strerror).lower(), "check the path") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise _refusal(path, "", "is not CSV text in UTF-8", "save it so") from error
    runs = [_run(path, list(group)) for _, group in groupby(lines, lambda line: line.run)]
    for direction in DIRECTIONS:
        count = sum(run.direction == direction for run in runs)
        if count < MIN_RUNS:
            fix = f"drive at least {MIN_RUNS}, better 20, in each direction"
            raise _refusal(path, "", f"has {count} runs {direction}", fix)
    return runs


def _lines(path: Path, rows: Iterator[list[str]]) -> Iterator[CalibrationLogLine]:
    head = next(rows, [])
    if tuple(name.strip() for name in head) != COLUMNS:
        fix = f"begin with {','.join(COLUMNS)}"
        raise _refusal(path, "line 1", f"has the columns {','.join(head) or 'none'}", fix)
    for number, row in enumerate(rows, 2):
        where = f"line {number}"
        if len(row) != len(COLUMNS):
            raise _refusal(path, where, f"has {len(row)} fields", f"write {len(COLUMNS)}")
        run, direction, left, right, *end = (field.strip() for field in row)
        if direction not in DIRECTIONS:
            fix = f"write {' or '.join(DIRECTIONS)}"
            raise _refusal(path, f"{where}: direction", f"{direction!r} is not a direction", fix)
        ticks = (_whole(path, where, "left", left), _whole(path, where, "right", right))
        yield CalibrationLogLine(number, run, direction, ticks, _measured(path, where, end))


def _run(path: Path, lines: Sequence[CalibrationLogLine]) -> SquareRun:
    last = lines[-1]
    where = f"line {last.number}"
    if last.measured is None:
        fix = f"give {', '.join(MEASURED)} on the last line of each run"
        raise _refusal(path, where, f"ends run {last.run} without a measured pose", fix)
    for line in lines[:-1]:
        if line.measured is not None:
            fix = "give it on the last line only, and give each run its own number"
            raise _refusal(path, f"line {line.number}", "has a pose in the middle of a run", fix)
    if len(lines) < MIN_TICKS or lines[0].ticks == last.ticks:
        raise _refusal(path, where, f"ends run {last.run}, which did not move", "leave it out")
    if any(line.direction != last.direction for line in lines):
        fix = "give each run its own number"
        raise _refusal(path, where, f"run {last.run} has both directions", fix)
    return SquareRun(
        direction=last.direction,
        ticks=[line.ticks for line in lines],
        measured=last.measured,
    )


def _measured(path: Path, where: str, fields: Sequence[str]) -> Pose | None:
    if not any(fields):
        return None
    values = []
    for name, text in zip(MEASURED, fields, strict=True):
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not isfinite(value):
            raise _refusal(path, f"{where}: {name}", f"{text!r} is not a number", "measure it")
        values.append(value)
    return Pose(values[0], values[1], wrap(radians(values[2])))


def _whole(path: Path, where: str, name: str, text: str) -> int:
    try:
        return int(text)
    except ValueError:
        fix = "write the encoder counter"
        raise _refusal(path, f"{where}: {name}", f"{text!r} is not a whole number", fix) from None


def _refusal(path: Path, key: str, reason: str, fix: str) -> ConfigError:
    return ConfigError(file=str(path), key=key, reason=reason, fix=fix)
