"""The bell rings once for each stop and arrival of any robot, on any screen."""

from msgspec.structs import replace
from textual.widgets._toast import Toast

from ground.app.app import GroundApp
from ground.app.appearance import Appearance
from ground.app.stops.stop_watch import MOST_KEPT
from ground.client.telemetry import Age
from protocol.topics import STATUS
from protocol.wire.enums import GoalState, Vehicle
from protocol.wire.messages import NavigatorStatus
from tests.support.each import each
from tests.support.tui.fakes import FakeCommandSink, FakeStation
from tests.support.tui.pilot import Stage, play, staged
from tests.support.tui.stopped import entry, stopped_status
from tests.support.tui.underway import driving, status

WHY = "(computer busy)"


class Ear:
    """Counts the bell and keeps the messages of an app."""

    def __init__(self, app: GroundApp) -> None:
        self.rings = 0
        self.messages: list[str] = []
        self.cleared = 0
        app.clear_notifications = self.clear  # type: ignore[method-assign]
        app.bell = self.ring  # type: ignore[method-assign]
        app.notify = self.keep  # type: ignore[method-assign]

    def ring(self) -> None:
        self.rings += 1

    def clear(self) -> None:
        self.cleared += 1

    def keep(self, message: str, **_: object) -> None:
        self.messages.append(message)


def show(stage: Stage, robot: str, shown: NavigatorStatus, age: Age = Age.LIVE) -> None:
    """Let the app see a status of a robot, several times."""
    stage.station.robots_now = sorted({*stage.station.robots_now, robot})
    others = [one for one in stage.station.roster_now if one.robot != robot]
    stage.station.roster_now = [*others, entry(robot, shown, age)]
    for _ in range(3):
        stage.app.sample()


def test_bell_rings_once_for_each_stop() -> None:
    async def story() -> None:
        async with staged() as stage:
            ear, now_ns = Ear(stage.app), stage.station.now_ns
            show(stage, "r1", status(now_ns))
            assert ear.rings == 0
            show(stage, "r1", stopped_status(Vehicle.FAILSAFE, now_ns))
            assert ear.rings == 1
            show(stage, "r1", stopped_status(Vehicle.EMERGENCY_STOP, now_ns))
            again = replace(stopped_status(Vehicle.EMERGENCY_STOP, now_ns), stop_id=99)
            show(stage, "r1", again)
            assert ear.rings == 2
            show(stage, "r1", stopped_status(Vehicle.STANDBY, now_ns))
            assert ear.rings == 2
            assert ear.messages == []  # the band has it

    play(story)


def test_stop_of_a_robot_that_is_not_selected_rings_on_every_screen() -> None:
    async def story() -> None:
        async with staged() as stage:
            ear = Ear(stage.app)
            await stage.press("5")
            show(stage, "r2", stopped_status(Vehicle.FAILSAFE, stage.station.now_ns))
            assert ear.rings == 1
            assert ear.messages == ["r2 FAILSAFE: control loop too slow (computer busy)"]

    play(story)


def test_stop_of_all_robots_rings_once_and_shows_one_message() -> None:
    async def story() -> None:
        async with staged() as stage:
            ear, now_ns = Ear(stage.app), stage.station.now_ns
            for number in range(1, 13):
                show(stage, f"r{number}", stopped_status(Vehicle.EMERGENCY_STOP, now_ns))
            assert ear.rings == 1
            assert ear.messages[-1] == (
                "r1 r2 r3 r4 r5 r6 and 6 more EMERGENCY STOP: by the operator"
            )
            assert ear.cleared == 11

    play(story)


def test_message_about_a_stop_disappears_with_the_stop() -> None:
    async def story() -> None:
        async with staged() as stage:
            ear, now_ns = Ear(stage.app), stage.station.now_ns
            for robot in ("r2", "r3"):
                show(stage, robot, stopped_status(Vehicle.FAILSAFE, now_ns))
            cleared = ear.cleared
            show(stage, "r2", stopped_status(Vehicle.STANDBY, now_ns))
            assert ear.cleared == cleared + 1
            assert ear.messages[-1] == "r3 FAILSAFE: control loop too slow (computer busy)"
            shown = len(ear.messages)
            show(stage, "r3", stopped_status(Vehicle.STANDBY, now_ns))
            assert (ear.cleared, len(ear.messages)) == (cleared + 2, shown)

    play(story)


