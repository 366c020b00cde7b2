"""The parameters of the plant's robot and of the control core describe the same robot."""

from dataclasses import fields

from plant.model.configuration import Body
from robot.core.parameters import DEFAULTS, Params
from runtime.config import RENAMED, SAME, parameters_of

UNKNOWN_TO_THE_ROBOT = {
    "brake_m_s2",
    "motor_lag_s",
    "left_start_ticks",
    "right_start_ticks",
    "sonar_min_m",
}


def test_without_a_table_nothing_is_overridden() -> None:
    assert parameters_of({}) == {}


def test_changed_dimensions_become_parameters() -> None:
    values = parameters_of({"track_m": 0.16, "max_speed_m_s": 0.5, "ticks_per_m": 4000})
    assert values == {
        "track_m": 0.16,
        "wheel_max_m_s": 0.5,
        "v_max_m_s": 0.5,
        "m_per_tick": 1 / 4000,
    }


def test_every_dimension_is_passed_on_or_listed_as_not() -> None:
    known = {*SAME, *RENAMED, "ticks_per_m"}
    assert known | UNKNOWN_TO_THE_ROBOT == {field.name for field in fields(Body)}
    assert not known & UNKNOWN_TO_THE_ROBOT


def test_default_robots_of_plant_and_core_are_equal() -> None:
    body = Body()
    passed_on = {*SAME, *RENAMED, "ticks_per_m"}
    table = {name: getattr(body, name) for name in passed_on}
    for name, value in parameters_of(table).items():
        assert name in Params._fields
        assert getattr(DEFAULTS, name) == value
