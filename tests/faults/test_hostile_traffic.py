"""Bytes that are no frames, and more requests than a robot answers."""

from collections.abc import Callable

import pytest

from checks.harness.in_process import InProcess
from protocol.bus.bus import Bus
from protocol.bus.services import ServiceRequest
from protocol.topics import CLOCK, COMMAND, DRIVE, OPERATOR, SONAR, STOP, TOPICS, WHEELS, Service
from protocol.wire.codec import Encoder
from protocol.wire.enums import AckResult, Command, LeaseAction, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck, CommandRequest, LeaseRequest, WheelTicks
from protocol.wire.reasons import Reason
from robot.emergency_stop import StopLatch
from robot.process import MAX_ANSWERED, MAX_WAITING
from tests.support.each import each

GOOD = Encoder(1, 25).encode(WheelTicks(time_ns=1, seq=1, left=5, right=5, bumper=0, expired=0))
BROKEN = (b"", b"\x00", GOOD[:-1], GOOD[:9], b"\xff" * 300, GOOD[:-1] + b"\x00", b"\xfd rubbish")


def test_invalid_bytes_do_not_prevent_reaching_the_goal() -> None:
    with InProcess("open") as stack:
        stack.arm()
        stack.goto_goal()
        for topic in TOPICS:
            for frame in BROKEN if topic is not STOP else ():
                stack.send_raw(topic, frame)
                stack.forward(0.05)
        stack.until(stack.reached)
        stack.assert_near(stack.world.goal.x_m, stack.world.goal.y_m)


@each("frame", BROKEN)
def test_any_bytes_on_the_stop_topic_are_a_stop(frame: bytes) -> None:
    with InProcess("open") as stack:
        stack.arm()
        stack.goto_goal()
        stack.forward(0.5)
        stack.send_raw(STOP, frame)
        stack.forward(0.1)
        assert stack.state == Vehicle.EMERGENCY_STOP


def test_a_message_on_the_wrong_topic_is_not_taken_for_another() -> None:
    with InProcess("open") as stack:
        stack.arm()
        stack.goto_goal()
        for topic in (SONAR, DRIVE, OPERATOR, CLOCK):
            stack.send_raw(topic, GOOD)
            stack.forward(0.05)
        stack.until(stack.reached)


def test_what_cannot_be_read_is_counted_and_shown() -> None:
    with InProcess("open") as stack:
        assert stack.rejected_shown() == 0
        for topic in (SONAR, WHEELS, OPERATOR):
            stack.send_raw(topic, b"\xfd rubbish")
        stack.kill("plant")  # otherwise the next frame would replace the bad one before it is read
        stack.forward(0.1)
        assert stack.rejected_shown() == 3


def test_a_garbled_wheel_command_is_not_obeyed() -> None:
    with InProcess("open") as stack:
        stack.send_raw(DRIVE, b"\xfd" + b"\x7f" * 60)
        stack.forward(0.5)
        assert stack.standing()
        assert stack.truth.x_m == pytest.approx(stack.world.start.x_m)


Take = Callable[[ServiceRequest], object]


class FakeRequest(ServiceRequest):
    """A request as the bus passes it on, which stores its answers."""

    def __init__(self, message: Message, operator: str = "eve") -> None:
        self.message = message
        self.operator = operator
        self.good_until_ns = 30_000_000_000
        self.arrived_ns = 0
        self.answers: list[Message | bytes] = []
        self.dropped = False

    def reply(self, answer: Message | bytes) -> bool:
        self.answers.append(answer)
        return True

    @property
    def payload(self) -> bytes:
        assert self.message is not None
        return Encoder(255, 190).encode(self.message)

    def drop(self) -> None:
        self.dropped = True

    @property
    def reason(self) -> Reason | None:
        if not self.answers:
            return None
        answer = self.answers[0]
        assert isinstance(answer, CommandAck)
        return Reason(answer.result_param2)


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> dict[str, Take]:
    """Return the handlers of the requests of each service."""
    found: dict[str, Take] = {}
    real = Bus.serve

    def serve(bus: Bus, service: Service, handler: Take, robot: str | None = None) -> None:
        found[service.path] = handler
        real(bus, service, handler, robot)

    monkeypatch.setattr(Bus, "serve", serve)
    return found


def question(number: int, command: Command, operator: str = "eve") -> FakeRequest:
    request = CommandRequest(request_id=number, command=command, param1=0.0, param2=0.0)
    return FakeRequest(request, operator)


