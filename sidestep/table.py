"""A table of a result: a column for each field, in SI units."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any, TypeAlias

from runtime.errors import UserError

if TYPE_CHECKING:
    import pandas as pd

Value: TypeAlias = str | float | int | bool | None
"""None where nothing was measured, `inf` where there was no echo."""

SHOWN = 20
"""Rows that a notebook shows."""


class Table:
    """Rows with named columns: `table["time_s"]` is a column, iterating gives rows as dicts."""

    def __init__(self, columns: Mapping[str, Sequence[Value]]) -> None:
        self._columns = {name: list(values) for name, values in columns.items()}

    @classmethod
    def of_rows(cls, rows: Iterable[Mapping[str, Value]]) -> "Table":
        """Make a table of rows; None where a row lacks a field that another one has."""
        found = list(rows)
        names = dict.fromkeys(name for row in found for name in row)
        return cls({name: [row.get(name) for row in found] for name in names})

    @property
    def columns(self) -> list[str]:
        """Names of the columns."""
        return list(self._columns)

    def __len__(self) -> int:
        return len(next(iter(self._columns.values()), ()))

    def __getitem__(self, column: str) -> list[Value]:
        if isinstance(column, int | slice):
            raise UserError("a table gives columns by name: list(table)[0] is its first row")
        if column not in self._columns:
            raise UserError(f"there is no column {column!r}: there are {', '.join(self._columns)}")
        return self._columns[column]

    def __iter__(self) -> Iterator[dict[str, Value]]:
        for values in zip(*self._columns.values(), strict=True):
            yield dict(zip(self._columns, values, strict=True))

    def to_dict(self) -> dict[str, list[Value]]:
        """Return the columns as lists, which pandas, polars and pyarrow take."""
        return {name: list(values) for name, values in self._columns.items()}

    def to_pandas(self) -> "pd.DataFrame":
        """Return a DataFrame; pandas is the extra `pandas`."""
        return pandas().DataFrame(self._columns)

    def __repr__(self) -> str:
        return f"<Table: {len(self)} rows, columns {', '.join(self._columns)}>"

    def _repr_html_(self) -> str:
        """Return the first rows for a notebook."""
        rows = [values for values, _ in zip(self, range(SHOWN), strict=False)]
        head = "".join(f"<th>{escape(name)}</th>" for name in self._columns)
        body = "".join(
            f"<tr>{''.join(f'<td>{escape(text_of(value))}</td>' for value in row.values())}</tr>"
            for row in rows
        )
        more = f"<p>{len(self):,} rows</p>" if len(self) > SHOWN else ""
        return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{more}"


def text_of(value: Value) -> str:
    """Return a value with six digits; empty for None."""
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def pandas() -> Any:
    """Return pandas; the UserError without it names the command that installs it."""
    try:
        import pandas
    except ImportError:
        raise UserError(
            "to_pandas() needs pandas: pip install 'sidestep[pandas]'; to_dict() needs nothing"
        ) from None
    return pandas