@each(
    ("size", "shown"),
    [((80, 24), [8, 9, 10]), ((60, 18), [9, 10]), ((200, 60), [8, 9, 10]), ((20, 5), [])],
)
def test_messages_cover_neither_band_nor_prompt(size: tuple[int, int], shown: list[int]) -> None:
    async def story() -> None:
        station = driving(FakeStation())
        station.air.put(STATUS, stopped_status(Vehicle.FAILSAFE, station.now_ns), station.now_ns)
        async with staged(size, station=station, messages=True) as stage:
            screen = stage.app.screen
            for number in range(2, 11):
                stage.app.notify(f"r{number} FAILSAFE: control loop too slow {WHY}", timeout=60.0)
            await stage.until(lambda: len(screen.query("Toast")) == 9)
            for _ in range(3):
                await stage.redraw()
            toasts = [one for one in screen.query(Toast) if one.region.height]
            assert [int(str(one.render()).split()[0][1:]) for one in toasts] == shown
            for toast in toasts:
                assert toast.region.y >= screen.query_one("#alarm").region.bottom
                assert toast.region.bottom <= screen.query_one("#typing").region.y

    play(story)


def test_robots_that_are_watched_no_more_are_forgotten() -> None:
    async def story() -> None:
        async with staged() as stage:
            failed = stopped_status(Vehicle.FAILSAFE, stage.station.now_ns)
            for number in range(MOST_KEPT + 1):
                stage.station.robots_now = ["r1", f"x{number}"]
                stage.station.roster_now = [entry(f"x{number}", failed)]
                stage.app._alerts.poll()
            stage.app._alerts.poll()
            assert set(stage.app._alerts.watch._robots) == {f"x{MOST_KEPT}"}

    play(story)


def test_robot_that_comes_and_goes_in_failsafe_rings_once() -> None:
    async def story() -> None:
        async with staged() as stage:
            ear = Ear(stage.app)
            failed = stopped_status(Vehicle.FAILSAFE, stage.station.now_ns)
            for _ in range(10):
                show(stage, "r2", failed)
                show(stage, "r2", failed, Age.GONE)
                stage.station.roster_now, stage.station.robots_now = [], ["r1"]
                stage.app.sample()
            assert ear.rings == 1

    play(story)


def test_goal_rings_when_it_stays_reached() -> None:
    async def story() -> None:
        async with staged() as stage:
            ear, station = Ear(stage.app), stage.station
            under_way = status(station.now_ns)
            reached = replace(under_way, goal=GoalState.REACHED)
            show(stage, "r1", reached)
            station.clock.advance(1_000_000_000)
            show(stage, "r1", reached)
            assert ear.rings == 0  # it was reached before the app looked
            show(stage, "r1", under_way)
            show(stage, "r1", reached)
            assert ear.rings == 0
            station.clock.advance(600_000_000)
            show(stage, "r1", reached)
            assert (ear.rings, ear.messages) == (1, ["r1 goal reached"])

    play(story)


def test_waypoint_that_is_left_at_once_does_not_ring() -> None:
    async def story() -> None:
        async with staged() as stage:
            ear, station = Ear(stage.app), stage.station
            first = status(station.now_ns)
            show(stage, "r1", first)
            show(stage, "r1", replace(first, goal=GoalState.REACHED))
            show(stage, "r1", replace(first, goal_started_ns=station.now_ns))
            station.clock.advance(1_000_000_000)
            show(stage, "r1", replace(first, goal_started_ns=station.now_ns))
            assert ear.rings == 0

    play(story)


def test_quiet_bell_shows_the_message_only() -> None:
    async def story() -> None:
        station = driving(FakeStation())
        app = GroundApp(station, FakeCommandSink(), None, Appearance(quiet_bell=True, hz=0.0))
        async with app.run_test(size=(80, 24)) as pilot:
            stage, ear = Stage(app, pilot, station, FakeCommandSink()), Ear(app)
            show(stage, "r2", stopped_status(Vehicle.FAILSAFE, station.now_ns))
            assert ear.rings == 0
            assert len(ear.messages) == 1

    play(story)


def test_small_terminal_rings_without_a_message() -> None:
    async def story() -> None:
        async with staged((40, 12)) as stage:
            ear = Ear(stage.app)
            show(stage, "r2", stopped_status(Vehicle.FAILSAFE, stage.station.now_ns))
            assert (ear.rings, ear.messages) == (1, [])

    play(story)


def test_recording_rings_no_bell() -> None:
    async def story() -> None:
        async with staged() as stage:
            ear = Ear(stage.app)
            stage.station.live_now = False
            show(stage, "r1", stopped_status(Vehicle.FAILSAFE, stage.station.now_ns))
            assert (ear.rings, ear.messages) == (0, [])

    play(story)
