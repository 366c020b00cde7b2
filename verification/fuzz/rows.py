"""The rows of a study in Parquet files, complete or not."""

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.parquet as pq

from study.runner.rows import SCHEMA
from study.runner.store import RESULTS, find
from verification.fuzz.target import FuzzTarget


def tables() -> Sequence[bytes]:
    """Return files without rows, and with two rows, compressed and not."""
    columns = {one.name: pa.array(["1", "1"]).cast(one.type) for one in SCHEMA}
    two = pa.table(columns, schema=SCHEMA)
    return [written(SCHEMA.empty_table(), "NONE"), written(two, "NONE"), written(two, "zstd")]


def written(table: pa.Table, compression: str) -> bytes:
    """Return a table as a Parquet file."""
    out = BytesIO()
    pq.write_table(table, out, compression=compression)
    return out.getvalue()


def read(data: bytes, folder: Path) -> None:
    """Read the rows of a study."""
    (folder / RESULTS).write_bytes(data)
    find(folder)


ROWS: Final = (FuzzTarget(name="study_rows", samples=tables, run=read, words=(b"PAR1",), weight=8),)
