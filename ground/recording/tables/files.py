"""Write a table as CSV, or as Parquet if pyarrow is installed."""

import csv
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, Final, TextIO

from ground.recording.tables.rows import Column, Row
from runtime.errors import UserError

GROUP: Final = 10_000


def write_csv(target: TextIO, columns: Sequence[Column], rows: Iterable[Row]) -> int:
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


def write_parquet(path: Path, columns: Sequence[Column], rows: Iterable[Row]) -> int:
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


def _values(column: Column, place: int, rows: Iterable[Row]) -> Iterator[str | float | None]:
    for row in rows:
        text = row[place]
        if text is None or column.kind == "text":
            yield text
        else:
            yield float(text) if column.kind == "float" else int(text)
