"""A study's directory: its settings, shards that are complete or absent, and the results.

A shard is written under a temporary name, synced and renamed. So a killed writer leaves only whole
shards and at most one temporary file. The stored settings prevent mixing different studies in one
directory.
"""

import fcntl
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType, UnionType
from typing import Any, Final, NamedTuple, get_args, get_type_hints

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from protocol.navigators import name_of
from runtime.errors import UserError
from runtime.files import sync_folder, text_in, value_in
from study.runner.plan import KEPT, ListedWorld, OwnFile, StudySettings, split_side
from study.runner.rows import ADDED, COLUMNS, CodeVersion, MachineInfo, TrialRow

RESULTS: Final = "results.parquet"
SHARDS: Final = "shards"
ASIDE: Final = "aside"
UNFINISHED: Final = ".unfinished"
PROVENANCE: Final = b"sidestep"
"""Prefix of the metadata keys of the results, which hold command and settings."""


_ARROW: Final[Mapping[type, Any]] = MappingProxyType(
    {str: pa.string(), bool: pa.bool_(), int: pa.int64(), float: pa.float64()}
)


def _column(name: str, kind: Any) -> Any:
    """Return a column that holds nulls where its annotation allows None."""
    nullable = isinstance(kind, UnionType)
    plain = get_args(kind)[0] if nullable else kind
    return pa.field(name, _ARROW[plain], nullable=nullable)


SCHEMA: Final = pa.schema([_column(name, kind) for name, kind in get_type_hints(TrialRow).items()])


class StoredRows(NamedTuple):
    """The rows that could be read, each trial once, and the unreadable files with a reason."""

    table: pa.Table
    unreadable: tuple[tuple[Path, str], ...]


def read(directory: str | Path) -> pa.Table:
    """Return all rows of a study, finished or not, each trial once, sorted by `trial_id`.

    Raises UserError when there is no study or one of its files cannot be read.
    """
    found = find(Path(directory))
    for file, reason in found.unreadable:
        raise UserError(
            f"{file}: cannot be read: {reason}; run the study again with the same --output, "
            "which sets the file aside and runs its trials again"
        )
    return found.table


def find(directory: Path) -> StoredRows:
    """Read as `read` does, but list unreadable files instead of raising."""
    if not directory.is_dir():
        raise UserError(f"{directory}: no such directory; `sidestep study --output` makes one")
    files = files_of(directory)
    if not files:
        raise UserError(f"{directory}: holds no results; `sidestep study` makes them")
    tables, unreadable = [], []
    for file in files:
        try:
            tables.append(_table(file))
        except (OSError, UnicodeDecodeError, pa.ArrowException) as error:
            unreadable.append((file, _first_line(error)))
    return StoredRows(_merged(tables), tuple(unreadable))


def files_of(directory: Path) -> list[Path]:
    """Return the results file first, then the shards in the order of their creation."""
    results = directory / RESULTS
    return [path for path in (results,) if path.exists()] + sorted(
        (directory / SHARDS).glob("*.parquet")
    )


def _table(file: Path) -> pa.Table:
    """Read a file of this or an earlier version.

    Raises ArrowException for no Parquet file or other columns.
    """
    table = with_added(pq.read_table(file, partitioning=None))
    if table.schema.names != SCHEMA.names:
        odd = set(table.schema.names) ^ set(SCHEMA.names)
        raise pa.ArrowInvalid(f"other columns than this version writes: {', '.join(sorted(odd))}")
    return table.replace_schema_metadata(None).cast(SCHEMA)


def _merged(tables: list[pa.Table]) -> pa.Table:
    """Return each trial once, as it was written first."""
    whole = pa.concat_tables(tables) if tables else SCHEMA.empty_table()
    whole = whole.append_column("place", pa.array(range(whole.num_rows), pa.int64()))
    first = whole.group_by("trial_id").aggregate([("place", "min")])
    kept = whole.take(first["place_min"]).drop_columns("place")
    return kept.take(pc.sort_indices(kept, sort_keys=[("trial_id", "ascending")]))


def _first_line(error: Exception) -> str:
    strerror = getattr(error, "strerror", None)
    return strerror or (str(error).splitlines() or [type(error).__name__])[0]


