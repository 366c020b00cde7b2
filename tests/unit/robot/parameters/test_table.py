from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.core.parameters import DEFAULTS, Params
from robot.parameter_table import (
    SPECS,
    TABLE,
    OutOfRangeError,
    UnknownParameterError,
    adjusted,
    described,
    with_value,
    with_values,
)
from runtime.errors import UserError
from tests.support.each import each


def test_every_setting_of_the_core_has_one_row_in_the_same_order() -> None:
    assert tuple(spec.name for spec in TABLE) == Params._fields


def test_every_default_is_within_its_own_range() -> None:
    for spec in TABLE:
        assert with_value(DEFAULTS, spec.name, spec.default) == DEFAULTS


def test_names_fit_a_mavlink_parameter_id() -> None:
    assert max(len(spec.name) for spec in TABLE) <= 16


def test_a_value_is_put_into_force_and_nothing_else_changes() -> None:
    changed = with_value(DEFAULTS, "d_obs_m", 0.45)
    assert changed.d_obs_m == 0.45
    assert with_value(changed, "d_obs_m", DEFAULTS.d_obs_m) == DEFAULTS


def test_several_values_are_put_into_force() -> None:
    changed = with_values(DEFAULTS, {"d_obs_m": 0.45, "side": -1.0})
    assert (changed.d_obs_m, changed.side) == (0.45, -1)


@each("bad", [{"d_obs_cm": 30.0}, {"d_obs_m": inf}])
def test_error_for_a_bad_value_contains_its_place(bad: dict[str, float]) -> None:
    with pytest.raises(UserError, match=r"^robot\.toml: .*d_obs_c?m"):
        adjusted(DEFAULTS, {"side": 1.0, **bad}, "robot.toml")


def test_an_unknown_name_is_named() -> None:
    with pytest.raises(UnknownParameterError, match="d_obs_cm"):
        with_value(DEFAULTS, "d_obs_cm", 30)


@each("value", [nan, inf, -inf, 0.0, 3.1, -1.0])
def test_values_outside_the_range_are_refused_with_the_range(value: float) -> None:
    with pytest.raises(OutOfRangeError, match=r"d_obs_m.*0\.05 to 3 m"):
        with_value(DEFAULTS, "d_obs_m", value)


def test_fraction_for_a_whole_number_is_refused() -> None:
    with pytest.raises(OutOfRangeError, match="whole number"):
        with_value(DEFAULTS, "stuck_ms", 2000.5)
    assert isinstance(with_value(DEFAULTS, "stuck_ms", 2000.0).stuck_ms, int)


def test_a_side_is_left_or_right() -> None:
    with pytest.raises(OutOfRangeError, match="one of 1, -1"):
        with_value(DEFAULTS, "side", 0)


@given(st.sampled_from(sorted(SPECS)), st.floats())
def test_accepted_values_are_within_their_range(name: str, value: float) -> None:
    try:
        changed = with_value(DEFAULTS, name, value)
    except OutOfRangeError:
        return
    assert SPECS[name].minimum <= getattr(changed, name) <= SPECS[name].maximum


def test_list_shows_unit_range_default_and_meaning() -> None:
    rows = described(with_value(DEFAULTS, "d_obs_m", 0.4))
    row = next(row for row in rows if row["name"] == "d_obs_m")
    assert (row["value"], row["default"], row["unit"]) == (0.4, 0.3, "m")
    assert (row["minimum"], row["maximum"], row["integer"]) == (0.05, 3.0, False)
    assert all(row["doc"] for row in rows)
