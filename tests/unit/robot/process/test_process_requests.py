"""Requests at the process: bounded queues, operators and deadlines."""

from collections.abc import Iterator

from protocol.topics import (
    ANSWERED,
    COMMANDED,
    LEASE_SERVICE,
    PARAMETER,
    PARAMETERS,
    TEXT,
)
from protocol.wire.enums import AckResult, Command, LeaseAction
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    MissionRequestList,
    ParamRequestRead,
)
from protocol.wire.reasons import Reason
from robot.core import states
from runtime.clock import Tick
from tests.support.each import each
from tests.support.robot.processes import (
    ADA,
    BOB,
    Rig,
    S,
    hold,
    lease,
    press,
)
from tests.support.robot.vehicles import MS, goal

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
    others = [rig.ask(hold(number), BOB) for number in range(10)]
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
    assert described.answers == [rig.vehicle.parameters.described()]


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