def keep(worlds: Iterable[ListedWorld], directory: Path) -> None:
    """Copy given files into the study's directory, since they may be removed later."""
    for one in worlds:
        if one.text is None:
            continue
        file = directory / KEPT / one.source.partition(":")[2]
        file.parent.mkdir(exist_ok=True)
        if not file.exists():
            with replacing(file) as opened:
                opened.write(one.text.encode())


def table_of(rows: list[TrialRow]) -> pa.Table:
    """Return the rows as a table in their order.

    Raises ValueError, naming the column, where a value is missing.
    """
    columns = {name: [getattr(row, name) for row in rows] for name in COLUMNS}
    for field in SCHEMA:
        if not field.nullable and None in columns[field.name]:
            raise ValueError(f"{field.name}: a row without a value")
    return pa.table(columns, schema=SCHEMA)


def with_added(table: pa.Table) -> pa.Table:
    """Return a table of an earlier version with the columns that were added since, in order.

    A table that lacks other columns, or has others, is returned as it is.
    """
    missing = [name for name in COLUMNS if name not in table.column_names]
    if not set(missing) <= set(ADDED) or not set(table.column_names) <= set(COLUMNS):
        return table
    for name in missing:
        values = pa.array([ADDED[name]] * table.num_rows, SCHEMA.field(name).type)
        table = table.append_column(SCHEMA.field(name), values)
    return table.select(list(COLUMNS)) if missing else table


def rows_of(table: pa.Table) -> list[TrialRow]:
    """Return the rows of a table that has the schema."""
    return [TrialRow(**record) for record in table.to_pylist()]


def write_shard(directory: Path, rows: list[TrialRow]) -> Path:
    """Write one more shard; raise UserError when the disk is full."""
    shards = directory / SHARDS
    shards.mkdir(exist_ok=True)
    numbers = [int(path.stem) for path in shards.glob("*.parquet") if path.stem.isdigit()]
    file = shards / f"{max(numbers, default=0) + 1:06d}.parquet"
    write_table(file, table_of(rows))
    return file


def commands_of(directory: Path) -> str:
    """Return the commands that made the results, one per line; empty without results."""
    try:
        metadata = pq.read_schema(directory / RESULTS).metadata or {}
    except (OSError, pa.ArrowException):
        return ""
    commands: bytes = metadata.get(PROVENANCE + b".command", b"")
    return commands.decode()


def compact(directory: Path, table: pa.Table, provenance: Mapping[str, str]) -> Path:
    """Write all rows into one file with its provenance, then remove the shards."""
    shards = [path for path in files_of(directory) if path.name != RESULTS]
    file = directory / RESULTS
    metadata = {PROVENANCE + b"." + key.encode(): text for key, text in provenance.items()}
    write_table(file, table.replace_schema_metadata(metadata))
    for shard in shards:
        shard.unlink()
    return file


def write_table(file: Path, table: pa.Table) -> None:
    """Write a table, replacing the file atomically."""
    with replacing(file) as opened:
        pq.write_table(table, opened, compression="zstd")


@contextmanager
def replacing(file: Path) -> Iterator[Any]:
    """Open a file for writing that replaces `file` once all of it is on the disk.

    Raises UserError when it cannot be written.
    """
    unfinished = file.with_name(file.name + UNFINISHED)
    try:
        with unfinished.open("wb") as opened:
            yield opened
            opened.flush()
            os.fsync(opened.fileno())
        unfinished.replace(file)
        sync_folder(file.parent)
    except OSError as error:
        unfinished.unlink(missing_ok=True)
        raise UserError(
            f"{file}: cannot be written: {_first_line(error)}; earlier results are intact: free "
            "disk space and run the same command again"
        ) from None


def set_aside(directory: Path, file: Path) -> Path:
    """Move a file into the directory `aside` without overwriting an earlier one."""
    aside = directory / ASIDE
    aside.mkdir(exist_ok=True)
    place, number = aside / file.name, 1
    while place.exists():
        place, number = aside / f"{file.stem}-{number}{file.suffix}", number + 1
    file.replace(place)
    return place


