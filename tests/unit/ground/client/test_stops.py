"""The emergency stop of one robot and of all: repeated until acknowledged, or given up."""

from collections.abc import Callable, Iterable
from contextlib import closing
from typing import Any

import pytest

from checks.harness.loop import PlayedLoop
from ground.client.connection import Common
from ground.client.emergency_stop import (
    HELD_NS,
    Acknowledgement,
    EmergencyStop,
    NoWays,
    StopOutcome,
    outcome_words,
)
from ground.client.outcomes import AllAnswered
from ground.client.robot_link import UnansweredError
from ground.commands.stop import ClearAll, StopAll
from ground.robot import Robot
from protocol.bus.bus import Presence
from protocol.topics import COMMAND, STATUS, STOP, STOP_SERVICE, Service, Topic
from protocol.wire.enums import AckResult, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck, CommandRequest, NavigatorStatus
from protocol.wire.reasons import Reason
from runtime.clock import ManualClock
from runtime.errors import NoAnswerError
from runtime.units import NS_PER_MS as MS
from tests.support.each import each
from tests.support.ground.client import AT, ack, run_on, status
from tests.support.ground.station import Robot as StatusSource
from tests.support.played_bus import PlayedBus

YES = CommandAck(command=185, result=AckResult.ACCEPTED, result_param2=0)
BUSY = CommandAck(
    command=185, result=AckResult.TEMPORARILY_REJECTED, result_param2=Reason.TOO_MANY_REQUESTS
)


def stopped(stop_id: int) -> NavigatorStatus:
    return StatusSource(vehicle=Vehicle.EMERGENCY_STOP, stop_id=stop_id).status()


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
    acknowledgement.receive(StatusSource(vehicle=Vehicle.ACTIVE).status(), HELD_NS)
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
    acknowledgement.receive(StatusSource(vehicle=Vehicle.STANDBY, stop_id=5).status(), 0)
    assert not acknowledgement.given


def test_closed_station_gives_up_with_the_reason() -> None:
    pressing = Pressing(until=1000)
    outcome = pressing.stop.run(over=lambda: True)
    assert (outcome.acknowledged, outcome.why) == (False, "no answer")
    outcome = pressing.stop.run(give_up_ns=100 * MS)
    assert outcome.why == "srv/stop: no process serves it"


class Fleet(PlayedBus):
    """Robots that acknowledge each stop at once, except the `dead` ones."""

    operator = "open/0a"
    has_history = True

    def __init__(self, clock: ManualClock, *robots: str, dead: Iterable[str] = ()) -> None:
        super().__init__(clock)
        self.clock = clock
        self.robots = robots
        self.dead = frozenset(dead)
        self.order: list[str] = []
        self.reasons: dict[str, Reason] = {}
        self.cleared: dict[str, int] = {}

    def present(self) -> list[Presence]:
        self.order.append("present")
        return [Presence(name, "robot", "0a") for name in self.robots]

    def publisher(self, topic: Topic[Any], robot: str | None = None) -> Any:
        assert topic is STOP
        publisher = super().publisher(topic, robot)
        publisher.heard = lambda _: self.order.append(f"sent {robot}")
        return publisher

    def ask(
        self,
        service: Service,
        message: Message | None = None,
        timeout_s: float = 0.5,
        robot: str | None = None,
    ) -> Message | bytes:
        name = str(robot)
        self.order.append(f"{service.path} {name}")
        if name in self.dead:
            self.clock.advance(round(timeout_s * 1e9))
            raise NoAnswerError("no answer within the time")
        if service is STOP_SERVICE:
            assert isinstance(message, CommandRequest)
            self.say(STATUS, status(Vehicle.EMERGENCY_STOP, stop_id=message.request_id), name)
        elif service is COMMAND:
            assert isinstance(message, CommandRequest)
            self.cleared[name] = message.stop_id
        return ack(message, self.reasons.get(name, Reason.NONE))


def perform(command: StopAll | ClearAll, fleet: Fleet, known: tuple[str, ...] = ()) -> AllAnswered:
    """Carry it out for r1, beside which these robots are known."""
    with closing(PlayedLoop(fleet.clock)) as loop:
        robot = Robot(fleet, Common(network=AT, robot="r1", robots=known), clock=fleet.clock)
        return run_on(loop, command.perform(robot))


