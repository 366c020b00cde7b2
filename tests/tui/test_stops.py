"""Stops: the bell, the band that names cause and keys, and confirmations."""

from pathlib import Path

import pytest
from msgspec.structs import replace
from textual import events
from textual.widgets._toast import Toast

from ground.app.app import GroundApp, notification
from ground.app.appearance import Appearance
from ground.app.chrome.button_row import ButtonRow
from ground.app.input.keymap import keymap_of
from ground.app.screens import SCREENS
from ground.app.stops.alerts import run_hook
from ground.app.stops.stop_watch import MOST_KEPT, EventKind
from ground.app.widgets.lines import Lines
from ground.client.telemetry import Age
from ground.station.robot.lease_state import LeaseView
from protocol.topics import STATUS
from protocol.wire.enums import GoalState, Mode, Vehicle
from protocol.wire.messages import NavigatorStatus
from protocol.wire.reasons import Reason
from tests.support.app import (
    FakeCommandSink,
    FakeStation,
    Stage,
    driving,
    entry,
    staged,
    status,
    stopped,
    stopped_status,
)
from tests.support.app import show as stopped_show
from tests.support.each import each

KINDS = [(Vehicle.EMERGENCY_STOP, "EMERGENCY STOP r1", "alarm", "-estop"),
         (Vehicle.FAILSAFE, "FAILSAFE r1", "failsafe", "-failsafe")]  # fmt: skip
HIDDEN = {"drive": "", "typing": "esc, then "}


def roles(stage: Stage) -> set[str]:
    rows = stage.app.screen.query_one("#alarm", Lines).rows
    return {span.role for row in rows for span in row}


@each(("vehicle", "words", "role", "css"), KINDS)
async def test_stop_colours_every_screen(vehicle: Vehicle, words: str, role: str, css: str) -> None:
    async with staged(station=stopped(vehicle)) as stage:
        for screen, key in SCREENS.items():
            await stage.press(str(key))
            rows = stage.words("alarm").splitlines()
            assert rows[0].strip().startswith(words), screen
            assert all(len(row) == 80 for row in rows), screen
            assert roles(stage) == {role}, screen
            assert stage.app.screen.has_class(css), screen
            assert ("1 Drive, then " in rows[1]) is (screen != "drive")
            stopped_show(stage.station, stopped_status(Vehicle.ACTIVE, stage.station.now_ns))
            await stage.redraw()
            assert not stage.app.screen.has_class(css), screen
            stopped(vehicle, stage.station)


@each(
    ("size", "rows"),
    [
        ((120, 40), ["EMERGENCY STOP r1  by you 12 s ago, acknowledged in 36 ms, wheels stand"
                     "      D D clear, a arm, r go on to 6.40 6.40 45"]),
        ((80, 24), ["EMERGENCY STOP r1  by you 12 s ago, acknowledged in 36 ms, wheels stand",
                    "D D clear, a arm, r go on to 6.40 6.40 45"]),
        ((40, 12), ["EMERGENCY STOP r1  by you 12 s ago,", "acknowledged in 36 ms, wheels stand",
                    "D D clear, a arm, r go on"]),
        ((20, 5), ["EMERGENCY STOP r1", "D D  a  r"]),
    ],
)  # fmt: skip
@each("look", ["dark", "mono", "ansi", "ascii"])
async def test_band_fits_every_size_and_look(
    size: tuple[int, int], rows: list[str], look: str
) -> None:
    theme = "dark" if look == "ascii" else look
    station = stopped(Vehicle.EMERGENCY_STOP)
    async with staged(size, station=station, theme=theme, ascii_only=look == "ascii") as stage:
        assert [row.strip() for row in stage.words("alarm").splitlines()] == rows


@each(
    ("size", "rows"),
    [
        ((80, 24), ["FAILSAFE r1  3 s ago: control loop too slow (computer busy), wheels stand",
                    "a arm, r go on to 6.40 6.40 45"]),
        ((20, 5), ["FAILSAFE r1", "a arm, r go on"]),
    ],
)  # fmt: skip
async def test_failsafe_says_its_cause_and_two_keys(size: tuple[int, int], rows: list[str]) -> None:
    async with staged(size, station=stopped(Vehicle.FAILSAFE)) as stage:
        stage.app.sample()
        stage.station.clock.advance(3_000_000_000)
        stopped(Vehicle.FAILSAFE, stage.station)
        await stage.redraw()
        assert [row.strip() for row in stage.words("alarm").splitlines()] == rows


