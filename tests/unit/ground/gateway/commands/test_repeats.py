"""A repeated command is accepted from memory only while what it has made is still there."""

from collections.abc import Callable

from gateways.mavlink.mav_service import Sender
from gateways.mavlink.mavlink_dialect import MavMessage
from ground.client.operations.commands import Arm, Hold
from protocol.wire.enums import GoalState, MissionState, Mode, Vehicle
from protocol.wire.messages import LeaseStatus
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.gateway.fake_port import CLIENT, OTHER, Bench
from tests.support.gateway.messages import PLACE, acks, command, local_target, words
from tests.support.gateway.piloting import accept_all, driving_bench, performed, show
from tests.support.gateway.telemetry import status

ACCEPTED, LATER, FAILED, NOT_IN_CONTROL = 0, 1, 4, 10
ARM, SET_MODE, PAUSE, STOP, SPEED = 400, 176, 193, 185, 178
HERE = (47.37691, 8.54172)
MAKES: dict[str, tuple[float, ...]] = {
    "arm": (ARM, 1),
    "MANUAL": (SET_MODE, 1, Mode.MANUAL),
    "AUTO": (SET_MODE, 1, Mode.AUTO),
    "GUIDED": (SET_MODE, 1, Mode.GUIDED),
    "RTL": (20,),
    "mission": (300,),
    "resume": (PAUSE, 1),
    "goto": (192, -1, 1, 0, 0, *HERE),
}
"""Commands of the client in control that make a state."""
ENDS: dict[str, Callable[[Bench], object]] = {
    "hold": lambda bench: bench.send(command(SET_MODE, 1, Mode.HOLD), OTHER),
    "pause": lambda bench: bench.send(command(PAUSE, 0), OTHER),
    "disarm": lambda bench: bench.send(command(ARM, 0), OTHER),
    "emergency stop": lambda bench: bench.send(command(STOP, 1), OTHER),
    "hold of the app": lambda bench: show(bench, Mode.HOLD),
    "disarmed by the app": lambda bench: show(bench, Mode.GUIDED, vehicle=Vehicle.STANDBY),
    "emergency stop of the app": lambda bench: stopped(bench),
}
"""How somebody else ends it."""


def stopped(bench: Bench) -> None:
    bench.port.telemetry["status"] = status(vehicle=Vehicle.EMERGENCY_STOP, stop_id=9)
    bench.after(0.02)


def made(name: str, confirmation: int = 0) -> MavMessage:
    number, *params = MAKES[name]
    return command(int(number), *params, confirmation=confirmation)


def bench_after(name: str) -> Bench:
    """Return a bench whose client has got its command accepted."""
    bench = driving_bench(Mode.SMART_RTL)
    show(bench, Mode.SMART_RTL, MissionState.READY)
    bench.send(made(name))
    accept_all(bench)
    show(bench, Mode.SMART_RTL if name in ("arm", "resume") else Mode.GUIDED, MissionState.READY)
    bench.after(0.4)
    assert performed(bench)
    bench.sent()
    return bench


@each("name", list(MAKES))
@each("end", list(ENDS))
def test_command_acts_again_after_somebody_has_ended_its_effect(name: str, end: str) -> None:
    bench = bench_after(name)
    ENDS[end](bench)
    accept_all(bench)
    bench.sent()
    performed(bench)
    sent = bench.send(made(name))
    if name == "GUIDED" and bench.vehicle.modes.number == Mode.GUIDED:
        assert [result for _, result in acks(sent)] == [ACCEPTED], "a stop does not end this mode"
        return
    assert performed(bench), "asked anew"
    bench.port.refuse(Reason.EMERGENCY_STOPPED)
    ((_, result),) = acks(bench.sent())
    assert result != ACCEPTED


@each("name", list(MAKES))
@each("end", list(ENDS))
def test_repetition_of_a_lost_frame_undoes_no_stop(name: str, end: str) -> None:
    """Its sender has not decided anew: perhaps the answer was lost before the stop."""
    bench = bench_after(name)
    ENDS[end](bench)
    accept_all(bench)
    bench.sent()
    performed(bench)
    sent = bench.send(made(name, confirmation=1))
    assert [result for _, result in acks(sent)] == [LATER]
    assert "the robot was stopped since" in words(sent)
    assert performed(bench) == []


@each("name", list(MAKES))
@each("confirmation", [0, 1])
def test_command_acts_once_while_its_effect_lasts(name: str, confirmation: int) -> None:
    bench = bench_after(name)
    bench.send(command(STOP, 0), OTHER)  # is refused: not in control
    bench.send(command(ARM, 1), OTHER)
    bench.sent()
    sent = bench.send(made(name, confirmation))
    assert [result for _, result in acks(sent)] == [ACCEPTED]
    assert performed(bench) == []


