"""Log the robot's pose and speed to a Parquet file, for pandas, polars or DuckDB.

    python examples/log_to_parquet.py run.parquet --for 60

Needs pyarrow: pip install 'sidestep[study]'.
"""

import argparse
import asyncio
import sys
from collections.abc import AsyncIterator
from contextlib import suppress
from typing import Any

import sidestep

COLUMNS = ("time_ns", "x_m", "y_m", "heading_rad", "speed_m_s", "yaw_rate_rad_s")
ROWS = 1000
"""Rows per group, the maximum loss if the program is killed."""


async def log(endpoint: str | None, file: str, for_s: float) -> tuple[int, int]:
    """Log for `for_s` seconds; return the number of rows written and dropped."""
    import pyarrow as arrow
    import pyarrow.parquet as parquet

    fields = [(name, arrow.int64() if name == "time_ns" else arrow.float64()) for name in COLUMNS]
    schema = arrow.schema(fields)
    written = 0
    async with sidestep.connect(endpoint) as robot:
        stream = robot.odometry(size=10 * ROWS)
        with parquet.ParquetWriter(file, schema) as writer:
            async for rows in batches(stream, for_s):
                found = [{name: getattr(row, name) for name in COLUMNS} for row in rows]
                table = arrow.Table.from_pylist(found, schema=schema)
                # A slow disk must not block the event loop, which sends the heartbeat.
                await asyncio.to_thread(writer.write_table, table)
                written += len(rows)
        return written, stream.dropped


async def batches(stream: sidestep.Stream[Any], for_s: float) -> AsyncIterator[list[Any]]:
    """Yield messages in groups for `for_s` seconds; the last group may be smaller."""
    now_s = asyncio.get_running_loop().time
    deadline_s = now_s() + for_s
    rows: list[Any] = []
    with suppress(TimeoutError, StopAsyncIteration):
        while now_s() < deadline_s:
            # No yield in here: the time would run out in the program that uses the rows.
            async with asyncio.timeout_at(deadline_s):
                rows.append(await anext(stream))
            if len(rows) == ROWS:
                yield rows
                rows = []
    if rows:
        yield rows


def main(argv: list[str] | None = None) -> int:
    """Log to the file; return 0 if there are rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file")
    parser.add_argument("--connect", metavar="ENDPOINT")
    parser.add_argument("--for", dest="for_s", type=float, default=60.0, metavar="S")
    given = parser.parse_args(argv)
    written, dropped = asyncio.run(log(given.connect, given.file, given.for_s))
    print(f"{given.file}: {written} rows, {dropped} dropped")
    return 0 if written else 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (sidestep.UserError, sidestep.RemoteError) as error:
        sys.exit(f"log_to_parquet: {error}")