async def test_next_keys_remain_until_the_robot_drives() -> None:
    async with staged(station=stopped(Vehicle.STANDBY)) as stage:
        words = stage.words("alarm").split()
        assert " ".join(words) == "r1 disarmed a arm, r go on to 6.40 6.40 45"
        stopped(Vehicle.ACTIVE, stage.station)
        await stage.redraw()
        words = stage.words("alarm").split()
        assert " ".join(words) == "r1 armed r go on to 6.40 6.40 45"
        driving(stage.station)
        await stage.redraw()
        assert stage.words("alarm") == ""


async def test_goal_that_an_operator_aborted_shows_no_band() -> None:
    station = driving(FakeStation())
    shown = stopped_status(Vehicle.ACTIVE, station.now_ns)
    stopped_show(station, replace(shown, goal_reason=Reason.BY_OPERATOR))
    async with staged(station=station) as stage:
        assert stage.words("alarm") == ""
        stopped_show(station, replace(shown, mode=Mode.MANUAL))
        await stage.redraw()
        assert stage.words("alarm") == ""


async def test_band_names_the_keys_in_force() -> None:
    keys = {"clear-estop": "f6", "arm": "f7", "resume": []}
    keymap = keymap_of({"keys": keys}, file="keys.toml")
    async with staged(station=stopped(Vehicle.EMERGENCY_STOP), keymap=keymap) as stage:
        assert "f6 f6 clear, f7 arm, :resume go on to" in stage.words("alarm")


async def test_band_says_how_to_leave_the_command_line_first() -> None:
    async with staged(station=stopped(Vehicle.FAILSAFE)) as stage:
        await stage.press("colon")
        assert "esc, then a arm, r go on to" in stage.words("alarm")


async def test_stop_of_another_operator_is_not_claimed() -> None:
    station = stopped(Vehicle.EMERGENCY_STOP)
    station.last_stop_now = None
    async with staged(station=station) as stage:
        assert "EMERGENCY STOP r1  by another operator" in stage.words("alarm")
        assert "acknowledged" not in stage.words("alarm")


async def test_without_a_lost_goal_the_band_offers_a_new_one() -> None:
    station = driving(FakeStation())
    shown = stopped_status(Vehicle.FAILSAFE, station.now_ns)
    stopped_show(station, replace(shown, goal=GoalState.REACHED))
    async with staged(station=station) as stage:
        assert "a arm, g goal" in stage.words("alarm")


async def test_broken_fence_is_lifted_before_the_robot_is_armed() -> None:
    station = driving(FakeStation())
    shown = stopped_status(Vehicle.FAILSAFE, station.now_ns)
    stopped_show(station, replace(shown, vehicle_reason=Reason.FENCE_BREACHED))
    async with staged(station=station) as stage:
        assert ":fence off lift the fence, a arm" in stage.words("alarm")


async def test_stop_of_another_robot_has_a_row_of_its_own() -> None:
    station = driving(FakeStation())
    station.robots_now = ["r1", "r2", "r3", "r4"]
    failed = stopped_status(Vehicle.FAILSAFE, station.now_ns)
    halted = stopped_status(Vehicle.EMERGENCY_STOP, station.now_ns)
    station.entries = [entry("r2", failed), entry("r3", halted, Age.GONE)]
    async with staged(station=station) as stage:
        assert " ".join(stage.words("alarm").split()) == (
            "r2 FAILSAFE: control loop too slow (computer busy) ! select"
        )
        assert roles(stage) == {"failsafe"}
        assert not stage.app.screen.has_class("-failsafe")
        station.entries = [entry("r2", failed), entry("r3", halted)]
        await stage.redraw()
        assert "r2 FAILSAFE, r3 EMERGENCY STOP" in stage.words("alarm")
        assert roles(stage) == {"alarm"}


KEY_BAR = [(x, 23) for x in range(14, 120, 7)]
"""Places on the key bar, without those of the stop key."""


def left(stage: Stage) -> bool:
    return stage.app._exit


def under_way(**changes: int) -> FakeStation:
    station = driving(FakeStation())
    message: NavigatorStatus = replace(status(station.now_ns), **changes)
    station.entries = [entry("r1", message)]
    return station


@each("screen", ["drive", "params"])
async def test_app_is_left_at_the_second_press_while_a_robot_drives(screen: str) -> None:
    async with staged(station=under_way()) as stage:
        await stage.press(str(SCREENS[screen]), "ctrl+q")
        assert "r1 drives: press ctrl+q again within 3 s to leave" in stage.log()
        stage.station.clock.advance(6_000_000_000)
        await stage.press("ctrl+q")
        assert not left(stage)
        await stage.pilot.press("ctrl+q")
        assert left(stage)