@each("end", list(ENDS))
def test_copy_of_a_frame_by_the_network_does_nothing_after_a_stop(end: str) -> None:
    bench = driving_bench()
    message = made("goto")
    bench.send(message)
    accept_all(bench)
    show(bench, Mode.GUIDED)
    ENDS[end](bench)
    accept_all(bench)
    bench.sent()
    performed(bench)
    assert acks(bench.send(message)) == []
    assert performed(bench) == []


def test_goal_that_another_request_has_replaced_is_set_again() -> None:
    bench = bench_after("goto")
    bench.send(local_target(mask=PLACE, x=1.0, y=2.0))
    accept_all(bench)
    performed(bench)
    bench.send(made("goto"))
    assert len(performed(bench)) == 1


def test_goal_that_was_given_up_is_set_again() -> None:
    bench = bench_after("goto")
    ended = status(vehicle=Vehicle.ACTIVE, mode=Mode.GUIDED, goal=GoalState.STUCK, goal_id=3)
    bench.port.telemetry["status"] = ended
    bench.after(0.02)
    bench.send(made("goto"))
    assert len(performed(bench)) == 1


@each("seizer", [OTHER, None])
def test_client_that_has_lost_control_is_not_told_accepted(seizer: Sender | None) -> None:
    bench = driving_bench(Mode.GUIDED)
    bench.send(command(32100, 1, 1, 10))
    bench.send(command(ARM, 1))
    accept_all(bench)
    bench.sent()
    if seizer is None:
        bench.port.holder = "ada"
        bench.port.telemetry["lease"] = LeaseStatus(
            time_ns=0, lapses_ms=900, held=1, holder="ada/7", name="ada"
        )
        bench.after(0.4)
    else:
        bench.send(command(32100, 1, 0, 10), seizer)
    sent = bench.send(command(ARM, 1))
    assert acks(sent) == [(ARM, NOT_IN_CONTROL)]
    assert performed(bench) == [Arm()]


def test_refused_command_is_asked_anew() -> None:
    """What was in the way may be gone."""
    bench, found = driving_bench(vehicle=Vehicle.STANDBY), list[tuple[int, int]]()
    for reason in (Reason.NO_SENSES, Reason.FENCE_UNREADABLE):
        bench.send(command(ARM, 1))
        bench.port.refuse(reason)
        found += acks(bench.sent())
    bench.send(command(ARM, 1))
    bench.port.answer()
    assert [*found, *acks(bench.sent())] == [(ARM, LATER), (ARM, FAILED), (ARM, ACCEPTED)]


def test_value_outlasts_a_stop() -> None:
    bench = driving_bench()
    bench.send(command(SPEED, 1, 0.5, -1))
    accept_all(bench)
    bench.send(command(SET_MODE, 1, Mode.HOLD), OTHER)
    accept_all(bench)
    performed(bench)
    bench.sent()
    assert acks(bench.send(command(SPEED, 1, 0.5, -1, confirmation=1))) == [(SPEED, ACCEPTED)]
    assert performed(bench) == []


@each("sender", [CLIENT, OTHER])
@each("message", [(SET_MODE, 1, Mode.HOLD), (PAUSE, 0), (ARM, 0)])
def test_stop_needs_no_control_and_no_lease(sender: Sender, message: tuple[float, ...]) -> None:
    bench = driving_bench(Mode.GUIDED)
    bench.port.holder = "ada"
    number, *params = message
    for _ in range(2):
        bench.send(command(int(number), *params), sender)
        bench.port.answer()
        assert acks(bench.sent()) == [(number, ACCEPTED)]
    assert bench.port.leases == []


def test_stream_of_the_owner_does_not_undo_the_hold_of_another() -> None:
    bench = driving_bench(Mode.GUIDED)
    bench.send(local_target(frame=8, vx=0.5))
    accept_all(bench)
    show(bench, Mode.MANUAL)
    performed(bench)
    bench.send(command(SET_MODE, 1, Mode.HOLD), OTHER)
    bench.send(local_target(frame=8, vx=0.5))
    bench.send(local_target(mask=PLACE, x=1.0, y=2.0))
    assert performed(bench) == [Hold()]
    bench.port.answer()
    bench.send(local_target(frame=8, vx=0.5))
    show(bench, Mode.HOLD)
    bench.after(1.5)
    assert performed(bench) == []
    assert bench.vehicle.modes.number == Mode.HOLD
