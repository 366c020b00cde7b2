"""The process: the stop before everything, bounded lines of requests, and how it ends."""

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
    LEASE_SERVICE,
    OPERATOR,
    PARAMETER,
    PARAMETERS,
    STATUS,
    TELEOP,
    TEXT,
    Role,
)
from protocol.wire.codec import Encoder
from protocol.wire.enums import AckResult, Command, GoalState, LeaseAction, Mode
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    Heartbeat,
    LeaseRequest,
    MissionRequestList,
    ParamRequestRead,
    ParamSet,
    ParamValue,
    Teleop,
    WheelCommand,
)
from protocol.wire.reasons import Reason
from robot import telemetry
from robot.commands import acknowledge
from robot.core import states
from robot.core.budget import GUARD, NAVIGATE, ODOMETRY, READ, TICK_US
from robot.process import SERVICES
from robot.stop_latch import emergency_stop
from robot.storage.files import Store
from runtime.clock import Tick
from runtime.errors import LocalError
from tests.support.robot.held_writer import HeldWriter
from tests.support.robot.processes import ADA, BOB, Request, Rig
from tests.support.robot.vehicles import MS, goal

S = 1_000 * MS
BRAKE = (0, 0, 0)


def hold(request_id: int) -> CommandRequest:
    return CommandRequest(
        request_id=request_id, command=Command.DO_PAUSE_CONTINUE, param1=0.0, param2=0.0
    )


def speeds(command: WheelCommand) -> tuple[int, int, int]:
    return command.left_mrad_s, command.right_mrad_s, command.ttl_ms


def press(rig: Rig, request_id: int = 7, operator: str = ADA) -> None:
    """Let a stop arrive on its own topic."""
    rig.bus.press(operator, Encoder(1, 1).encode(emergency_stop(request_id)))


def ask_to_stop(rig: Rig, request_id: int = 7, operator: str = ADA) -> Request:
    """Let a stop arrive on its own service, which presses as well."""
    request = Request(emergency_stop(request_id), operator)
    press(rig, request_id, operator)
    rig.bus.take_stop(request)
    return request


def driving() -> Rig:
    rig = Rig().ready()
    rig.ask(goal(1, 3.0, 0.0))
    for _ in range(5):
        rig.cycle()
    assert speeds(rig.command)[0] > 0
    return rig


# What it serves.


def test_all_services_the_stop_and_the_clock_are_served() -> None:
    rig = Rig().serve()
    assert rig.bus.services.keys() == {service.path for service in SERVICES}
    assert rig.bus.has_clock
    rig.cycle()
    assert rig.bus.kept_serving == 1


# The emergency stop.


def test_a_stop_brakes_in_the_next_period() -> None:
    rig = driving()
    press(rig)
    rig.cycle()
    assert rig.vehicle.stopped
    assert speeds(rig.command) == BRAKE
    assert rig.sent(STATUS)[-1].stop_id == 7


def test_a_stop_among_the_commands_is_a_stop() -> None:
    rig = driving()
    stop = rig.ask(emergency_stop(7), operator="", good_for_ns=None)
    rig.cycle()
    assert rig.vehicle.stopped
    assert stop.reasons == [Reason.NONE]


def test_a_stop_is_acted_upon_before_the_requests_that_came_earlier() -> None:
    rig = Rig().ready()
    drive = rig.ask(goal(1, 3.0, 0.0))
    press(rig)
    rig.cycle()
    assert drive.reasons == [Reason.EMERGENCY_STOPPED]


def test_a_stop_passes_full_lines() -> None:
    rig = driving()
    for request_id in range(100):
        rig.ask(hold(request_id))
    stop = rig.ask(emergency_stop(7))
    press(rig, 8, operator="")
    rig.cycle()
    assert rig.vehicle.stopped
    assert stop.reasons == [Reason.NONE]


@pytest.mark.parametrize("idle", [False, True])
def test_a_stop_is_acknowledged_when_it_holds_and_not_before(idle: bool) -> None:
    rig = driving()
    stop = ask_to_stop(rig)
    assert stop.answers == []
    if idle:
        rig.process.idle()
    else:
        rig.cycle()
    (answer,) = stop.answers
    assert isinstance(answer, CommandAck)
    assert (answer.command, answer.result) == (Command.DO_FLIGHTTERMINATION, AckResult.ACCEPTED)
    assert rig.vehicle.stopped


def test_who_asks_for_a_stop_is_answered_although_the_loop_was_faster() -> None:
    """In lockstep the loop sleeps until it is nudged: the asker came when it slept again."""
    rig = Rig()
    rig.process.serve(nudge=rig.process.idle)
    rig.cycle()
    press(rig)
    assert rig.vehicle.stopped
    stop = Request(emergency_stop(7))
    rig.bus.take_stop(stop)
    assert stop.reasons == [Reason.NONE]


