from math import nan
from typing import Any

import pytest

from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from ground.client.operations.missions import JumpTo
from protocol.wire.enums import MissionState, Mode
from tests.support.gateway.fake_port import CLIENT, OTHER
from tests.support.gateway.messages import acks, command, command_int, words
from tests.support.gateway.mission_bench import MissionBench, line_of, of_type, upload

SET_CURRENT = mavlink.MAV_CMD_DO_SET_MISSION_CURRENT
RUNNING, HOLDING, DONE = MissionState.RUNNING, MissionState.HOLDING, MissionState.DONE


@pytest.fixture
def bench() -> MissionBench:
    bench = MissionBench()
    bench.face.join(CLIENT.client)
    upload(bench, line_of(4))
    bench.after(0.5)
    return bench


def choose(seq: int) -> MavMessage:
    return mavlink.MAVLink_mission_set_current_message(1, 1, seq)


def current(messages: list[MavMessage]) -> list[int]:
    return [one.seq for one in of_type(messages, "MISSION_CURRENT")]


def reached(messages: list[MavMessage]) -> list[int]:
    """Return the items that are reached, without repetitions."""
    return list(dict.fromkeys(one.seq for one in of_type(messages, "MISSION_ITEM_REACHED")))


def streamed(bench: MissionBench) -> Any:
    """Return the newest MISSION_CURRENT of the stream."""
    return of_type(bench.after(1.1), "MISSION_CURRENT")[-1]


def test_set_current_is_answered_at_once(bench: MissionBench) -> None:
    assert current(bench.send(choose(3))) == [3]
    assert bench.port.performed[-1] == JumpTo(item=3)


def test_answer_waits_for_the_robot(bench: MissionBench) -> None:
    bench.is_answering = False
    assert current(bench.send(choose(3))) == []
    bench.port.answer()
    assert current(bench.sent()) == [3]


def test_chosen_item_is_shown_until_the_robot_shows_it(bench: MissionBench) -> None:
    bench.send(choose(3))
    assert set(current(bench.after(0.2))) <= {3}
    assert set(current(bench.publish())) <= {3}
    assert streamed(bench).seq == 3


def test_item_0_is_taken_and_shown(bench: MissionBench) -> None:
    bench.send(choose(2))
    bench.publish()
    assert current(bench.send(choose(0))) == [0]
    assert bench.port.performed[-1] == JumpTo(item=1)
    bench.publish()
    assert streamed(bench).seq == 0
    bench.publish(state=RUNNING)
    assert streamed(bench).seq == 1


def test_new_mission_forgets_the_chosen_item(bench: MissionBench) -> None:
    bench.send(choose(0))
    upload(bench, line_of(2))
    assert streamed(bench).seq == 1


def test_command_224_is_acknowledged_and_answered(bench: MissionBench) -> None:
    sent = bench.send(command(SET_CURRENT, 2))
    assert (acks(sent), current(sent)) == ([(SET_CURRENT, 0)], [2])
    sent = bench.send(command_int(SET_CURRENT, 3, 1))
    assert (acks(sent), current(sent)) == ([(SET_CURRENT, 0)], [3])


@pytest.mark.parametrize("item", [nan, -1.0, 2.5, 1e9])
def test_command_224_denies_what_is_no_item(bench: MissionBench, item: float) -> None:
    sent = bench.send(command(SET_CURRENT, item))
    assert (acks(sent), current(sent)) == ([(SET_CURRENT, 2)], [])
    assert "parameter 1" in words(sent)


@pytest.mark.parametrize("seq", [5, 0xFFFF])
def test_item_that_does_not_exist_is_refused(bench: MissionBench, seq: int) -> None:
    sent = bench.send(choose(seq))
    assert current(sent) == []
    assert words(sent).startswith(f"mission item {seq}: no such item")
    assert acks(bench.send(command(SET_CURRENT, seq))) == [(SET_CURRENT, 2)]


def test_client_without_control_cannot_choose(bench: MissionBench) -> None:
    sent = bench.send(choose(2), OTHER)
    assert current(sent) == []
    assert "another operator commands the robot: MAVLink 255" in words(sent)


def test_flood_of_choices_waits_in_bounded_memory(bench: MissionBench) -> None:
    bench.is_answering = False
    for seq in range(1, 500):
        bench.send(choose(seq))
    assert len(bench.port.waiting) == 1


def test_current_is_streamed_with_total_and_state(bench: MissionBench) -> None:
    found = of_type(bench.after(3), "MISSION_CURRENT")
    assert len(found) == 3
    facts = (found[0].seq, found[0].total, found[0].mission_state, found[0].mission_mode)
    assert facts == (1, 4, mavlink.MISSION_STATE_NOT_STARTED, 2)


def test_no_mission_has_no_total(bench: MissionBench) -> None:
    bench.publish(waypoints=(), state=MissionState.NONE)
    found = streamed(bench)
    facts = (found.seq, found.total, found.mission_state)
    assert facts == (0, 0xFFFF, mavlink.MISSION_STATE_NO_MISSION)


@pytest.mark.parametrize(
    ("state", "shown"), [(RUNNING, 3), (HOLDING, 3), (DONE, 5), (MissionState.PAUSED, 4), (99, 1)]
)
def test_state_of_the_mission_is_shown(bench: MissionBench, state: int, shown: int) -> None:
    bench.publish(state=state, mode=Mode.AUTO)
    found = streamed(bench)
    assert (found.mission_state, found.mission_mode) == (shown, 1)


def test_next_item_is_announced_at_once(bench: MissionBench) -> None:
    bench.publish(state=RUNNING)
    assert 2 in current(bench.publish(current=1))


def test_stale_status_is_not_sent(bench: MissionBench) -> None:
    bench.port.telemetry["mission"] = None
    assert current(bench.after(2)) == []


def states(bench: MissionBench, *steps: tuple[MissionState, int]) -> list[int]:
    """Let the robot go through states, each with an item; return the items that are reached."""
    return reached(
        [one for state, item in steps for one in bench.publish(state=state, current=item)]
    )


def test_each_item_is_reached_once(bench: MissionBench) -> None:
    steps = ((RUNNING, 0), (RUNNING, 1), (HOLDING, 1), (RUNNING, 2), (RUNNING, 3), (DONE, 3))
    assert states(bench, *steps) == [1, 2, 3, 4]


def test_pause_reaches_nothing(bench: MissionBench) -> None:
    paused = MissionState.PAUSED
    assert states(bench, (RUNNING, 0), (paused, 0), (RUNNING, 0), (paused, 1), (RUNNING, 1)) == []


def test_jump_reaches_nothing(bench: MissionBench) -> None:
    states(bench, (RUNNING, 0))
    bench.send(choose(2))
    assert states(bench, (RUNNING, 1)) == []
    assert states(bench, (RUNNING, 3)) == []


def test_reached_item_is_repeated_for_clients_that_miss_it(bench: MissionBench) -> None:
    assert states(bench, (RUNNING, 3), (DONE, 3)) == [4]
    found = of_type(bench.after(10), "MISSION_ITEM_REACHED")
    assert [one.seq for one in found] == [4] * 3


def test_item_can_be_reached_again(bench: MissionBench) -> None:
    assert states(bench, (RUNNING, 3), (DONE, 3)) == [4]
    assert states(bench, (RUNNING, 3), (DONE, 3)) == [4]
