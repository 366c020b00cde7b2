"""The enumerations of protocol and core equal those of the dialect, and each has words."""

from enum import IntEnum
from types import ModuleType

from protocol.dialect.definitions import read_dialect
from protocol.dialect.generate import CLASS_OF_ENUM, CONSTANTS
from protocol.wire import enums
from protocol.wire.enums import Branch, GoalState, Mode, Navigator, Vehicle
from protocol.wire.reasons import Reason, reason_text
from robot.core import reasons, states
from tests.support.each import each

DIALECT = read_dialect()
CORE_STATES = (Vehicle, Mode, GoalState, Navigator)


@each("name", DIALECT.enums)
def test_every_enum_of_the_dialect_has_its_members(name: str) -> None:
    members = {entry.name: entry.value for entry in DIALECT.enums[name].entries}
    if name in CONSTANTS:
        prefix = CONSTANTS[name]
        assert members == {key: getattr(enums, f"{prefix}_{key}") for key in members}
    else:
        cls = Reason if name == "SIDESTEP_REASON" else getattr(enums, CLASS_OF_ENUM[name])
        assert members == {member.name: member.value for member in cls}


@each("numbers", CORE_STATES)
def test_states_of_the_core_are_those_of_the_dialect(numbers: type[IntEnum]) -> None:
    assert all(getattr(states, member.name) == member.value for member in numbers)


def test_branches_of_the_core_are_those_of_the_dialect() -> None:
    names = ("TO_GOAL", "PASS_LEFT", "PASS_RIGHT", "ALIGN", "GIVE_UP", "LOST")
    core = {"NONE": states.NO_BRANCH} | {name: getattr(states, name) for name in names}
    assert core == {member.name: member.value for member in Branch}


def test_reasons_of_the_core_are_those_of_the_dialect() -> None:
    core = {{"OK": "NONE"}.get(name, name): n for name, n in constants(reasons).items()}
    assert core == {member.name: member.value for member in Reason}


def constants(module: ModuleType) -> dict[str, int]:
    return {name: n for name, n in vars(module).items() if name.isupper() and isinstance(n, int)}


def test_every_reason_has_words() -> None:
    words = {entry.value: entry.words for entry in DIALECT.enums["SIDESTEP_REASON"].entries}
    assert words == {reason.value: reason_text(reason) for reason in Reason}
    assert all(words.values())


def test_an_unknown_reason_is_shown_as_its_number() -> None:
    assert reason_text(255) == "reason 255"