def test_who_asks_for_a_stop_that_was_cleared_hears_nothing_and_asks_again() -> None:
    rig = driving()
    late = Request(emergency_stop(7))
    rig.bus.take_stop(late)
    rig.cycle()
    assert (late.answers, late.dropped) == ([], True)


def test_of_those_who_ask_for_a_stop_the_first_64_are_answered() -> None:
    rig = driving()
    asked = [ask_to_stop(rig, request_id) for request_id in range(70)]
    rig.cycle()
    assert [len(one.answers) for one in asked] == [1] * 64 + [0] * 6
    assert [one.dropped for one in asked] == [False] * 64 + [True] * 6
    rig.cycle()
    assert sum(len(one.answers) for one in asked) == 64, "each once"


def clear(request_id: int) -> CommandRequest:
    return CommandRequest(
        request_id=request_id,
        command=Command.SIDESTEP_CLEAR_EMERGENCY_STOP,
        param1=0.0,
        param2=0.0,
    )


def arm(request_id: int) -> CommandRequest:
    return CommandRequest(
        request_id=request_id, command=Command.COMPONENT_ARM_DISARM, param1=1.0, param2=0.0
    )


def test_a_release_that_came_before_a_stop_does_not_undo_it() -> None:
    """The stop overtook the release, was acknowledged, and the robot drove on."""
    rig = driving()
    earlier = [rig.ask(one) for one in (clear(21), arm(22), goal(23, 3.0, 0.0))]
    rig.clock.advance(MS)
    stop = ask_to_stop(rig)
    rig.cycle()
    assert stop.reasons == [Reason.NONE]
    assert [one.reasons for one in earlier] == [[Reason.EMERGENCY_STOPPED]] * 3
    assert rig.vehicle.stopped
    assert speeds(rig.command) == BRAKE


def test_a_release_without_a_stop_is_granted() -> None:
    rig = driving()
    release = rig.ask(clear(21))
    rig.cycle()
    assert release.reasons == [Reason.NONE]


@pytest.mark.parametrize("same_id", [False, True])
def test_a_release_that_came_after_a_stop_undoes_it(same_id: bool) -> None:
    rig = driving()
    early = rig.ask(clear(21))
    rig.clock.advance(MS)
    press(rig)
    rig.cycle()
    late = rig.ask(clear(21 if same_id else 22))
    rig.cycle()
    assert (early.reasons, late.reasons) == ([Reason.EMERGENCY_STOPPED], [Reason.NONE])
    assert not rig.vehicle.stopped


def test_a_stop_is_recorded_once_for_each_id() -> None:
    rig = driving()
    before = len(rig.sent(COMMANDED))
    for request_id in (7, 7, 8, 8):
        press(rig, request_id)
        rig.cycle()
    recorded = rig.sent(COMMANDED)[before:]
    assert [one.request_id for one in recorded if isinstance(one, CommandRequest)] == [7, 8]


def test_a_stop_under_the_same_id_after_it_was_cleared_is_recorded_again() -> None:
    rig = driving()
    before = len(rig.sent(COMMANDED))
    for _ in range(2):
        press(rig)
        rig.cycle()
        rig.vehicle.state.machine.vehicle = states.ACTIVE
    assert len(rig.sent(COMMANDED)) == before + 2


# Requests.


def test_a_request_is_answered_recorded_and_nudges_the_loop() -> None:
    rig = Rig().ready()
    request = rig.ask(hold(5))
    assert (request.answers, rig.nudges) == ([], 1)
    rig.cycle()
    assert request.reasons == [Reason.NONE]
    assert rig.sent(COMMANDED)[-1] == request.message
    assert rig.sent(ANSWERED)[-1] == request.answers[0]
    press(rig)
    assert rig.nudges == 2


def test_six_requests_of_each_line_are_answered_in_a_period_the_oldest_first() -> None:
    rig = Rig().ready()
    rig.vehicle.receive(lease(LeaseAction.TAKE), rig.clock.now_ns(), ADA)
    mine = [rig.ask(hold(number), ADA) for number in range(10)]
    others = [rig.ask(hold(number), BOB) for number in range(10)]
    rig.cycle()
    for asked in (mine, others):
        assert [len(one.answers) for one in asked] == [1] * 6 + [0] * 4
    rig.cycle()
    assert all(one.reasons == [Reason.NONE] for one in mine)
    assert all(one.reasons == [Reason.LEASE_HELD] for one in others)


def lease(action: int) -> LeaseRequest:
    return LeaseRequest(request_id=1, action=action, name="")