async def test_robot_that_is_not_selected_keeps_the_app_open_too() -> None:
    station = under_way(goal=GoalState.REACHED)
    station.robots_now = ["r1", "r2"]
    by_hand = replace(status(station.now_ns), mode=Mode.MANUAL, goal=GoalState.NONE)
    station.entries.append(entry("r2", by_hand))
    async with staged(station=station) as stage:
        await stage.press("ctrl+q")
        assert "r2 drives" in stage.log()
        assert not left(stage)


@each(
    "changes",
    [
        {"goal": GoalState.REACHED},
        {"mode": Mode.HOLD},
        {"vehicle": Vehicle.FAILSAFE},
        {"vehicle": Vehicle.STANDBY},
    ],
)
async def test_app_is_left_at_once_when_all_robots_stand(changes: dict[str, int]) -> None:
    async with staged(station=under_way(**changes)) as stage:
        await stage.pilot.press("ctrl+q")
        assert left(stage)


@each("key", ["q", "ctrl+c"])
async def test_keys_that_usually_quit_name_the_one_that_does(key: str) -> None:
    async with staged() as stage:
        await stage.press(key)
        assert "ctrl+q quits" in stage.log()
        assert not left(stage)


async def test_letter_q_is_text_in_a_command() -> None:
    async with staged() as stage:
        await stage.press("colon", "q")
        assert stage.app.base_screen is not None
        assert stage.app.base_screen.command_line.value == "q"
        assert "quits" not in stage.log()


@pytest.mark.sweep(4)
@pytest.mark.parametrize("screen", ["params", "drive", "worlds", "faults"])
async def test_clicks_command_nothing_in_an_emergency_stop(screen: str) -> None:
    async with staged((120, 24), station=stopped(Vehicle.EMERGENCY_STOP)) as stage:
        await stage.press(str(SCREENS[screen]))
        for x, y in [*((x, y) for x in (5, 110) for y in (2, 3, 8)), *KEY_BAR]:
            await stage.pilot.click(offset=(x, y), times=2)
        assert stage.commands.given == []
        assert not left(stage)


async def test_click_on_the_key_bar_holds_a_robot_that_drives() -> None:
    async with staged((120, 24)) as stage:
        bar = stage.app.screen.query_one("#keybar", ButtonRow)
        column = next(x for x in range(120) if bar.action_at(x) == "do('hold')")
        await stage.pilot.click(offset=(column, 23))
        assert stage.commands.given == ["hold"]
        stopped(Vehicle.EMERGENCY_STOP, stage.station)
        await stage.pilot.click(offset=(column, 23))
        assert stage.commands.given == ["hold"]
        assert "by keys only" in stage.log()


async def test_pasted_text_clears_no_emergency_stop() -> None:
    async with staged(station=stopped(Vehicle.EMERGENCY_STOP)) as stage:
        for screen, key in SCREENS.items():
            await stage.press(str(key))
            stage.app.post_message(events.Paste("DDarg 1 2\nclear-estop\narm\n"))
            await stage.redraw()
            assert stage.commands.given == [], screen


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
    others = [one for one in stage.station.entries if one.robot != robot]
    stage.station.entries = [*others, entry(robot, shown, age)]
    for _ in range(3):
        stage.app.sample()


async def test_bell_rings_once_for_each_stop() -> None:
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


async def test_stop_of_a_robot_that_is_not_selected_rings_on_every_screen() -> None:
    async with staged() as stage:
        ear = Ear(stage.app)
        await stage.press("5")
        show(stage, "r2", stopped_status(Vehicle.FAILSAFE, stage.station.now_ns))
        assert ear.rings == 1
        assert ear.messages == ["r2 FAILSAFE: control loop too slow (computer busy)"]


async def test_hook_and_desktop_are_called_for_stop_and_arrival(tmp_path: Path) -> None:
    station, calls = driving(FakeStation()), tmp_path / "calls"
    hook = f'echo "$SIDESTEP_EVENT $SIDESTEP_ROBOTS: $SIDESTEP_TEXT" >>{calls}'
    app = GroundApp(station, FakeCommandSink(), None, Appearance(hook=hook, desktop=True, hz=0.0))
    async with app.run_test(size=(80, 24)) as pilot:
        stage, shown = Stage(app, pilot, station, FakeCommandSink()), list[str]()
        app.notify_desktop = shown.append  # type: ignore[method-assign,assignment]
        show(stage, "r2", stopped_status(Vehicle.FAILSAFE, station.now_ns))
        await app.workers.wait_for_complete()
    words = "r2 FAILSAFE: control loop too slow (computer busy)"
    assert shown == [words]
    assert calls.read_text() == f"failsafe r2: {words}\n"


def test_failed_hook_is_reported() -> None:
    said = run_hook("exit 3", ["r1"], EventKind.REACHED, "")
    assert said == "hook: ended with 3: exit 3"


