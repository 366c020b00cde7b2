"""Requests at the process: bounded queues, operators, deadlines, and arbitrary ones."""

import sys
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Any, Final

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from checks.harness.messages import make
from protocol.topics import (
    ANSWERED,
    COMMANDED,
    LEASE,
    LEASE_SERVICE,
    OPERATOR,
    PARAMETER,
    PARAMETERS,
    TEXT,
)
from protocol.wire.codec import Encoder
from protocol.wire.enums import AckResult, Command, LeaseAction, Mode
from protocol.wire.message import Message, check
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    Heartbeat,
    LeaseRequest,
    MissionClearAll,
    MissionCount,
    MissionItemInt,
    MissionRequestInt,
    MissionRequestList,
    ParamRequestRead,
    ParamSet,
    Teleop,
)
from protocol.wire.reasons import Reason
from robot.core import modes, states
from robot.process import MAX_HALTED, MAX_PERSONS, MAX_WAITING
from runtime.clock import ManualClock, Tick
from runtime.units import NS_PER_MS as MS
from runtime.units import NS_PER_S as S
from tests.support.each import each
from tests.support.messages import any_message, messages_of
from tests.support.robots import (
    ADA,
    BOB,
    Request,
    Rig,
    arm,
    armed,
    driving,
    goal,
    hold,
    lease,
    press,
)

RESTART = CommandRequest(
    request_id=9, command=Command.PREFLIGHT_REBOOT_SHUTDOWN, param1=1.0, param2=0.0
)


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


def test_six_requests_per_queue_and_period_oldest_first() -> None:
    rig = Rig().ready()
    rig.vehicle.receive(lease(LeaseAction.TAKE), rig.clock.now_ns(), ADA)
    mine = [rig.ask(hold(number), ADA) for number in range(10)]
    others = [rig.ask(goal(number, 1.0, 0.0), BOB) for number in range(10)]
    rig.cycle()
    for asked in (mine, others):
        assert [len(one.answers) for one in asked] == [1] * 6 + [0] * 4
    rig.cycle()
    assert all(one.reasons == [Reason.NONE] for one in mine)
    assert all(one.reasons == [Reason.LEASE_HELD] for one in others)


def test_excess_requests_are_refused_at_once() -> None:
    rig = Rig().ready()
    asked = [rig.ask(hold(number)) for number in range(70)]
    assert [len(one.answers) for one in asked] == [0] * 64 + [1] * 6
    (answer,) = asked[-1].answers
    assert isinstance(answer, CommandAck)
    assert answer.result == AckResult.TEMPORARILY_REJECTED
    assert answer.result_param2 == Reason.TOO_MANY_REQUESTS
    assert rig.nudges == 64


def test_other_operators_do_not_fill_the_holders_queue() -> None:
    rig = Rig().ready()
    rig.vehicle.receive(lease(LeaseAction.TAKE), rig.clock.now_ns(), ADA)
    for number in range(70):
        rig.ask(goal(number, 1.0, 0.0), BOB)
        rig.ask(hold(number), BOB)
    mine = rig.ask(hold(1), ADA)
    rig.cycle()
    assert mine.reasons == [Reason.NONE]


STOPS = (
    hold(901),
    CommandRequest(request_id=902, command=Command.DO_SET_MODE, param1=1.0, param2=Mode.HOLD),
    CommandRequest(request_id=903, command=Command.SIDESTEP_ABORT_GOAL, param1=0.0, param2=0.0),
    CommandRequest(request_id=904, command=Command.COMPONENT_ARM_DISARM, param1=0.0, param2=0.0),
)
CAROL = "carol/3"


@each("request_of_other", STOPS)
def test_what_stops_is_accepted_in_two_periods_behind_a_flood(
    request_of_other: CommandRequest,
) -> None:
    """Let another person flood the robot with all that he may ask, before and after."""
    rig = driving()
    rig.vehicle.receive(lease(LeaseAction.TAKE), rig.clock.now_ns(), ADA)

    def flood(first: int) -> None:
        for number in range(first, first + 300):
            rig.ask(hold(number), BOB)
            rig.ask(goal(number, 1.0, 0.0), BOB)
            rig.ask(lease(LeaseAction.TAKE), BOB, service=LEASE_SERVICE)

    flood(1_000)
    asked = rig.ask(request_of_other, CAROL)
    rig.cycle()
    flood(2_000)
    rig.cycle()
    assert asked.reasons == [Reason.NONE]


def leased() -> Rig:
    """Return a rig whose lease is Ada's, so that each other person may only stop."""
    rig = Rig().ready()
    rig.vehicle.receive(lease(LeaseAction.TAKE), rig.clock.now_ns(), ADA)
    return rig