def test_excess_request_is_refused_at_once_with_its_reason(
    served: dict[str, Take],
) -> None:
    with InProcess("open") as stack:
        asked = [question(n, Command.DO_PAUSE_CONTINUE) for n in range(MAX_WAITING + 30)]
        for one in asked:
            served[COMMAND.path](one)
        refused = [one for one in asked if one.answers]
        assert refused == asked[MAX_WAITING:]
        assert {one.reason for one in refused} == {Reason.TOO_MANY_REQUESTS}
        answer = refused[0].answers[0]
        assert isinstance(answer, CommandAck)
        assert answer.result == AckResult.TEMPORARILY_REJECTED
        stack.forward(0.05)
        assert sum(bool(one.answers) for one in asked) == 30 + MAX_ANSWERED


def test_emergency_stop_overtakes_all_queued_requests(served: dict[str, Take]) -> None:
    with InProcess("open") as stack:
        for n in range(MAX_WAITING + 5):
            served[COMMAND.path](question(n, Command.DO_PAUSE_CONTINUE))
        stop = question(1000, Command.DO_FLIGHTTERMINATION)
        served[COMMAND.path](stop)
        stack.forward(0.05)
        assert stop.reason == Reason.NONE
        assert stack.state == Vehicle.EMERGENCY_STOP


def test_excess_stop_request_is_dropped_and_not_stored(
    served: dict[str, Take],
) -> None:
    """Reproduce a flood of stops that had increased the memory by 250 MB in ten minutes."""
    with InProcess("open") as stack:
        asked = [question(n, Command.DO_FLIGHTTERMINATION) for n in range(MAX_WAITING + 30)]
        for one in asked:
            served[COMMAND.path](one)
        assert [one for one in asked if one.dropped] == asked[MAX_WAITING:]
        stack.forward(0.05)
        assert {one.reason for one in asked[:MAX_WAITING]} == {Reason.NONE}
        assert stack.state == Vehicle.EMERGENCY_STOP


def test_request_read_after_its_stop_is_acknowledged(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Threads of the bus set the latch before another thread reads the request."""
    handlers: list[Take] = []
    real = Bus.serve_stop

    def serve_stop(bus: Bus, pressed: Callable[[str, bytes], None], handler: Take) -> None:
        handlers.append(handler)
        real(bus, pressed, handler)

    monkeypatch.setattr(Bus, "serve_stop", serve_stop)
    with InProcess("open") as stack:
        stack.command(Command.DO_FLIGHTTERMINATION)
        late, later = (question(9, Command.DO_FLIGHTTERMINATION) for _ in range(2))
        handlers[0](late)
        stack.forward(0.05)
        assert late.reason == Reason.NONE
        stack.command(Command.SIDESTEP_CLEAR_EMERGENCY_STOP)
        handlers[0](later)
        stack.forward(0.05)
        assert later.dropped, "it was acted upon, and holds no more"


def test_stop_sent_as_a_command_is_always_answered(
    served: dict[str, Take], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Setting the latch comes first, because the loop drops requests without a stop."""
    with InProcess("open") as stack:
        real, robot = StopLatch.press, stack.robot
        assert robot is not None

        def press(latch: StopLatch, operator: str, frame: bytes) -> None:
            robot.idle()
            real(latch, operator, frame)

        monkeypatch.setattr(StopLatch, "press", press)
        stop = question(7, Command.DO_FLIGHTTERMINATION)
        served[COMMAND.path](stop)
        stack.forward(0.05)
        assert not stop.dropped
        assert stop.reason == Reason.NONE


def test_stop_just_after_a_read_is_answered_at_the_next(
    served: dict[str, Take], monkeypatch: pytest.MonkeyPatch
) -> None:
    with InProcess("open") as stack:
        real, stop = StopLatch.take, question(7, Command.DO_FLIGHTTERMINATION)

        def take(latch: StopLatch) -> CommandRequest | None:
            found = real(latch)
            if coming:
                served[COMMAND.path](coming.pop())
            return found

        coming = [stop]
        monkeypatch.setattr(StopLatch, "take", take)
        stack.forward(0.1)
        assert not stop.dropped
        assert stop.reason == Reason.NONE


def test_other_operators_do_not_delay_the_lease_holder(served: dict[str, Take]) -> None:
    with InProcess("open") as stack:
        take = LeaseRequest(request_id=1, action=LeaseAction.TAKE, name="ada")
        stack.vehicle.receive(take, stack.clock.now_ns(), "ada")
        strangers = [
            question(n, Command.NAV_RETURN_TO_LAUNCH, "eve") for n in range(MAX_WAITING + 9)
        ]
        for one in strangers:
            served[COMMAND.path](one)
        own = question(5000, Command.DO_PAUSE_CONTINUE, "ada")
        served[COMMAND.path](own)
        stack.forward(0.05)
        assert own.answers
        assert own.reason != Reason.TOO_MANY_REQUESTS
        assert {one.reason for one in strangers} == {
            None,
            Reason.LEASE_HELD,
            Reason.TOO_MANY_REQUESTS,
        }