def test_notification_holds_no_control_characters() -> None:
    assert notification("r1\x07 stopped", in_tmux=False).count("\x07") == 1
    assert notification("r1", in_tmux=True).startswith("\x1bPtmux;\x1b\x1b]9;r1\x07")


async def test_stop_of_all_robots_rings_once_and_shows_one_message() -> None:
    async with staged() as stage:
        ear, now_ns = Ear(stage.app), stage.station.now_ns
        for number in range(1, 13):
            show(stage, f"r{number}", stopped_status(Vehicle.EMERGENCY_STOP, now_ns))
        assert ear.rings == 1
        assert ear.messages[-1] == ("r1 r2 r3 r4 r5 r6 and 6 more EMERGENCY STOP: by the operator")
        assert ear.cleared == 11


async def test_message_about_a_stop_disappears_with_the_stop() -> None:
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


@each(
    ("size", "shown"),
    [((80, 24), [8, 9, 10]), ((60, 18), [9, 10]), ((200, 60), [8, 9, 10]), ((20, 5), [])],
)
async def test_messages_cover_neither_band_nor_prompt(
    size: tuple[int, int], shown: list[int]
) -> None:
    station = driving(FakeStation())
    station.bus.say(STATUS, stopped_status(Vehicle.FAILSAFE, station.now_ns))
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


async def test_robots_that_are_watched_no_more_are_forgotten() -> None:
    async with staged() as stage:
        failed = stopped_status(Vehicle.FAILSAFE, stage.station.now_ns)
        for number in range(MOST_KEPT + 1):
            stage.station.robots_now = ["r1", f"x{number}"]
            stage.station.entries = [entry(f"x{number}", failed)]
            stage.app._alerts.poll()
        stage.app._alerts.poll()
        assert set(stage.app._alerts.watch._robots) == {f"x{MOST_KEPT}"}


async def test_robot_that_comes_and_goes_in_failsafe_rings_once() -> None:
    async with staged() as stage:
        ear = Ear(stage.app)
        failed = stopped_status(Vehicle.FAILSAFE, stage.station.now_ns)
        for _ in range(10):
            show(stage, "r2", failed)
            show(stage, "r2", failed, Age.GONE)
            stage.station.entries, stage.station.robots_now = [], ["r1"]
            stage.app.sample()
        assert ear.rings == 1


async def test_goal_rings_when_it_stays_reached() -> None:
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


async def test_waypoint_that_is_left_at_once_does_not_ring() -> None:
    async with staged() as stage:
        ear, station = Ear(stage.app), stage.station
        first = status(station.now_ns)
        show(stage, "r1", first)
        show(stage, "r1", replace(first, goal=GoalState.REACHED))
        show(stage, "r1", replace(first, goal_started_ns=station.now_ns))
        station.clock.advance(1_000_000_000)
        show(stage, "r1", replace(first, goal_started_ns=station.now_ns))
        assert ear.rings == 0


async def test_quiet_bell_shows_the_message_only() -> None:
    station = driving(FakeStation())
    app = GroundApp(station, FakeCommandSink(), None, Appearance(quiet_bell=True, hz=0.0))
    async with app.run_test(size=(80, 24)) as pilot:
        stage, ear = Stage(app, pilot, station, FakeCommandSink()), Ear(app)
        show(stage, "r2", stopped_status(Vehicle.FAILSAFE, station.now_ns))
        assert ear.rings == 0
        assert len(ear.messages) == 1


async def test_small_terminal_rings_without_a_message() -> None:
    async with staged((40, 12)) as stage:
        ear = Ear(stage.app)
        show(stage, "r2", stopped_status(Vehicle.FAILSAFE, stage.station.now_ns))
        assert (ear.rings, ear.messages) == (1, [])


async def test_recording_rings_no_bell() -> None:
    async with staged() as stage:
        ear = Ear(stage.app)
        stage.station.live_now = False
        show(stage, "r1", stopped_status(Vehicle.FAILSAFE, stage.station.now_ns))
        assert (ear.rings, ear.messages) == (0, [])


async def test_band_names_whose_lease_a_stopped_robot_has() -> None:
    """The keys that lead on would be refused."""
    station = stopped(Vehicle.EMERGENCY_STOP)
    station.lease_now = LeaseView(held=True, name="ben")
    async with staged((120, 40), station=station) as stage:
        band = stage.words("alarm")
        assert "ben commands: `lease seize` takes over" in band
        assert "clear" not in band
        for _ in range(2):
            await stage.press("D")
        assert "ben commands: `lease seize` takes over" in stage.words("answer")
        assert stage.commands.given == []
