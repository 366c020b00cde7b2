"""The scripts of clients that cannot run, the pinned versions, and the reader of results."""

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from tests.interop.clients.shaped_client import (
    SCRIPTS,
    USER_S,
    Script,
    as_float,
    matches,
    ordered_lengths,
)
from tests.interop.clients.steps import STEPS, Call, Place, StepError, goal
from tests.interop.environments import clients, pins_of
from tests.interop.scenario import CLIENTS, read

NAMES = sorted(path.stem for path in SCRIPTS.glob("*.toml"))
START = Place(-35.36, 149.16)


@pytest.fixture
def notes() -> list[str]:
    """Return the notes of the script."""
    return []


@pytest.fixture
def script(tmp_path: Path, notes: list[str]) -> Script:
    """Return a script without a connection; the robot starts at START."""
    pilot: Any = None
    made = Script(pilot, Call("127.0.0.1", 1, tmp_path, tmp_path), notes.append)
    made.start = START
    return made


def actions_of(name: str) -> list[dict[str, Any]]:
    steps = tomllib.loads((SCRIPTS / f"{name}.toml").read_text(encoding="utf-8"))["steps"]
    return [action for step in steps for action in step["actions"]]


@pytest.mark.parametrize("name", NAMES)
def test_script_has_every_step_in_order(name: str) -> None:
    steps = tomllib.loads((SCRIPTS / f"{name}.toml").read_text(encoding="utf-8"))["steps"]
    assert [step["name"] for step in steps] == list(STEPS)


@pytest.mark.parametrize("name", NAMES)
def test_each_action_names_where_it_was_read(name: str, script: Script) -> None:
    for action in actions_of(name):
        assert action["kind"] in script.kinds
        assert re.search(r"\.(cc|cpp|hpp|cs)\b", action["source"]), action
        assert action["read"]


@pytest.mark.parametrize("name", NAMES)
def test_each_message_of_a_script_can_be_built(name: str, script: Script) -> None:
    built = [script.message(one) for action in actions_of(name) for one in action.get("send", ())]
    assert built
    assert all(one.get_type() for one in built)


def test_message_is_for_this_vehicle_unless_it_says_otherwise(script: Script) -> None:
    usual = script.message({"message": "COMMAND_LONG", "command": 400})
    assert (usual.target_system, usual.target_component, usual.param1) == (1, 1, 0)
    everyone = script.message({"message": "COMMAND_LONG", "command": 520, "target_system": 0})
    assert everyone.target_system == 0


def test_goal_stands_for_a_place_in_whole_degrees_e7(script: Script) -> None:
    there = script.message(
        {"message": "COMMAND_INT", "command": 192, "x": "goal.latitude", "y": "goal.longitude"}
    )
    assert (there.x, there.y) == tuple(round(value * 1e7) for value in goal(START))


@pytest.mark.parametrize(("kind", "is_tried_again"), [("exchange", True), ("arrive", False)])
def test_user_repeats_what_the_client_gave_up(
    kind: str, is_tried_again: bool, script: Script, notes: list[str]
) -> None:
    outcomes = [StepError("lost"), None]

    def act(_action: object) -> None:
        outcome = outcomes.pop(0)
        if outcome is not None:
            raise outcome

    script.kinds[kind] = act
    action = {"kind": kind, "read": "arming", "source": "command.cpp"}
    if is_tried_again:
        script.run(action)
        assert notes == ["tried again: arming"]
        assert outcomes == []
    else:
        with pytest.raises(StepError, match="arming"):
            script.run(action)


def test_user_gives_up_after_some_time(script: Script, monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = 0.0

    def fail(_action: object) -> None:
        nonlocal now_s
        now_s += USER_S / 2
        raise StepError("lost")

    monkeypatch.setattr("time.monotonic", lambda: now_s)
    script.kinds["exchange"] = fail
    with pytest.raises(StepError, match="lost"):
        script.run({"kind": "exchange", "read": "arming", "source": "command.cpp"})
    assert now_s == USER_S


def test_expectation_compares_values_and_bits(script: Script) -> None:
    beat = script.message({"message": "HEARTBEAT", "base_mode": 129, "custom_mode": 10})
    assert matches(beat, {"message": "HEARTBEAT", "where": {"custom_mode": 10}})
    assert matches(beat, {"message": "HEARTBEAT", "bits": {"base_mode": 128}})
    assert not matches(beat, {"message": "HEARTBEAT", "where": {"custom_mode": 4}})
    assert not matches(beat, {"message": "HEARTBEAT", "bits": {"base_mode": 64}})
    assert not matches(beat, {"message": "SYS_STATUS"})


def test_float_item_has_degrees(script: Script) -> None:
    whole = script.message({"message": "MISSION_ITEM_INT", "seq": 2, "x": -353600000})
    assert (as_float(whole).seq, as_float(whole).x) == (2, -35.36)
    assert len(ordered_lengths(type(whole))) == len(whole.fieldnames)


def test_each_environment_belongs_to_a_client_and_pins_exact_versions() -> None:
    assert clients() == sorted(one.environment for one in CLIENTS if one.environment)
    for client in clients():
        assert all(re.fullmatch(r"[\w.-]+(==|@)[\w.-]+", pin) for pin in pins_of(client))


def lines(*fields: dict[str, object]) -> str:
    return "\n".join(json.dumps(one) for one in fields)


def test_failures_name_the_step_and_its_reason() -> None:
    passed = {"step": "connect", "passed": True, "seconds": 0.1}
    failed = {"step": "goto", "passed": False, "seconds": 9.0, "error": "no place"}
    found = read(lines({"begins": "connect"}, passed, {"begins": "goto"}, failed) + "\nexit code 1")
    assert found.failures == ["goto: no place"]


def test_step_in_which_the_process_ended_has_failed() -> None:
    found = read(lines({"begins": "upload"}) + "\nTraceback\nexit code -9")
    assert found.failures == ["upload: the process ended in it: ['Traceback']"]


def test_process_that_failed_without_a_step_has_failed() -> None:
    assert read("no module\nexit code 1").failures == ["exit code 1: ['no module']"]
    assert read("exit code 0").failures == []
