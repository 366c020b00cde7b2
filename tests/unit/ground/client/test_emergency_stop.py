"""The emergency stop is repeated until the robot's status shows it, or given up with a warning."""

from collections.abc import Callable

from ground.client.emergency_stop import (
    HELD_NS,
    Acknowledgement,
    EmergencyStop,
    NoWays,
    StopOutcome,
    outcome_words,
)
from protocol.topics import STOP, STOP_SERVICE
from protocol.wire.enums import AckResult, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck, CommandRequest, NavigatorStatus
from protocol.wire.reasons import Reason
from runtime.clock import ManualClock
from tests.support.each import each
from tests.support.ground.station.said import Robot
from tests.support.played_bus import PlayedBus

MS = 1_000_000
YES = CommandAck(command=185, result=AckResult.ACCEPTED, result_param2=0)
BUSY = CommandAck(
    command=185, result=AckResult.TEMPORARILY_REJECTED, result_param2=Reason.TOO_MANY_REQUESTS
)


def stopped(stop_id: int) -> NavigatorStatus:
    return Robot(vehicle=Vehicle.EMERGENCY_STOP, stop_id=stop_id).status()


class Pressing:
    """A stop whose robot shows a given status after a number of tries."""

    def __init__(self, until: int = 1, show: Callable[[int], NavigatorStatus] = stopped) -> None:
        self.clock = ManualClock()
        self.bus = PlayedBus(self.clock)
        self.publisher = self.bus.publisher(STOP, "r1")
        self.publisher.heard = self._hear
        self.seen: tuple[NavigatorStatus, int] | None = None
        self._until, self._show = until, show
        self.stop = EmergencyStop(self.bus, self.publisher, "r1", self.clock, lambda: self.seen)

    def _hear(self, request: Message) -> None:
        assert isinstance(request, CommandRequest)
        self.clock.advance(7 * MS)
        if len(self.publisher.said) >= self._until:
            self.seen = self._show(request.request_id), self.clock.now_ns()

    @property
    def ids(self) -> set[int]:
        return {one.request_id for one in self.publisher.said if isinstance(one, CommandRequest)}


class Unable(NoWays):
    """Ways that cannot send a datagram."""

    why = "the name robot.example does not resolve"


def test_the_end_and_the_warnings_tell_why_no_datagram_was_sent() -> None:
    clock = ManualClock()
    stop = EmergencyStop(None, None, "r1", clock, lambda: None, Unable())
    words = "no stop datagram: the name robot.example does not resolve"
    assert words in stop.words(clock.now_ns())
    outcome = stop.run(give_up_ns=0)
    assert words in outcome_words(outcome, "r1")


class Broken(NoWays):
    """Ways that raise what nobody has expected."""

    def press(self, request_id: int) -> None:
        raise RuntimeError("can't start new thread")


def test_ways_that_fail_keep_no_stop_from_the_bus() -> None:
    pressing = Pressing()
    pressing.stop._ways = Broken()
    assert pressing.stop.run().acknowledged


def test_stop_latency_counts_from_the_key_to_the_status() -> None:
    pressing = Pressing()
    outcome = pressing.stop.run()
    assert outcome == StopOutcome(acknowledged=True, took_ns=7 * MS, tries=1)
    assert outcome_words(outcome, "r1") == "E-STOP acknowledged by r1 after 7 ms, 1 try"


def test_stop_repeats_every_50_ms_with_one_id() -> None:
    pressing = Pressing(until=9)
    outcome = pressing.stop.run()
    assert (outcome.acknowledged, outcome.tries) == (True, 9)
    assert outcome.took_ns == (8 * 50 + 7) * MS
    assert len(pressing.ids) == 1


@each("answer", [YES, BUSY])
def test_no_answer_of_the_service_ends_the_stop(answer: CommandAck) -> None:
    pressing = Pressing(until=1000)
    pressing.bus.answers[STOP_SERVICE.path] = lambda _: answer
    outcome = pressing.stop.run()
    assert not outcome.acknowledged
    assert pressing.clock.now_ns() == 30_000 * MS
    assert outcome.tries == 600
    assert "E-STOP GIVEN UP after 30 s: r1 has NOT acknowledged it" in outcome_words(outcome, "r1")


def test_stop_of_another_request_is_no_acknowledgement() -> None:
    pressing = Pressing(show=lambda request_id: stopped(request_id ^ 1))
    assert not pressing.stop.run(give_up_ns=500 * MS).acknowledged


def test_status_from_before_the_press_is_no_acknowledgement() -> None:
    pressing = Pressing(until=1000)
    pressing.clock.advance(MS)
    stop = EmergencyStop(
        pressing.bus, pressing.publisher, "r1", pressing.clock, lambda: pressing.seen
    )
    pressing.seen = stopped(stop.request_id), 0
    assert not stop.run(give_up_ns=500 * MS).acknowledged


def test_stop_held_for_a_second_of_repeats_is_acknowledged() -> None:
    acknowledgement = Acknowledgement(5)
    acknowledgement.answered(YES)
    acknowledgement.receive(stopped(6), 0)
    acknowledgement.receive(stopped(7), HELD_NS - 1)
    assert not acknowledgement.given
    acknowledgement.receive(Robot(vehicle=Vehicle.ACTIVE).status(), HELD_NS)
    acknowledgement.receive(stopped(8), HELD_NS + 1)
    acknowledgement.receive(stopped(8), 2 * HELD_NS)
    assert not acknowledgement.given
    acknowledgement.receive(stopped(8), 2 * HELD_NS + 1)
    assert acknowledgement.given


@each("answer", [None, BUSY, b"{}"])
def test_late_statuses_of_an_older_stop_are_no_acknowledgement(answer: Message | bytes) -> None:
    """Ignore statuses that are 4 s late: they show an earlier stop, not this one."""
    acknowledgement = Acknowledgement(5)
    if answer is not None:
        acknowledgement.answered(answer)
    for tick in range(60):
        acknowledgement.receive(stopped(4), tick * 50 * MS)
    assert not acknowledgement.given


def test_moving_robot_that_shows_my_id_is_not_stopped() -> None:
    acknowledgement = Acknowledgement(5)
    acknowledgement.receive(Robot(vehicle=Vehicle.STANDBY, stop_id=5).status(), 0)
    assert not acknowledgement.given


def test_closed_station_gives_up_with_the_reason() -> None:
    pressing = Pressing(until=1000)
    outcome = pressing.stop.run(over=lambda: True)
    assert (outcome.acknowledged, outcome.why) == (False, "no answer")
    outcome = pressing.stop.run(give_up_ns=100 * MS)
    assert outcome.why == "srv/stop: no process serves it"