def fleet_of(*robots: str, dead: Iterable[str] = ()) -> Fleet:
    return Fleet(ManualClock(1_000_000_000), *robots, dead=dead)


def test_all_robots_are_sent_the_stop_before_any_is_awaited() -> None:
    fleet = fleet_of("r1", "r2", "r3")
    outcome = perform(StopAll(), fleet)
    assert outcome.ok
    assert fleet.order[:4] == ["sent r1", "present", "sent r2", "sent r3"]
    assert [line.split(" after ")[0] for line in outcome.text.splitlines()] == [
        f"{name}: E-STOP acknowledged by {name}" for name in ("r1", "r2", "r3")
    ]


def test_robots_that_are_known_are_sent_the_stop_before_anybody_is_asked() -> None:
    fleet = fleet_of("r1", "r2", "r3")
    outcome = perform(StopAll(), fleet, ("r1", "r2", "r9"))
    assert fleet.order[:5] == ["sent r1", "sent r2", "sent r9", "present", "sent r3"]
    stopped = {robot: found.ok for robot, found in outcome.of}
    assert stopped == {"r1": True, "r2": True, "r3": True, "r9": False}, "r9 is not there"


@each("raises", ["publisher", "present"])
def test_a_bus_that_fails_skips_no_robot(raises: str) -> None:
    fleet = fleet_of("r1", "r2")

    def fail(*_: object, **__: object) -> Any:
        raise RuntimeError("closed")

    setattr(fleet, raises, fail)
    stop = StopAll(timeout_s=0.3)
    if raises == "publisher":  # the services are left
        assert perform(stop, fleet, ("r1", "r2")).ok
        return
    with pytest.raises(RuntimeError):
        perform(stop, fleet, ("r1", "r2"))
    asked = {line for line in fleet.order if line.startswith(STOP_SERVICE.path)}
    assert asked == {f"{STOP_SERVICE.path} r1", f"{STOP_SERVICE.path} r2"}


def test_robot_that_does_not_acknowledge_fails_the_stop_of_all() -> None:
    fleet = fleet_of("r1", "r2", dead=["r1"])
    outcome = perform(StopAll(timeout_s=0.3), fleet)
    assert not outcome.ok
    first, second = outcome.text.splitlines()
    assert first.startswith("r1: E-STOP GIVEN UP")
    assert second.startswith("r2: E-STOP acknowledged")
    row = outcome.as_json("estop", "r1")
    assert (row["verb"], row["ok"]) == ("estop", False)
    assert isinstance(row["robots"], list)
    assert [(one["robot"], one["ok"]) for one in row["robots"]] == [("r1", False), ("r2", True)]


def test_all_robots_are_released_with_a_line_for_each() -> None:
    fleet = fleet_of("r1", "r2", "r3", dead=["r3"])
    fleet.reasons["r2"] = Reason.LEASE_HELD
    for robot, stop_id in (("r1", 71), ("r2", 72)):
        fleet.say(STATUS, status(Vehicle.EMERGENCY_STOP, stop_id=stop_id), robot)
    outcome = perform(ClearAll(), fleet)
    assert isinstance(outcome, AllAnswered)
    texts = dict(outcome.of)
    assert texts["r1"].ok
    assert texts["r2"].text.startswith("refused: another operator commands the robot")
    assert texts["r3"].text.startswith("robot r3 is slow or hangs")
    assert not outcome.ok
    assert fleet.cleared == {"r1": 71, "r2": 72}, "each by the stop that its status shows"


@pytest.mark.parametrize("operation", [StopAll(), ClearAll()])
def test_without_a_robot_there_is_nothing_to_stop(
    operation: StopAll | ClearAll,
) -> None:
    fleet = fleet_of()
    with pytest.raises(UnansweredError, match="no robot is present"):
        perform(operation, fleet)


def test_stop_of_all_needs_no_lease() -> None:
    assert not StopAll().moves
    assert StopAll().line == "estop --all"
    assert ClearAll().line == "clear-estop --all"
