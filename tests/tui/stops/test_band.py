"""The band names the cause of a stop and the next keys, on every screen and in every size."""

from msgspec.structs import replace

from ground.app.input.keymap import keymap_of
from ground.app.screens import SCREENS
from ground.app.widgets.lines import Lines
from ground.client.telemetry import Age
from protocol.wire.enums import GoalState, Mode, Vehicle
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.tui.fakes import FakeStation
from tests.support.tui.pilot import Stage, play, staged
from tests.support.tui.stopped import entry, show, stopped, stopped_status
from tests.support.tui.underway import driving

KINDS = [(Vehicle.EMERGENCY_STOP, "EMERGENCY STOP r1", "alarm", "-estop"),
         (Vehicle.FAILSAFE, "FAILSAFE r1", "failsafe", "-failsafe")]  # fmt: skip
HIDDEN = {"drive": "", "typing": "esc, then "}


def roles(stage: Stage) -> set[str]:
    rows = stage.app.screen.query_one("#alarm", Lines).rows
    return {span.role for row in rows for span in row}


@each(("vehicle", "words", "role", "css"), KINDS)
def test_stop_colours_every_screen(vehicle: Vehicle, words: str, role: str, css: str) -> None:
    async def story() -> None:
        async with staged(station=stopped(vehicle)) as stage:
            for screen, key in SCREENS.items():
                await stage.press(str(key))
                rows = stage.words("alarm").splitlines()
                assert rows[0].strip().startswith(words), screen
                assert all(len(row) == 80 for row in rows), screen
                assert roles(stage) == {role}, screen
                assert stage.app.screen.has_class(css), screen
                assert ("1 Drive, then " in rows[1]) is (screen != "drive")
                show(stage.station, stopped_status(Vehicle.ACTIVE, stage.station.now_ns))
                await stage.redraw()
                assert not stage.app.screen.has_class(css), screen
                stopped(vehicle, stage.station)

    play(story)


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
def test_band_fits_every_size_and_look(size: tuple[int, int], rows: list[str], look: str) -> None:
    async def story() -> None:
        theme = "dark" if look == "ascii" else look
        station = stopped(Vehicle.EMERGENCY_STOP)
        async with staged(size, station=station, theme=theme, ascii_only=look == "ascii") as stage:
            assert [row.strip() for row in stage.words("alarm").splitlines()] == rows

    play(story)


@each(
    ("size", "rows"),
    [
        ((80, 24), ["FAILSAFE r1  3 s ago: control loop too slow (computer busy), wheels stand",
                    "a arm, r go on to 6.40 6.40 45"]),
        ((20, 5), ["FAILSAFE r1", "a arm, r go on"]),
    ],
)  # fmt: skip
def test_failsafe_says_its_cause_and_two_keys(size: tuple[int, int], rows: list[str]) -> None:
    async def story() -> None:
        async with staged(size, station=stopped(Vehicle.FAILSAFE)) as stage:
            stage.app.sample()
            stage.station.clock.advance(3_000_000_000)
            stopped(Vehicle.FAILSAFE, stage.station)
            await stage.redraw()
            assert [row.strip() for row in stage.words("alarm").splitlines()] == rows

    play(story)


def test_next_keys_remain_until_the_robot_drives() -> None:
    async def story() -> None:
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

    play(story)


def test_goal_that_an_operator_aborted_shows_no_band() -> None:
    async def story() -> None:
        station = driving(FakeStation())
        shown = stopped_status(Vehicle.ACTIVE, station.now_ns)
        show(station, replace(shown, goal_reason=Reason.BY_OPERATOR))
        async with staged(station=station) as stage:
            assert stage.words("alarm") == ""
            show(station, replace(shown, mode=Mode.MANUAL))
            await stage.redraw()
            assert stage.words("alarm") == ""

    play(story)


def test_band_names_the_keys_in_force() -> None:
    async def story() -> None:
        keys = {"clear-estop": "f6", "arm": "f7", "resume": []}
        keymap = keymap_of({"keys": keys}, file="keys.toml")
        async with staged(station=stopped(Vehicle.EMERGENCY_STOP), keymap=keymap) as stage:
            assert "f6 f6 clear, f7 arm, :resume go on to" in stage.words("alarm")

    play(story)


def test_band_says_how_to_leave_the_command_line_first() -> None:
    async def story() -> None:
        async with staged(station=stopped(Vehicle.FAILSAFE)) as stage:
            await stage.press("colon")
            assert "esc, then a arm, r go on to" in stage.words("alarm")

    play(story)


def test_stop_of_another_operator_is_not_claimed() -> None:
    async def story() -> None:
        station = stopped(Vehicle.EMERGENCY_STOP)
        station.last_stop_now = None
        async with staged(station=station) as stage:
            assert "EMERGENCY STOP r1  by another operator" in stage.words("alarm")
            assert "acknowledged" not in stage.words("alarm")

    play(story)


def test_without_a_lost_goal_the_band_offers_a_new_one() -> None:
    async def story() -> None:
        station = driving(FakeStation())
        shown = stopped_status(Vehicle.FAILSAFE, station.now_ns)
        show(station, replace(shown, goal=GoalState.REACHED))
        async with staged(station=station) as stage:
            assert "a arm, g goal" in stage.words("alarm")

    play(story)


def test_broken_fence_is_lifted_before_the_robot_is_armed() -> None:
    async def story() -> None:
        station = driving(FakeStation())
        shown = stopped_status(Vehicle.FAILSAFE, station.now_ns)
        show(station, replace(shown, vehicle_reason=Reason.FENCE_BREACHED))
        async with staged(station=station) as stage:
            assert ":fence off lift the fence, a arm" in stage.words("alarm")

    play(story)


def test_stop_of_another_robot_has_a_row_of_its_own() -> None:
    async def story() -> None:
        station = driving(FakeStation())
        station.robots_now = ["r1", "r2", "r3", "r4"]
        failed = stopped_status(Vehicle.FAILSAFE, station.now_ns)
        halted = stopped_status(Vehicle.EMERGENCY_STOP, station.now_ns)
        station.roster_now = [entry("r2", failed), entry("r3", halted, Age.GONE)]
        async with staged(station=station) as stage:
            assert " ".join(stage.words("alarm").split()) == (
                "r2 FAILSAFE: control loop too slow (computer busy) [ ] select"
            )
            assert roles(stage) == {"failsafe"}
            assert not stage.app.screen.has_class("-failsafe")
            station.roster_now = [entry("r2", failed), entry("r3", halted)]
            await stage.redraw()
            assert "r2 FAILSAFE, r3 EMERGENCY STOP" in stage.words("alarm")
            assert roles(stage) == {"alarm"}

    play(story)