def test_of_too_many_requests_the_rest_is_refused_at_once() -> None:
    rig = Rig().ready()
    asked = [rig.ask(hold(number)) for number in range(70)]
    assert [len(one.answers) for one in asked] == [0] * 64 + [1] * 6
    (answer,) = asked[-1].answers
    assert isinstance(answer, CommandAck)
    assert answer.result == AckResult.TEMPORARILY_REJECTED
    assert answer.result_param2 == Reason.TOO_MANY_REQUESTS
    assert rig.nudges == 64


def test_strangers_do_not_fill_the_line_of_the_lease_holder() -> None:
    rig = Rig().ready()
    rig.vehicle.receive(lease(LeaseAction.TAKE), rig.clock.now_ns(), ADA)
    for number in range(70):
        rig.ask(hold(number), BOB)
    mine = rig.ask(hold(1), ADA)
    rig.cycle()
    assert mine.reasons == [Reason.NONE]


def test_a_request_without_an_operator_is_refused() -> None:
    rig = Rig().ready()
    request = rig.ask(goal(1, 1.0, 0.0), operator="")
    rig.cycle()
    assert request.reasons == [Reason.NO_IDENTITY]
    assert rig.vehicle.state.machine.goal is None


@pytest.mark.parametrize(
    ("good_for_ns", "reason"),
    [
        (None, Reason.TOO_LATE),
        (50 * MS - 1, Reason.TOO_LATE),
        (50 * MS, Reason.NONE),
        (50 * MS + 60 * S, Reason.NONE),
        (50 * MS + 60 * S + 1, Reason.TOO_LATE),
    ],
)
def test_a_request_counts_until_its_deadline_that_is_at_most_a_minute_away(
    good_for_ns: int | None, reason: Reason
) -> None:
    """It is looked at a period of 50 ms after it has come."""
    rig = Rig().ready()
    request = rig.ask(goal(1, 1.0, 0.0), good_for_ns=good_for_ns)
    rig.cycle()
    assert request.reasons == [reason]
    assert (rig.vehicle.state.machine.goal is None) == (reason != Reason.NONE)


def test_to_look_needs_neither_operator_nor_deadline() -> None:
    rig = Rig().ready()
    read = ParamRequestRead(param_id="d_obs_m", param_index=-1)
    looks = [rig.ask(one, "", good_for_ns=None) for one in (read, MissionRequestList())]
    described = rig.ask(None, "", good_for_ns=None, service=PARAMETERS)
    rig.cycle()
    assert all(len(one.answers) == 1 and not one.reasons for one in looks)
    assert described.answers == [rig.vehicle.tuning.described()]


def test_parameters_and_lease_are_asked_in_the_same_lines() -> None:
    rig = Rig().ready()
    taken = rig.ask(lease(LeaseAction.TAKE), service=LEASE_SERVICE)
    read = rig.ask(ParamRequestRead(param_id="nonsense", param_index=-1), service=PARAMETER)
    rig.cycle()
    assert taken.reasons == [Reason.NONE]
    assert read.reasons == [Reason.UNKNOWN_PARAMETER]
    assert rig.vehicle.lease.is_holder(ADA)


def test_requests_are_answered_between_two_ticks() -> None:
    rig = Rig().ready()
    request = rig.ask(hold(5))
    rig.process.idle()
    assert request.reasons == [Reason.NONE]


@pytest.mark.parametrize("end", ["idle", "cycle", "end"])
def test_what_is_said_is_told_in_a_tick_between_two_and_at_the_end(end: str) -> None:
    rig = Rig().ready()
    rig.vehicle.say(6, "something new")
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
    assert rig.sent(INPUTS)[-1].flags == telemetry.WHEELS_THERE | telemetry.SCAN_THERE


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
        assert not rig.sent(INPUTS)[-1].flags & telemetry.BUDGET_VIOLATED
    assert rig.meter.overruns == 3
    rig.cycle()
    assert rig.vehicle.state.machine.vehicle_reason == Reason.BUDGET
    assert rig.sent(INPUTS)[-1].flags & telemetry.BUDGET_VIOLATED


def test_a_second_robot_of_the_name_stops_this_one_while_it_is_there() -> None:
    rig = driving()
    rig.bus.come(Role.ROBOT, "r1", "theirs")
    rig.cycle()
    assert rig.vehicle.state.machine.vehicle_reason == Reason.NAME_TAKEN
    assert rig.sent(INPUTS)[-1].flags & telemetry.NAME_TAKEN
    rig.bus.go(Role.ROBOT)
    rig.cycle()
    assert not rig.sent(INPUTS)[-1].flags & telemetry.NAME_TAKEN
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
