"""The process: what it serves, what a period tells, and how it ends."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from protocol.bus.presence import Presence
from protocol.topics import (
    ANSWERED,
    COMMANDED,
    CYCLE,
    DRIVE,
    INPUTS,
    OPERATOR,
    PARAMETER,
    STATUS,
    TELEOP,
    TEXT,
    Role,
)
from protocol.wire.enums import (
    INPUT_BUDGET,
    INPUT_NAME_TAKEN,
    INPUT_SCAN,
    INPUT_WHEELS,
    Command,
    GoalState,
    Mode,
)
from protocol.wire.messages import (
    CommandRequest,
    Heartbeat,
    ParamSet,
    ParamValue,
    Teleop,
    WheelCommand,
)
from protocol.wire.reasons import Reason
from robot.commands import acknowledge
from robot.core import states
from robot.core.budget import GUARD, NAVIGATE, ODOMETRY, READ, TICK_US
from robot.process import SERVICES
from robot.storage.files import Store
from runtime.clock import Tick
from runtime.errors import LocalError
from tests.support.robot.held_writer import HeldWriter
from tests.support.robot.processes import (
    ADA,
    BRAKE,
    Rig,
    driving,
    hold,
    speeds,
)
from tests.support.robot.vehicles import MS


def test_all_services_the_stop_and_the_clock_are_served() -> None:
    rig = Rig().serve()
    assert rig.bus.services.keys() == {service.path for service in SERVICES}
    assert rig.bus.has_clock
    rig.cycle()
    assert rig.bus.kept_serving == 1


@pytest.mark.parametrize("end", ["idle", "cycle", "end"])
def test_what_is_said_is_told_in_a_tick_between_two_and_at_the_end(end: str) -> None:
    rig = Rig().ready()
    rig.vehicle.announce(6, "something new")
    if end == "idle":
        rig.process.idle()
    elif end == "cycle":
        rig.cycle()
    else:
        rig.process.run(iter(()))
    assert "something new" in [text.text for text in rig.sent(TEXT)]


@pytest.mark.parametrize("end", ["cycle", "end"])
def test_what_is_to_be_saved_is_acknowledged_once_it_is(end: str, tmp_path: Path) -> None:
    writer = HeldWriter()
    rig = Rig(Store(tmp_path, writer)).ready()
    rig.vehicle.state.machine.vehicle = states.STANDBY
    wanted = ParamSet(param_id="d_obs_m", param_value=0.5, param_type=9)
    request = rig.ask(wanted, service=PARAMETER)
    rig.cycle()
    assert request.answers == []
    if end == "cycle":
        writer.finish()
        rig.cycle()
    else:
        rig.process.run(iter(()))
        rig.process.finish()
    (answer,) = request.answers
    assert isinstance(answer, ParamValue)


def test_what_was_restored_is_recorded_as_if_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig()
    answer = acknowledge(hold(5), Reason.NONE)
    monkeypatch.setattr(rig.vehicle, "restore", lambda: [(hold(5), answer)])
    rig.serve()
    assert (rig.sent(COMMANDED), rig.sent(ANSWERED)) == ([hold(5)], [answer])


# What a period tells.


def test_wheels_come_first() -> None:
    rig = driving()
    rig.bus.sent.clear()
    rig.cycle()
    assert isinstance(rig.bus.sent[0], WheelCommand)
    assert (rig.command.ttl_ms, rig.command.epoch) == (150, 0)
    assert rig.command.sense_seq == rig.ticks


def test_an_operator_steers_by_hand_and_the_inputs_tell_it() -> None:
    rig = Rig().ready()
    beat = Heartbeat(type=6, autopilot=8, base_mode=0, custom_mode=0, system_status=4)
    rig.bus.say_as(OPERATOR, beat, ADA)
    rig.cycle()
    rig.ask(command_to(Mode.MANUAL))
    frame = Teleop(time_ns=0, seq=0, speed_mm_s=200, yaw_rate_mrad_s=0, ttl_ms=500)
    rig.bus.say_as(TELEOP, frame, ADA)
    rig.cycle()
    assert speeds(rig.command)[0] > 0
    told = rig.sent(INPUTS)[-1]
    assert (told.speed_mm_s, told.tick) == (200, rig.ticks)
    assert told.requests == rig.process.reports.recorded == 1
    assert (told.wheels_seq, told.scan_seq) == (rig.ticks, rig.ticks)


def command_to(mode: Mode) -> CommandRequest:
    return CommandRequest(request_id=9, command=Command.DO_SET_MODE, param1=1.0, param2=mode)


def test_an_account_of_each_period_is_told() -> None:
    rig = Rig().ready()
    rig.bus.rejected = {"one": 2, "two": 3}
    rig.cycle()
    told = rig.sent(CYCLE)[-1]
    assert (told.tick, told.rejected, told.sense_age_us) == (rig.ticks, 5, 0)


def test_inputs_tell_which_senses_were_there() -> None:
    rig = Rig().serve()
    rig.process.cycle(Tick(0, rig.clock.now_ns(), 0, 0))
    assert rig.sent(INPUTS)[-1].flags == 0
    rig.cycle()
    assert rig.sent(INPUTS)[-1].flags == INPUT_WHEELS | INPUT_SCAN


def test_what_comes_before_the_core_is_the_cost_of_reading() -> None:
    rig = Rig().ready()
    rig.bus.serving_ns = 2 * MS
    rig.cycle()
    stages_us = rig.sent(CYCLE)[-1].stage_us
    assert [stages_us[stage] for stage in (READ, ODOMETRY, NAVIGATE, GUARD)] == [2_000, 0, 0, 0]


class Slow:
    """Lets time pass while the core thinks."""

    def __init__(self, rig: Rig, spent_ns: int) -> None:
        self._rig, self._spent_ns, self._step = rig, spent_ns, rig.vehicle.step

    def __call__(self, *given: object) -> object:
        self._rig.clock.advance(self._spent_ns)
        return self._step(*given)  # type: ignore[arg-type]


def test_the_age_of_the_senses_counts_until_the_wheels_are_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = Rig().ready()
    monkeypatch.setattr(rig.vehicle, "step", Slow(rig, 3 * MS))
    rig.cycle()
    assert rig.sent(CYCLE)[-1].sense_age_us == 3_000


def test_three_periods_over_the_budget_stop_the_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(enforced=True).ready()
    monkeypatch.setattr(rig.vehicle, "step", Slow(rig, (TICK_US + 1) * 1_000))
    for _ in range(3):
        rig.cycle()
        assert rig.vehicle.state.machine.vehicle == states.ACTIVE
        assert not rig.sent(INPUTS)[-1].flags & INPUT_BUDGET
    assert rig.meter.overruns == 3
    rig.cycle()
    assert rig.vehicle.state.machine.vehicle_reason == Reason.BUDGET
    assert rig.sent(INPUTS)[-1].flags & INPUT_BUDGET


def test_a_second_robot_of_the_name_stops_this_one_while_it_is_there() -> None:
    rig = driving()
    rig.bus.come(Role.ROBOT, "r1", "theirs")
    rig.cycle()
    assert rig.vehicle.state.machine.vehicle_reason == Reason.NAME_TAKEN
    assert rig.sent(INPUTS)[-1].flags & INPUT_NAME_TAKEN
    rig.bus.go(Role.ROBOT)
    rig.cycle()
    assert not rig.sent(INPUTS)[-1].flags & INPUT_NAME_TAKEN
    assert Presence("r1", Role.ROBOT.value, "theirs") not in rig.bus.there


# How it ends.


def ticks(rig: Rig, count: int, stop_in: int = 0) -> Iterator[Tick]:
    """So many ticks; in one of them the process is told to stop."""
    for number in range(1, count + 1):
        tick = rig.next_tick()
        if number == stop_in:
            rig.process.stop()
        yield tick


def ended(rig: Rig) -> tuple[int, int, int, int]:
    machine = rig.vehicle.state.machine
    return machine.vehicle, machine.vehicle_reason, machine.goal_state, machine.goal_reason


def test_it_ends_after_the_tick_in_which_it_is_told_to() -> None:
    rig = driving()
    before = rig.ticks
    rig.process.run(ticks(rig, 10, stop_in=4))
    assert rig.ticks == before + 4
    assert rig.sent(INPUTS)[-1].tick == rig.ticks, "that tick was run"


def test_at_the_end_the_wheels_stand_and_the_goal_ends() -> None:
    rig = driving()
    rig.process.run(ticks(rig, 2))
    assert speeds(rig.command) == BRAKE
    assert rig.command.sense_seq == rig.ticks
    aborted = (GoalState.ABORTED, Reason.SHUT_DOWN)
    assert ended(rig) == (states.FAILSAFE, Reason.SHUT_DOWN, *aborted)
    status = rig.sent(STATUS)[-1]
    assert (status.goal, status.goal_reason) == aborted


def test_an_exception_of_the_core_brakes_and_goes_on_upwards(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = driving()

    def broken(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(rig.vehicle, "step", broken)
    with pytest.raises(ZeroDivisionError):
        rig.process.run(ticks(rig, 2))
    assert speeds(rig.command) == BRAKE
    aborted = (GoalState.ABORTED, Reason.CORE_EXCEPTION)
    assert ended(rig) == (states.FAILSAFE, Reason.CORE_EXCEPTION, *aborted)


def test_the_end_waits_three_seconds_for_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = driving()
    patience_s: list[float] = []
    monkeypatch.setattr(rig.vehicle, "finish_saving", patience_s.append)
    rig.process.finish()
    assert patience_s == [3.0]


def test_what_cannot_be_told_at_the_end_keeps_no_wheel_turning(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = driving()

    def unfit(*_: object) -> None:
        raise LocalError("no time")

    monkeypatch.setattr(rig.process.reports, "state", unfit)
    rig.process.run(iter(()))
    assert speeds(rig.command) == BRAKE


def test_the_brake_is_the_first_and_only_command_of_the_end() -> None:
    rig = driving()
    before = len(rig.sent(DRIVE))
    rig.bus.sent.clear()
    rig.process.run(iter(()))
    assert isinstance(rig.bus.sent[0], WheelCommand)
    assert len(rig.sent(DRIVE)) == before + 1
