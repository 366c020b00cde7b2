"""Row 24: no parameter has an ArduRover name with another meaning."""

import re
from pathlib import Path

from gateways.mavlink.parameter_table import (
    MAVLINK_NAMES,
    MAX_NAME_BYTES,
    compatibility_parameters,
    mavlink_name,
)
from robot.parameter_table import SPECS
from tests.support.gateway.parameter_bench import robot_table

LIST = Path("tests/data/ardurover_parameters.txt")
COMPATIBLE = [one.name for one in compatibility_parameters()]


def ardurover() -> set[str]:
    return set(LIST.read_text(encoding="ascii").splitlines()[2:])


def numberless(name: str) -> str:
    return re.sub(r"\d+", "#", name)


def test_names_are_unique_reversible_and_short() -> None:
    assert set(MAVLINK_NAMES) == set(SPECS)
    assert len(set(MAVLINK_NAMES.values())) == len(SPECS)
    assert all(0 < len(name) <= MAX_NAME_BYTES for name in MAVLINK_NAMES.values())
    assert all(name.isascii() and name == name.upper() for name in MAVLINK_NAMES.values())


def test_no_name_is_one_of_ardurover() -> None:
    assert len(ardurover()) > 2000
    assert {numberless(name) for name in MAVLINK_NAMES.values()} & ardurover() == set()
    assert not set(MAVLINK_NAMES.values()) & set(COMPATIBLE)


def test_compatible_parameters_have_names_of_ardurover() -> None:
    assert {numberless(name) for name in COMPATIBLE} <= ardurover()
    assert len(set(COMPATIBLE)) == len(COMPATIBLE) == 4 + 12 + 15 + 3 + 2
    assert "FRAME_CLASS" not in COMPATIBLE


def test_radio_and_accelerometer_count_as_calibrated() -> None:
    values = {one.name: one.value for one in compatibility_parameters()}
    assert any(values[f"RC{channel}_MIN"] != 1100 for channel in (1, 2, 3, 4))
    assert all(values[f"INS_ACCOFFS_{axis}"] != 0 for axis in "XYZ")
    assert [values[f"COMPASS_USE{number}"] for number in ("", "2", "3")] == [0, 0, 0]


def test_compatible_parameters_are_not_in_the_robots_list() -> None:
    names = {mavlink_name(one.name) for one in robot_table().parameters}
    assert not names & set(COMPATIBLE)


def test_name_of_a_newer_robot_is_upper_case_or_hidden() -> None:
    assert mavlink_name("brand_new_m") == "BRAND_NEW_M"
    assert mavlink_name("a_name_longer_than_16") == ""
