"""Test that the robot can be stopped everywhere, and that teleop ends without keys."""

from itertools import product

from textual import events

from ground.app.input.driver import InputParser
from ground.app.screens import SCREENS
from ground.app.screens.drive import DriveScreen
from protocol.wire.enums import Vehicle
from tests.support.each import each
from tests.support.tui.pilot import Stage, play, staged
from tests.support.tui.stopped import stopped
from tests.support.tui.underway import driving

SCREEN_KEYS = {name: str(number) for name, number in SCREENS.items()}


def later(stage: Stage, seconds: float = 2.0) -> Stage:
    """Let time pass, so that the next press of the stop is a first one."""
    stage.station.clock.advance(round(seconds * 1e9))
    return stage


def shape_of(stage: Stage) -> tuple[type, str]:
    """Return which screen takes the keys, and the kind of its focused widget."""
    return type(stage.app.screen), type(stage.app.focused).__name__


def drive_of(stage: Stage) -> DriveScreen:
    assert isinstance(stage.app.screen, DriveScreen)
    return stage.app.screen


def test_stop_keys_work_on_every_screen() -> None:
    async def story() -> None:
        async with staged() as stage:
            for number, (name, key) in enumerate(SCREEN_KEYS.items()):
                await later(stage).press(key)
                assert type(stage.app.screen).__name__ == f"{name.capitalize()}Screen"
                await stage.press("f12")
                await later(stage).press("space")
                later(stage).app.post_message(events.Key("ctrl+@", "\x00"))
                await stage.redraw()
                assert stage.station.stops == 3 * number + 3, name
                await stage.press("S")
                assert stage.station.stops == 3 * number + 3, name
                assert stage.station.stops_of_all == number + 1, name

    play(story)


def test_stop_keys_work_in_dialogs_and_command_lines() -> None:
    async def story() -> None:
        async with staged() as stage:
            cases = [("drive", key) for key in ("?", "m", "ctrl+p")]
            cases += [(name, "colon") for name in SCREENS]
            for number, (name, opening) in enumerate(cases):
                case = f"{opening} on {name}"
                await later(stage).press(SCREEN_KEYS[name])
                assert type(stage.app.screen).__name__ == f"{name.capitalize()}Screen", case
                shut = shape_of(stage)
                await stage.press(opening)
                assert shape_of(stage) != shut, case
                await stage.press("f12")
                later(stage).app.post_message(events.Key("ctrl+@", "\x00"))
                await stage.redraw()
                assert stage.station.stops == 2 * number + 2, case
                await stage.press("f12")
                assert stage.station.stops_of_all == number + 1, case
                await stage.press("escape")
                assert shape_of(stage) == shut, case

    play(story)


@each("opening", ["?", "m"])
def test_space_stops_the_robot_in_dialogs(opening: str) -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press(opening, "space")
            assert stage.station.stops == 1
            await stage.press("space")
            assert stage.station.stops_of_all == 1
            await later(stage).press("S")
            assert stage.station.stops_of_all == 2

    play(story)


def test_second_press_within_a_second_stops_all_robots() -> None:
    async def story() -> None:
        async with staged() as stage:
            counts = stage.station
            for k, (first, second) in enumerate(product(("space", "f12"), repeat=2)):
                await later(stage).press(first)
                await later(stage, 1.1).press(second)
                assert (counts.stops, counts.stops_of_all) == (3 * k + 2, k), (first, second)
                await later(stage, 0.9).press(first)
                assert (counts.stops, counts.stops_of_all) == (3 * k + 2, k + 1), (first, second)
                await later(stage, 0.1).press(second)
                assert (counts.stops, counts.stops_of_all) == (3 * k + 3, k + 1), (first, second)

    play(story)


def test_stop_keys_that_type_a_letter_are_text_in_a_command() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("colon")
            await stage.type("S ")
            assert stage.station.stops == stage.station.stops_of_all == 0

    play(story)


def test_stop_is_released_by_two_presses_only() -> None:
    async def story() -> None:
        async with staged(station=stopped(Vehicle.EMERGENCY_STOP)) as stage:
            await stage.press("D")
            assert stage.commands.given == []
            assert "press D again within 2 s to clear E-STOP of r1" in stage.log()
            await later(stage, 3.0).press("D")
            assert stage.commands.given == []
            await stage.press("D")
            assert stage.commands.given == ["clear-estop"]

    play(story)


def test_robot_that_is_not_stopped_has_nothing_to_clear() -> None:
    async def story() -> None:
        async with staged(station=stopped(Vehicle.FAILSAFE)) as stage:
            await stage.press("D", "D")
            assert stage.commands.given == []
            assert "r1 is not in E-STOP: nothing to clear" in stage.log()
            assert "again" not in stage.log()
            stage.station.stopping_now = "E-STOP not acknowledged"
            await stage.press("D", "D")
            assert stage.commands.given == ["clear-estop"]

    play(story)


def test_teleop_lasts_until_any_other_key() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("t", "up")
            drive_of(stage).poll()
            assert stage.commands.steered[-1] == (0.25, 0.0)
            await stage.press("A")
            drive_of(stage).poll()
            assert stage.commands.steered[-1] == (0.08, 0.5)
            stage.station.clock.advance(700_000_000)
            drive_of(stage).poll()
            assert stage.commands.steered[-1] == (0.0, 0.0)
            assert stage.commands.teleop
            await stage.press("q")
            assert not stage.commands.teleop

    play(story)


def test_teleop_ends_in_another_mode() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("t")
            stage.station.clock.advance(2_000_000_000)
            driving(stage.station)
            drive_of(stage).poll()
            assert not stage.commands.teleop

    play(story)


def test_space_stops_the_robot_during_teleop() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("t", "up", "space")
            assert stage.station.stops == 1

    play(story)


@each("opening", ["colon", "m", "e"])
def test_escape_and_a_quick_space_stop_the_robot(opening: str) -> None:
    """A terminal sends both in one piece, as the bytes of alt and space."""

    async def story() -> None:
        async with staged() as stage:
            await stage.press(opening)
            for event in InputParser().feed("\x1b ", 0.0):
                stage.app.post_message(event)
                await stage.redraw()
            assert stage.station.stops == 1
            assert stage.commands.given == []

    play(story)