FILE: Final = "settings.json"
OWN: Final = "own_navigators"
LOCK: Final = "lock"
MAX_NAMED: Final = 3
MAX_SETTINGS_BYTES: Final = 1 << 26


def settings_of(
    worlds: Sequence[ListedWorld], settings: StudySettings, code: CodeVersion, machine: MachineInfo
) -> dict[str, Any]:
    """Return the settings as stored; of the machine only libraries that may round differently."""
    own = settings.own()
    return {
        "navigators": [
            f"{name_of(name)}:{side}" for name, side in map(split_side, settings.navigators)
        ],
        **({OWN: {name: file._asdict() for name, file in own.items()}} if own else {}),
        "noise": list(settings.noise),
        "seeds": settings.seeds,
        "timeout_s": settings.timeout_s,
        "parameters": dict(settings.parameters),
        "calibrated": settings.calibrated,
        "worlds": {one.world.name: one.digest for one in worlds},
        "version": code.version,
        "code": code.digest,
        "numpy": machine.numpy,
        "pymunk": machine.pymunk,
    }


MIXED: Final = ", or continue in this one with --mixed"
"""A remedy that the command line has."""


def check_settings(
    directory: Path, wanted: Mapping[str, Any], code: CodeVersion, *, mixed: bool
) -> list[str]:
    """Store the settings; return the differences from those stored before, if `mixed` allows them.

    Raises UserError, naming the differences, if it does not.
    """
    file = directory / FILE
    stored = settings_in(file)
    differing = [] if stored is None else differences(stored, wanted)
    if differing and not mixed:
        raise UserError(
            f"{directory}: holds a study with other settings: {'; '.join(differing)}; choose "
            f"another --output{MIXED}"
        )
    if stored is None or differing:
        with replacing(file) as opened:
            opened.write(json.dumps({**wanted, "commit": code.commit}, indent=1).encode())
    return differing


def differences(stored: Mapping[str, Any], wanted: Mapping[str, Any]) -> list[str]:
    """Return each difference in a few words, with the commit where the code differs."""
    found = []
    for key, value in wanted.items():
        before = stored.get(key)
        if before == value:
            continue
        if key == OWN:
            found.append(f"another version of {', '.join(value)}")
        elif key == "worlds":
            found.append(_worlds(before if isinstance(before, dict) else {}, value))
        elif key == "code":
            found.append(f"other code (it was made at commit {stored.get('commit', 'unknown')})")
        else:
            found.append(f"{key} was {_short(before)}, is {_short(value)}")
    return found


def _worlds(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    names = sorted(name for name in {*before, *now} if before.get(name) != now.get(name))
    more = f" and {len(names) - MAX_NAMED} more" if len(names) > MAX_NAMED else ""
    return f"{len(before)} worlds were, {len(now)} are ({', '.join(names[:MAX_NAMED])}{more})"


def _short(value: object) -> str:
    return " ".join(map(str, value)) if isinstance(value, list) else json.dumps(value)


def own_of(directory: Path) -> dict[str, OwnFile]:
    """Return the user's own navigators of a study by name."""
    found = (settings_in(directory / FILE) or {}).get(OWN, {})
    return {name: OwnFile(file["reference"], file["digest"]) for name, file in found.items()}


def settings_in(file: Path) -> dict[str, Any] | None:
    """Return the settings in a file; None without the file.

    Raises UserError when it cannot be read.
    """
    if not file.exists():
        return None
    try:
        stored = value_in(text_in(file, MAX_SETTINGS_BYTES))
    except (OSError, ValueError) as error:
        raise UserError(
            f"{file}: cannot be read: {error}; remove it if the study was made with the settings "
            "given now"
        ) from None
    if not isinstance(stored, dict):
        raise UserError(f"{file}: is not a JSON object; remove it")
    return stored


@contextmanager
def exclusive(directory: Path) -> Iterator[None]:
    """Lock the study's directory; the lock ends with the process, also when killed.

    Raises UserError when another study holds it or it cannot be made.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
        opened = (directory / LOCK).open("wb")
    except OSError as error:
        raise UserError(f"--output {directory}: {error.strerror}; choose another") from None
    with opened:
        try:
            fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UserError(
                f"{directory}: another study is writing there; wait for its end, or give another "
                "--output"
            ) from None
        yield
