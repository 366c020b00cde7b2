"""Rows and columns hold the same values, including nulls and NaN."""

from dataclasses import fields, replace
from math import inf, isnan, nan
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from study.runner.rows import ADDED, COLUMNS, TrialRow
from study.runner.store import SCHEMA, rows_of, table_of, with_added
from tests.support.each import each
from tests.support.study.made import rows

FLOATS = st.floats(allow_nan=False) | st.sampled_from([inf, -inf])


def test_columns_are_the_fields_in_order() -> None:
    assert tuple(SCHEMA.names) == COLUMNS == tuple(field.name for field in fields(TrialRow))


def test_only_optional_values_are_nullable() -> None:
    nullable = {field.name for field in SCHEMA if field.nullable}
    assert nullable == {
        *("shortest_path_m", "reachable", "heading_error_rad"),
        *("lap_m", "thinnest_wall_m", "spl", "published_score"),
    }


def test_columns_added_later_have_a_value_for_older_tables() -> None:
    table = table_of(rows(2))
    older = table.drop_columns(list(ADDED))
    assert with_added(older).schema.names == SCHEMA.names
    (first, _) = rows_of(with_added(older))
    assert (first.lap_m, first.spl) == (None, None)
    assert isnan(first.doubt_m)
    assert with_added(table) is table


def test_table_that_lacks_other_columns_is_left_as_it_is() -> None:
    broken = table_of(rows(1)).drop_columns(["seed", "doubt_m"])
    assert with_added(broken) is broken


@given(
    length_m=FLOATS | st.none(),
    error_rad=FLOATS | st.none(),
    reachable=st.booleans() | st.none(),
    x_m=FLOATS,
    seed=st.integers(0, 2**62),
    reason=st.text(),
)
def test_rows_survive_a_round_trip(
    length_m: float | None,
    error_rad: float | None,
    reachable: bool | None,
    x_m: float,
    seed: int,
    reason: str,
) -> None:
    numbers: dict[str, Any] = {field.name: 0.5 for field in SCHEMA if field.type == "double"}
    row = replace(rows(1)[0], **numbers)
    row = replace(row, shortest_path_m=length_m, heading_error_rad=error_rad)
    row = replace(row, reachable=reachable, x_m=x_m, seed=seed, reason=_encodable(reason))
    assert rows_of(table_of([row])) == [row]


def _encodable(text: str) -> str:
    return text.encode("utf-8", "replace").decode()


def test_nan_is_not_stored_as_null() -> None:
    row = replace(rows(1)[0], path_m=nan, heading_error_rad=nan)
    (back,) = rows_of(table_of([row]))
    assert isnan(back.path_m)
    assert back.heading_error_rad is not None
    assert isnan(back.heading_error_rad)


@each("column", ["world", "seed", "dirty", "path_m"])
def test_missing_required_value_is_refused(column: str) -> None:
    missing: dict[str, Any] = {column: None}
    with pytest.raises(ValueError, match=column):
        table_of(rows(1, **missing))
