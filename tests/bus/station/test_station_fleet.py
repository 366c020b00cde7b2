"""A station watches every robot of a real bus, and robots that come and go leave nothing behind."""

import threading
from collections.abc import Iterator

import pytest

from ground.station import fleet
from ground.station.station import Station
from protocol.bus.network import MAX_ROBOTS
from protocol.topics import ODOMETRY, STATUS, STOP, TOPICS, Role
from runtime.clock import WallClock
from tests.support.bus.lively import Watching
from tests.support.bus.nets import Net, net
from tests.support.ground.station.said import Robot

pytestmark = pytest.mark.stack


@pytest.fixture
def network() -> Iterator[Net]:
    with net("router") as made:
        made.robot.announce()
        yield made


@pytest.fixture
def watching(network: Net) -> Iterator[Watching]:
    station = Station(network.ground, "r1", WallClock())
    try:
        yield Watching(station)
    finally:
        station.close()


def names(seen: Watching) -> list[str]:
    return [entry.robot for entry in seen.station.roster()]


def come_and_go(network: Net, watching: Watching, name: str) -> None:
    with network.opened(Role.ROBOT, name) as robot:
        robot.announce()
        watching.until(lambda: watching.station.present.has(name, Role.ROBOT))
    watching.until(lambda: not watching.station.present.has(name, Role.ROBOT))


def test_robot_that_appears_is_shown_and_can_be_stopped(network: Net, watching: Watching) -> None:
    stops: list[bytes] = []
    robot, messages = network.join(Role.ROBOT, "r2"), Robot("r2", x_m=3.0)
    robot.stream(STOP, lambda _key, frame, _at: stops.append(frame), "r2")
    odometry, status = robot.publisher(ODOMETRY), robot.publisher(STATUS)
    robot.announce()

    def shown() -> bool:
        odometry.put(messages.odometry())
        status.put(messages.status())
        return [other.name for other in watching.station.scene().others] == ["r2"]

    watching.until(shown)
    assert not stops
    watching.station.estop("r2")
    watching.until(lambda: stops)


def test_robot_that_flaps_leaves_nothing_behind(network: Net, watching: Watching) -> None:
    come_and_go(network, watching, "r2")
    threads = threading.active_count()
    for _ in range(20):
        come_and_go(network, watching, "r2")
    assert set(names(watching)) == {"r1", "r2"}
    assert len(network.ground._mailboxes) == 2 * len(TOPICS)
    assert threading.active_count() <= threads + 4
    assert len(watching.station.log) < 80


def test_subscriptions_of_replaced_robots_end(
    network: Net, watching: Watching, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fleet, "KEPT_NS", 0)
    for number in range(MAX_ROBOTS + 10):
        come_and_go(network, watching, f"x{number}")
    assert len(names(watching)) == MAX_ROBOTS
    assert len(network.ground._mailboxes) == MAX_ROBOTS * len(TOPICS)
