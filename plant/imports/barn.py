"""Read layouts of the BARN benchmark: cylinders of 0.075 m radius on a grid of 0.15 m.

Its grid files are numpy arrays of rows and columns, 1 for a cylinder; the robot crosses the field
along the columns. Here it starts before the first column and its goal is behind the last, along x,
with row 0 at the left. A list of cylinders, one line of x, y and optionally radius each, is
accepted, too. Cylinders with eight neighbours are omitted, as in the benchmark's own worlds.
"""

import ast
import re
from math import isfinite
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant.imports.cells import MAX_COORDINATE_M
from plant.model.errors import read_bytes, read_text, refuse
from protocol.world import Point, WorldCircle

NPY_MAGIC: Final = b"\x93NUMPY"
LENGTH_BYTES: Final = {1: 2, 2: 4, 3: 4}
MAX_HEADER_BYTES: Final = 10_000
MAX_SIDE: Final = 1000
NUMBERS: Final = re.compile(r"[<>|=]?(b1|[iu][1248]|f[248])")
GRID_FIX: Final = "give a grid_N.npy of the data set"

PITCH_M: Final = 0.15
RADIUS_M: Final = 0.075
BEFORE_M: Final = 1.5
"""Width of the free floor before and behind the field."""

AROUND_M: Final = 1.0
"""Width of the free floor around a list of cylinders."""

MAX_BYTES: Final = 10_000_000
MAX_SIZE_M: Final = 50.0
HEADER: Final = ("x", "x_m")


class CylinderField(NamedTuple):
    """Cylinders on a floor; `corner` is the floor's lower left corner in the file's own frame."""

    size_m: Point
    cylinders: tuple[WorldCircle, ...]
    corner: Point
    ends: tuple[Point, Point] | None


def load_grid(path: Path, pitch_m: float = PITCH_M) -> CylinderField:
    """Return the field of a grid file; raise only WorldError."""
    grid = _grid(read_bytes(path, MAX_BYTES), str(path))
    rows, columns = grid.shape
    padded = np.pad(grid, 1)
    around = sum(
        padded[1 + up : 1 + up + rows, 1 + right : 1 + right + columns].astype(np.int64)
        for up in (-1, 0, 1)
        for right in (-1, 0, 1)
    )
    cylinders = []
    for row, column in np.argwhere(grid & (around < 9)).tolist():
        x_m = BEFORE_M + (column + 0.5) * pitch_m
        y_m = (rows - row - 0.5) * pitch_m
        cylinders.append(WorldCircle(x_m=round(x_m, 6), y_m=round(y_m, 6), radius_m=pitch_m / 2.0))
    size_m = (round(2.0 * BEFORE_M + columns * pitch_m, 6), round(rows * pitch_m, 6))
    middle_m = round(size_m[1] / 2.0, 6)
    ends = ((BEFORE_M / 2.0, middle_m), (round(size_m[0] - BEFORE_M / 2.0, 6), middle_m))
    return CylinderField(size_m, tuple(cylinders), (0.0, 0.0), ends)


def _grid(data: bytes, file: str) -> NDArray[np.bool_]:
    table = parse_npy(data, file)
    if not np.isin(table, (0, 1)).all():
        reason = "a value that is neither 0 nor 1"
        raise refuse(file, "npy", reason, "write 1 for a cylinder, 0 for none")
    blocked: NDArray[np.bool_] = table == 1
    return blocked


def load_list(path: Path) -> CylinderField:
    """Return the field of a .csv or .txt list; the floor has a margin around the cylinders."""
    return parse_list(read_text(path, MAX_BYTES), str(path))


