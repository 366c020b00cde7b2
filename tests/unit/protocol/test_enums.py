"""Numbers that are written down in three places are the same in all of them."""

from enum import IntEnum
from types import ModuleType

import pytest

from protocol import enums
from protocol.dialect import generated
from protocol.enums import (
    AckResult,
    Branch,
    Command,
    GoalState,
    LeaseAction,
    MissionState,
    MissionType,
    Mode,
    Navigator,
    RunAction,
    Severity,
    SystemState,
    Vehicle,
)
from protocol.reasons import Reason, reason_text
from robot.core import reasons, states

WHOLE = {
    "SIDESTEP_VEHICLE": Vehicle,
    "SIDESTEP_MODE": Mode,
    "SIDESTEP_GOAL": GoalState,
    "SIDESTEP_NAVIGATOR": Navigator,
    "SIDESTEP_BRANCH": Branch,
    "SIDESTEP_REASON": Reason,
    "SIDESTEP_RUN_ACTION": RunAction,
    "SIDESTEP_LEASE_ACTION": LeaseAction,
    "SIDESTEP_MISSION": MissionState,
    "MAV_SEVERITY": Severity,
    "MAV_STATE": SystemState,
}
IN_PART = {"MAV_CMD": Command, "MAV_RESULT": AckResult, "MAV_MISSION_TYPE": MissionType}
CORE_STATES = (Vehicle, Mode, GoalState, Navigator)


def in_dialect(name: str) -> dict[str, int]:
    entries = {entry.name: number for number, entry in generated.enums[name].items()}
    return {key.removeprefix(f"{name}_"): n for key, n in entries.items() if "ENUM_END" not in key}


@pytest.mark.parametrize("name", WHOLE)
def test_members_are_those_of_the_dialect(name: str) -> None:
    assert {member.name: member.value for member in WHOLE[name]} == in_dialect(name)


@pytest.mark.parametrize("name", IN_PART)
def test_members_in_use_have_the_numbers_of_the_dialect(name: str) -> None:
    dialect = in_dialect(name)
    assert {m.name: m.value for m in IN_PART[name]}.items() <= dialect.items()


@pytest.mark.parametrize(
    ("name", "constant"),
    [
        ("MAV_TYPE_GCS", enums.TYPE_GCS),
        ("MAV_TYPE_GROUND_ROVER", enums.TYPE_GROUND_ROVER),
        ("MAV_AUTOPILOT_GENERIC", enums.AUTOPILOT_GENERIC),
        ("MAV_AUTOPILOT_INVALID", enums.AUTOPILOT_INVALID),
        ("MAV_MODE_FLAG_CUSTOM_MODE_ENABLED", enums.MODE_FLAG_CUSTOM_MODE_ENABLED),
        ("MAV_MODE_FLAG_SAFETY_ARMED", enums.MODE_FLAG_SAFETY_ARMED),
        ("MAV_FRAME_LOCAL_FLU", enums.FRAME_LOCAL_FLU),
        ("MAV_PARAM_TYPE_INT32", enums.PARAM_TYPE_INT32),
        ("MAV_PARAM_TYPE_REAL32", enums.PARAM_TYPE_REAL32),
    ],
)
def test_constants_have_the_numbers_of_mavlink(name: str, constant: int) -> None:
    assert getattr(generated, name) == constant


@pytest.mark.parametrize("numbers", CORE_STATES)
def test_states_of_the_core_are_those_of_the_dialect(numbers: type[IntEnum]) -> None:
    assert all(getattr(states, member.name) == member.value for member in numbers)


def test_branches_of_the_core_are_those_of_the_dialect() -> None:
    names = ("TO_GOAL", "PASS_LEFT", "PASS_RIGHT", "ALIGN", "GIVE_UP")
    core = {"NONE": states.NO_BRANCH} | {name: getattr(states, name) for name in names}
    assert core == {member.name: member.value for member in Branch}


def test_reasons_of_the_core_are_those_of_the_dialect() -> None:
    other_names = {"OK": "NONE", "BUSY_DRIVING": "DRIVING"}
    core = {other_names.get(name, name): number for name, number in constants(reasons).items()}
    assert core == {member.name: member.value for member in Reason}


def constants(module: ModuleType) -> dict[str, int]:
    return {name: n for name, n in vars(module).items() if name.isupper() and isinstance(n, int)}


def test_every_reason_has_words() -> None:
    for reason in Reason:
        assert reason_text(reason) == generated.enums["SIDESTEP_REASON"][reason].description


def test_an_unknown_reason_is_shown_as_its_number() -> None:
    assert reason_text(255) == "reason 255"
