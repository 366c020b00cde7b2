"""The stop of all robots: sent to each first, acknowledged by each, one line for each."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import pytest

from ground.client import link as links
from ground.client.connection import Common
from ground.client.link import Link, UnansweredError
from ground.client.operations.all_robots import AllAnswered, ClearAll, StopAll
from ground.client.operations.session import Session
from ground.console.spelling import line_of
from protocol.bus.bus import Presence
from protocol.bus.network import Network
from protocol.topics import COMMAND, STATUS, STOP, STOP_SERVICE, Service, Topic
from protocol.wire.enums import Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import CommandRequest
from protocol.wire.reasons import Reason
from runtime.clock import ManualClock
from runtime.errors import NoAnswerError
from tests.support.boxes import Box, Wireless
from tests.support.each import each
from tests.support.ground.client import Pulse, ack, status


class Fleet(Wireless):
    """Robots that acknowledge each stop at once, except the `dead` ones."""

    holder = None
    operator = "open/0a"

    def __init__(self, clock: ManualClock, *robots: str, dead: Iterable[str] = ()) -> None:
        super().__init__()
        self.clock = clock
        self.robots = robots
        self.dead = frozenset(dead)
        self.order: list[str] = []
        self.reasons: dict[str, Reason] = {}
        self.cleared: dict[str, int] = {}

    def present(self, timeout_s: float = 1.0) -> list[Presence]:
        self.order.append("present")
        return [Presence(name, "robot", "0a") for name in self.robots]

    def mailbox(self, topic: Topic[Any], robot: str | None = None, *_: Any, **__: Any) -> Box:
        return self.boxes.setdefault(f"{robot}/{topic.path}", Box(topic))

    def unsubscribe(self, mailbox: Any) -> None:
        """Keep the mailbox: the test fills it."""

    def publisher(self, topic: Topic[Any], robot: str | None = None) -> Any:
        assert topic is STOP
        return Sender(self, str(robot))

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
            shown = status(Vehicle.EMERGENCY_STOP, stop_id=message.request_id)
            self.mailbox(STATUS, name).newest = (shown, self.clock.now_ns())
        elif service is COMMAND:
            assert isinstance(message, CommandRequest)
            self.cleared[name] = message.stop_id
        return ack(message, self.reasons.get(name, Reason.NONE))

    def lost(self) -> str:
        return ""


class Sender:
    """Notes that a stop was sent to a robot."""

    def __init__(self, fleet: Fleet, robot: str) -> None:
        self._fleet, self._robot = fleet, robot

    def put(self, message: Message) -> None:
        self._fleet.order.append(f"sent {self._robot}")


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> ManualClock:
    """Return the clock of each link, which advances when a link waits."""
    clock = ManualClock(1_000_000_000)
    monkeypatch.setattr(links, "Pulse", lambda: Pulse(clock))
    return clock


def fleet_of(clock: ManualClock, *robots: str, dead: Iterable[str] = ()) -> tuple[Fleet, Session]:
    fleet = Fleet(clock, *robots, dead=dead)
    network = Network(mode="client", connect=("tcp/127.0.0.1:1",))
    return fleet, Session(Link(fleet, Common(network=network, robot="r1"), clock))


def test_all_robots_are_sent_the_stop_before_any_is_awaited(clock: ManualClock) -> None:
    fleet, session = fleet_of(clock, "r1", "r2", "r3")
    outcome = StopAll().perform(session)
    assert outcome.ok
    assert fleet.order[:4] == ["sent r1", "present", "sent r2", "sent r3"]
    assert [line.split(" after ")[0] for line in outcome.text.splitlines()] == [
        f"{name}: E-STOP acknowledged by {name}" for name in ("r1", "r2", "r3")
    ]


def test_robots_that_are_known_are_sent_the_stop_before_anybody_is_asked(
    clock: ManualClock,
) -> None:
    fleet, session = fleet_of(clock, "r1", "r2", "r3")
    common = replace(session.link.common, robots=("r1", "r2", "r9"))
    outcome = StopAll().perform(Session(Link(fleet, common, clock)))
    assert fleet.order[:5] == ["sent r1", "sent r2", "sent r9", "present", "sent r3"]
    stopped = {robot: found.ok for robot, found in outcome.of}
    assert stopped == {"r1": True, "r2": True, "r3": True, "r9": False}, "r9 is not there"


@each("raises", ["publisher", "present"])
def test_a_bus_that_fails_skips_no_robot(raises: str, clock: ManualClock) -> None:
    fleet, session = fleet_of(clock, "r1", "r2")

    def fail(*_: object, **__: object) -> Any:
        raise RuntimeError("closed")

    setattr(fleet, raises, fail)
    common = replace(session.link.common, robots=("r1", "r2"))
    stop = StopAll(timeout_s=0.3)
    if raises == "publisher":  # the services are left
        assert stop.perform(Session(Link(fleet, common, clock))).ok
        return
    with pytest.raises(RuntimeError):
        stop.perform(Session(Link(fleet, common, clock)))
    asked = {line for line in fleet.order if line.startswith(STOP_SERVICE.path)}
    assert asked == {f"{STOP_SERVICE.path} r1", f"{STOP_SERVICE.path} r2"}


def test_robot_that_does_not_acknowledge_fails_the_stop_of_all(clock: ManualClock) -> None:
    _, session = fleet_of(clock, "r1", "r2", dead=["r1"])
    outcome = StopAll(timeout_s=0.3).perform(session)
    assert not outcome.ok
    first, second = outcome.text.splitlines()
    assert first.startswith("r1: E-STOP GIVEN UP")
    assert second.startswith("r2: E-STOP acknowledged")
    row = outcome.as_json("estop", "r1")
    assert (row["verb"], row["ok"]) == ("estop", False)
    assert isinstance(row["robots"], list)
    assert [(one["robot"], one["ok"]) for one in row["robots"]] == [("r1", False), ("r2", True)]


def test_all_robots_are_released_with_a_line_for_each(clock: ManualClock) -> None:
    fleet, session = fleet_of(clock, "r1", "r2", "r3", dead=["r3"])
    fleet.reasons["r2"] = Reason.LEASE_HELD
    for robot, stop_id in (("r1", 71), ("r2", 72)):
        shown = status(Vehicle.EMERGENCY_STOP, stop_id=stop_id)
        fleet.mailbox(STATUS, robot).newest = (shown, clock.now_ns())
    outcome = ClearAll().perform(session)
    assert isinstance(outcome, AllAnswered)
    texts = dict(outcome.of)
    assert texts["r1"].ok
    assert texts["r2"].text.startswith("refused: another operator commands the robot")
    assert texts["r3"].text.startswith("robot r3 runs, but")
    assert not outcome.ok
    assert fleet.cleared == {"r1": 71, "r2": 72}, "each by the stop that its status shows"


@pytest.mark.parametrize("operation", [StopAll(), ClearAll()])
def test_without_a_robot_there_is_nothing_to_stop(
    clock: ManualClock, operation: StopAll | ClearAll
) -> None:
    _, session = fleet_of(clock)
    with pytest.raises(UnansweredError, match="no robot is present"):
        operation.perform(session)


def test_stop_of_all_needs_no_lease() -> None:
    assert not StopAll.moves
    assert line_of(StopAll()) == "estop --all"
    assert line_of(ClearAll()) == "clear-estop --all"