def persons(count: int, first: int = 0) -> list[str]:
    return [f"p{number}/1" for number in range(first, first + count)]


def answered(asked: list[Request]) -> int:
    return sum(bool(one.answers) for one in asked)


def test_a_period_answers_a_fixed_number_of_requests_to_stop() -> None:
    """Whatever names a stranger invents, the period costs the same."""
    rig = leased()
    asked = [rig.ask(hold(number), one) for one in persons(63) for number in range(64)]
    for done in range(1, 10):
        rig.cycle()
        assert answered(asked) == done * MAX_HALTED


def test_persons_stop_the_robot_in_turn_each_in_its_own_order() -> None:
    rig = leased()
    most = MAX_HALTED // 2
    asked = [[rig.ask(hold(number), one) for number in range(most + 1)] for one in (BOB, CAROL)]
    for done in (most, most + 1):
        rig.cycle()
        for of_one in asked:
            assert [len(one.answers) for one in of_one] == [1] * done + [0] * (most + 1 - done)


def test_a_new_person_waits_for_each_invented_name_once() -> None:
    rig = leased()
    rounds = -(-MAX_PERSONS // MAX_HALTED)
    for number in range(3 * rounds):  # the flood has gone on for some time
        for one in persons(MAX_PERSONS - 2):
            rig.ask(hold(number), one)
        rig.cycle()
    mine = rig.ask(hold(1), CAROL)
    for _ in range(rounds):
        assert not mine.answers
        for one in persons(MAX_PERSONS - 2):
            rig.ask(hold(rig.ticks), one)
        rig.cycle()
    assert mine.reasons == [Reason.NONE]


def test_who_has_not_been_answered_for_long_comes_first() -> None:
    rig = leased()
    rig.ask(hold(1), CAROL)
    for number in range(10):
        for one in persons(MAX_PERSONS - 2):
            rig.ask(hold(number), one)
        rig.cycle()
    mine = rig.ask(hold(2), CAROL)
    rig.cycle()
    assert mine.reasons == [Reason.NONE]


def test_names_that_wait_for_nothing_are_forgotten() -> None:
    """Names that a stranger has invented leave room for the next person."""
    rig = leased()
    for first in range(0, 5 * MAX_PERSONS, MAX_HALTED):
        for one in persons(MAX_HALTED, first):
            rig.ask(hold(1), one)
        rig.cycle()
    flood = [rig.ask(hold(number), BOB) for number in range(MAX_WAITING)]
    assert not answered(flood)
    mine = rig.ask(hold(1), CAROL)
    rig.cycle()
    assert mine.reasons == [Reason.NONE]


def test_persons_beyond_a_limit_share_what_is_left() -> None:
    rig = leased()
    for one in persons(64):
        rig.ask(hold(1), one)
    shared = [rig.ask(hold(number), f"q{number}/1") for number in range(MAX_WAITING + 1)]
    assert [len(one.answers) for one in shared] == [0] * MAX_WAITING + [1]
    assert shared[-1].reasons == [Reason.TOO_MANY_REQUESTS]
    for _ in range(-(-65 // MAX_HALTED)):
        rig.cycle()
    assert shared[0].reasons == [Reason.NONE]


def test_what_stops_does_not_overtake_what_its_person_asked_before() -> None:
    """Else the goal would begin after the hold that was to end it."""
    rig = Rig().ready()
    for _ in range(2):  # without a lease, and with it
        asked = rig.ask(goal(rig.ticks, 1.0, 0.0)), rig.ask(hold(rig.ticks + 100))
        rig.cycle()
        assert [one.reasons for one in asked] == [[Reason.NONE]] * 2
        assert rig.vehicle.state.machine.mode == states.HOLD
        rig.vehicle.receive(lease(LeaseAction.TAKE), rig.clock.now_ns(), ADA)


@each("request_of_other", STOPS)
def test_what_stops_needs_an_operator_and_a_deadline(request_of_other: CommandRequest) -> None:
    rig = Rig().ready()
    rig.vehicle.receive(lease(LeaseAction.TAKE), rig.clock.now_ns(), ADA)
    nobodys = rig.ask(request_of_other, operator="")
    late = rig.ask(request_of_other, BOB, good_for_ns=None)
    rig.cycle()
    assert nobodys.reasons == [Reason.NO_IDENTITY]
    assert late.reasons == [Reason.TOO_LATE]


def test_a_request_without_an_operator_is_refused() -> None:
    rig = Rig().ready()
    request = rig.ask(goal(1, 1.0, 0.0), operator="")
    rig.cycle()
    assert request.reasons == [Reason.NO_IDENTITY]
    assert rig.vehicle.state.machine.goal is None


@each(
    ("good_for_ns", "reason"),
    [
        (None, Reason.TOO_LATE),
        (50 * MS - 1, Reason.TOO_LATE),
        (50 * MS, Reason.NONE),
        (50 * MS + 60 * S, Reason.NONE),
        (50 * MS + 60 * S + 1, Reason.TOO_LATE),
    ],
)
def test_request_counts_until_a_deadline_within_a_minute(
    good_for_ns: int | None, reason: Reason
) -> None:
    """Read the request one period of 50 ms after its arrival."""
    rig = Rig().ready()
    request = rig.ask(goal(1, 1.0, 0.0), good_for_ns=good_for_ns)
    rig.cycle()
    assert request.reasons == [reason]
    assert (rig.vehicle.state.machine.goal is None) == (reason != Reason.NONE)


def test_reading_needs_no_operator_and_no_deadline() -> None:
    rig = Rig().ready()
    read = ParamRequestRead(param_id="d_obs_m", param_index=-1)
    looks = [rig.ask(one, "", good_for_ns=None) for one in (read, MissionRequestList())]
    described = rig.ask(None, "", good_for_ns=None, service=PARAMETERS)
    rig.cycle()
    assert all(len(one.answers) == 1 and not one.reasons for one in looks)
    assert described.answers == [rig.vehicle.parameters.describe()]


def test_parameter_and_lease_requests_use_the_same_queues() -> None:
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


def ticks(rig: Rig, count: int) -> Iterator[Tick]:
    for _ in range(count):
        yield rig.next_tick()


def test_restart_ends_the_loop_after_the_answer() -> None:
    rig = Rig().ready()
    rig.vehicle.state.machine.vehicle = states.STANDBY
    request = rig.ask(RESTART)
    before = rig.ticks
    rig.process.run(ticks(rig, 5))
    assert request.reasons == [Reason.NONE]
    assert rig.ticks == before + 1
    assert "restarting on request" in [one.text for one in rig.sent(TEXT)]


def test_restart_of_an_armed_robot_is_refused() -> None:
    rig = Rig().ready()
    request = rig.ask(RESTART)
    rig.process.run(ticks(rig, 5))
    assert request.reasons == [Reason.ARMED]
    assert rig.ticks == 6


ROBOT: Final = Path(__file__).resolve().parents[3] / "robot"
MOST_CALLS: Final = 6


def calls() -> list[str]:
    """Return the functions of the robot that call the caller, the innermost first."""
    found: list[str] = []
    frame: FrameType | None = sys._getframe(2)
    while frame is not None:
        path = Path(frame.f_code.co_filename)
        if path.is_relative_to(ROBOT):
            found.append(f"{path.stem}.{frame.f_code.co_name}")
        frame = frame.f_back
    return found


def asked_of(number: int, param1: float = 0.0, param2: float = 0.0) -> CommandRequest:
    return CommandRequest(request_id=5, command=number, param1=param1, param2=param2)


@each(
    ("request_of_one", "function"),
    [
        (arm(5), "arm"),
        (asked_of(Command.COMPONENT_ARM_DISARM), "disarm"),
        (asked_of(Command.DO_SET_MODE, 1.0, Mode.AUTO), "set_mode"),
        (asked_of(Command.DO_PAUSE_CONTINUE), "hold"),
        (asked_of(Command.DO_PAUSE_CONTINUE, 1.0), "resume"),
        (asked_of(Command.NAV_RETURN_TO_LAUNCH), "rtl"),
        (asked_of(Command.SIDESTEP_SET_NAVIGATOR, 1.0), "set_navigator"),
        (asked_of(Command.SIDESTEP_ABORT_GOAL), "abort"),
        (asked_of(Command.SIDESTEP_CLEAR_EMERGENCY_STOP), "clear_estop"),
        (goal(5, 1.0, 0.0), "goto"),
        ("stop", "estop"),
    ],
)
def test_a_request_reaches_the_mode_machine_in_six_calls(
    request_of_one: Message | str, function: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Count from the handler of the bus to the queue, and from the loop on."""
    to_queue: list[str] = []
    to_machine: list[str] = []
    act = getattr(modes, function)

    def enqueued() -> None:
        to_queue[:] = calls()

    def acted(*given: Any) -> Any:
        found = calls()
        if not to_machine:  # what follows from it comes later
            to_machine[:] = [function, *found[: found.index("process.cycle")]]
        return act(*given)

    rig = Rig()
    rig.process.serve(enqueued)
    rig.cycle()
    rig.vehicle.state.machine.vehicle = states.ACTIVE
    monkeypatch.setattr(modes, function, acted)
    if isinstance(request_of_one, str):
        press(rig)
    else:
        rig.ask(request_of_one)
    rig.cycle()
    assert to_queue
    assert to_machine
    assert len(to_queue) + len(to_machine) <= MOST_CALLS, [*to_machine, *to_queue]


LIKELY: Final[tuple[type[Message], ...]] = (
    CommandRequest,
    GoalRequest,
    LeaseRequest,
    MissionCount,
    MissionItemInt,
    MissionRequestInt,
    MissionClearAll,
    ParamSet,
)
requests = st.one_of(any_message, st.sampled_from(LIKELY).flatmap(messages_of))
askers = st.sampled_from(["", "ada", "bob"])


@settings(deadline=None)
@given(st.lists(st.tuples(requests, askers), max_size=30), messages_of(Teleop))
def test_any_request_gets_an_answer_that_can_be_sent(
    asked: list[tuple[Message, str]], teleop: Message
) -> None:
    desk = armed()
    encoder = Encoder(1, 1)
    assert isinstance(teleop, Teleop)
    for request, operator in asked:
        encoder.encode(desk.vehicle.receive(request, desk.now_ns, operator))
        desk.vehicle.receive_teleop(teleop, desk.now_ns)
        desk.step()
        for message in (
            desk.vehicle.lease_status(desk.now_ns, desk.now_ns),
            desk.vehicle.mission_status(desk.now_ns, desk.now_ns),
            *desk.vehicle.texts(),
        ):
            if message is not None:
                check(message)


# The lease while simulated time stands, as it does without the plant.


def standing(*beating: str) -> Rig:
    """Return a robot whose lease Ada has taken, whose clock stands from now on."""
    rig = Rig().ready()
    rig.ask(lease(LeaseAction.TAKE), service=LEASE_SERVICE)
    rig.cycle()
    rig.process._clock = ManualClock(rig.clock.now_ns())
    rig.senses.lockstep = True
    assert rig.vehicle.lease.is_holder(ADA)
    wait(rig, 1.2)
    wait(rig, 1.2, *beating)
    return rig


def wait(rig: Rig, seconds: float, *beating: str) -> None:
    """Let time pass at the process while its clock stands; these programs send heartbeats."""
    for _ in range(round(5 * seconds)):
        rig.clock.advance(200 * MS)
        for program in beating:
            rig.bus.say(OPERATOR, make(Heartbeat), sender=program)
        rig.process.idle()


def test_an_idle_lease_is_given_back_while_simulated_time_stands() -> None:
    rig = standing(ADA)
    wait(rig, 25.0, ADA)
    assert rig.vehicle.lease.is_holder(ADA), "its program is there, and 30 s are not over"
    wait(rig, 6.0, ADA)
    assert rig.vehicle.lease.holder is None
    assert rig.sent(LEASE)[-1].held == 0


def test_the_lease_of_a_lost_program_lapses_while_simulated_time_stands() -> None:
    rig = standing(ADA)
    wait(rig, 10.0, ADA)
    assert rig.vehicle.lease.is_holder(ADA)
    wait(rig, 4.4)
    assert rig.vehicle.lease.holder is None


def test_the_lease_is_shown_while_simulated_time_stands() -> None:
    rig = standing()
    before = len(rig.sent(LEASE))
    wait(rig, 10.0)
    shown = rig.sent(LEASE)[before:]
    assert 9 <= len(shown) <= 20
    assert 8_000 <= shown[0].lapses_ms - shown[-1].lapses_ms <= 10_000


def test_the_operator_is_no_older_after_simulated_time_has_stood() -> None:
    """Its age is an input of the control core, which has no time that the plant does not give."""
    rig = standing(ADA)
    now_ns = rig.process._clock.now_ns()
    before_ms = rig.vehicle.operator_age_ms(now_ns)
    wait(rig, 10.0)
    assert rig.vehicle.operator_age_ms(now_ns) == before_ms


def test_robot_is_armed_before_the_time_of_a_run_begins() -> None:
    """A run in lockstep begins with an armed robot, however long that takes on a busy machine."""
    rig = standing(ADA)
    rig.vehicle.state.machine.vehicle = states.STANDBY
    wait(rig, 100.0)
    asked = rig.ask(arm(70))
    rig.process.idle()
    assert asked.reasons == [Reason.NONE]
