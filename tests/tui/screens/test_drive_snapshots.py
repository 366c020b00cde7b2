"""Compare the Drive screen with its committed pictures at its three sizes, in several states."""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from math import cos, nan, radians, sin

import msgspec
import pytest

from ground.map.scene import Disc, MapTarget, RobotMark
from ground.station.history.event_log import EventLog
from protocol.topics import MISSION, ODOMETRY
from protocol.wire.enums import MissionState, Vehicle
from protocol.wire.messages import MissionStatus
from tests.support.tui.fakes import MS, FakeStation
from tests.support.tui.pilot import play, staged
from tests.support.tui.stopped import stopped
from tests.support.tui.underway import drive_messages
from tests.tui.screens.test_snapshots import check, station_after_drive

SIZES = ((80, 24), (120, 40), (200, 60))
BEGAN_S = 1_795_425_000.0


def in_forest() -> FakeStation:
    """Return a station whose robot drives through a square world, on its second waypoint."""
    station = station_after_drive()
    lines = list(station.log)
    station.log = EventLog(began_s=BEGAN_S)
    for line in lines:
        station.log.add(line)
    world = station.world_now
    assert world is not None
    station.world_now = world._replace(size_m=(7.0, 7.0))
    trees = tuple(Disc(1.0 + 1.3 * (k % 5), 0.8 + 1.2 * (k // 5), 0.15) for k in range(25))
    around = [(3.0 + 1.2 * cos(k / 9), 2.4 + 1.2 * sin(k / 9)) for k in range(57)]
    station.items_now = (MapTarget(1.6, 5.0), MapTarget(6.0, 6.2, 0.0), MapTarget(6.2, 1.4))
    station.scene_now = replace(
        station.scene_now,
        size_m=(7.0, 7.0),
        obstacles=trees,
        seen=tuple(around[:20]),
        seen_late=tuple(around[20:38]),
        seen_old=tuple(around[38:]),
        robot=RobotMark(3.0, 2.4, radians(30), 0.12),
        true_robot=RobotMark(3.12, 2.3, radians(33), 0.12),
        trail=tuple((0.6 + 0.08 * k, 0.6 + 0.06 * k) for k in range(31)),
        hits=(),
        virtual_goal=None,
        goal=MapTarget(6.0, 6.2, 0.0),
        mission=station.items_now,
        current=1,
    )
    running = MissionStatus(
        time_ns=station.now_ns, mission_id=1, hold_left_ms=0, count=3, current=1,
        state=MissionState.RUNNING, reason=0,
    )  # fmt: skip
    station.air.put(MISSION, running, station.now_ns)
    return station


def in_failsafe() -> FakeStation:
    return stopped(Vehicle.FAILSAFE, station_after_drive())


def without_robot() -> FakeStation:
    station = FakeStation()
    station.note("no robot on the bus: sidestep up starts one")
    return station


def lost() -> FakeStation:
    """Return a station whose robot does not know its place."""
    station = station_after_drive()
    odometry = drive_messages(station.now_ns)[ODOMETRY]
    odometry = msgspec.structs.replace(odometry, x_m=nan, y_m=nan, heading_rad=nan, cov_xx_m2=nan)
    station.air.put(ODOMETRY, odometry, station.now_ns)
    station.scene_now = replace(station.scene_now, robot=None, placed=False)
    return station


def silent() -> FakeStation:
    """Return a station whose robot has not been heard for three seconds."""
    station = station_after_drive()
    station.clock.advance(3_000 * MS)
    station.scene_now = replace(station.scene_now, live=False)
    return station


STATES: dict[str, Callable[[], FakeStation]] = {
    "forest": in_forest,
    "failsafe": in_failsafe,
    "no-robot": without_robot,
    "place-unknown": lost,
    "silent": silent,
}


@pytest.fixture(autouse=True)
def utc(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Show clock times in UTC."""
    monkeypatch.setenv("TZ", "UTC")
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("size", SIZES, ids=lambda size: f"{size[0]}x{size[1]}")
def test_drive_screen_in_a_state(size: tuple[int, int], state: str, update_screens: bool) -> None:
    async def story() -> None:
        async with staged(size, station=STATES[state]()) as stage:
            check(stage, f"drive-{size[0]}x{size[1]}-{state}", update=update_screens)

    play(story)


@pytest.mark.parametrize("size", SIZES, ids=lambda size: f"{size[0]}x{size[1]}")
def test_drive_screen_without_colours_and_unicode(
    size: tuple[int, int], update_screens: bool
) -> None:
    async def story() -> None:
        async with staged(size, station=in_forest(), theme="mono", ascii_only=True) as stage:
            check(stage, f"drive-{size[0]}x{size[1]}-mono-ascii", update=update_screens)
            text = "".join(strip.text for strip in stage.app.screen._compositor.render_strips())
            assert text.isascii()

    play(story)