def parse_list(text: str, file: str) -> CylinderField:
    """Return the field of a list; raise WorldError."""
    rows: list[tuple[float, float, float]] = []
    first = True
    for number, line in enumerate(text.split("\n"), 1):
        words = cells_in(line.partition("#")[0])
        if words and not (first and words[0].lower() in HEADER):
            rows.append(_cylinder(words, number, file))
        first = first and not words
    if not rows:
        raise refuse(file, "cylinders", "none in the file", "write x, y and perhaps radius a line")
    low = [min(row[axis] - row[2] for row in rows) - AROUND_M for axis in (0, 1)]
    high = [max(row[axis] + row[2] for row in rows) + AROUND_M for axis in (0, 1)]
    cylinders = tuple(
        WorldCircle(x_m=round(x - low[0], 6), y_m=round(y - low[1], 6), radius_m=radius)
        for x, y, radius in dict.fromkeys(rows)
    )
    size_m = (round(high[0] - low[0], 6), round(high[1] - low[1], 6))
    return CylinderField(size_m, cylinders, (low[0], low[1]), None)


def cells_in(line: str) -> list[str]:
    """Return the cells of a line; between semicolons a comma is a decimal mark."""
    if ";" in line:
        cells = line.replace(",", ".").rstrip().removesuffix(";").split(";")
    elif "," in line:
        cells = line.rstrip().removesuffix(",").split(",")
    else:
        return line.split()
    return [cell.strip() for cell in cells]


def _cylinder(words: list[str], line: int, file: str) -> tuple[float, float, float]:
    try:
        x_m, y_m, radius_m = (float(word) for word in (*words, str(RADIUS_M))[:3])
    except ValueError:
        x_m = y_m = radius_m = float("nan")
    finite = all(isfinite(value) for value in (x_m, y_m, radius_m)) and len(words) in (2, 3)
    if not finite or not 0.0 < radius_m <= MAX_SIZE_M or max(abs(x_m), abs(y_m)) > MAX_COORDINATE_M:
        reason = f"found {', '.join(words)[:40]!r}"
        fix = "write x, y and perhaps radius in metres, as in 1.5, 0.3, 0.075"
        raise refuse(file, "cylinder", reason, fix, line)
    return x_m, y_m, radius_m


def parse_npy(data: bytes, file: str) -> NDArray[np.float64]:
    """Return rows and columns of numbers; raise WorldError for anything else."""
    header, body = _header(data, file)
    kind, shape, by_column = (header.get(key) for key in ("descr", "shape", "fortran_order"))
    if not isinstance(kind, str) or not NUMBERS.fullmatch(kind):
        raise refuse(file, "npy", f"expected a table of numbers, found {kind!r:.40}", GRID_FIX)
    if not isinstance(shape, tuple) or len(shape) != 2 or not isinstance(by_column, bool):
        raise refuse(file, "npy", f"expected rows and columns, found shape {shape!r:.40}", GRID_FIX)
    if not all(isinstance(side, int) and 1 <= side <= MAX_SIDE for side in shape):
        reason = f"{shape[0]!r:.20} x {shape[1]!r:.20}, a side must be 1 to {MAX_SIDE}"
        raise refuse(file, "npy", reason, "give a smaller grid")
    needed = shape[0] * shape[1] * np.dtype(kind).itemsize
    if len(body) != needed:
        reason = f"{len(body)} bytes of numbers, but {shape[0]} x {shape[1]} needs {needed}"
        raise refuse(file, "npy", reason, "is the file cut? save it again")
    table = np.frombuffer(body, dtype=kind).astype(np.float64)
    return table.reshape(shape, order="F" if by_column else "C")


def _header(data: bytes, file: str) -> tuple[dict[str, object], bytes]:
    """Return the header of the file and the bytes of its table."""
    size = LENGTH_BYTES.get(data[6] if len(data) > 6 else 0, 0)
    if not data.startswith(NPY_MAGIC) or not size:
        raise refuse(file, "npy", f"no .npy file: it starts with {data[:8]!r}", GRID_FIX)
    end = 8 + size + int.from_bytes(data[8 : 8 + size], "little")
    if end > min(len(data), MAX_HEADER_BYTES):
        raise refuse(file, "npy", "its header does not end", "is the file cut? save it again")
    try:
        header = ast.literal_eval(data[8 + size : end].decode("latin-1").strip())
    except (ValueError, SyntaxError, RecursionError, MemoryError):
        header = None
    if not isinstance(header, dict):
        raise refuse(file, "npy", "its header cannot be read", "save it again with numpy.save")
    return header, data[end:]
