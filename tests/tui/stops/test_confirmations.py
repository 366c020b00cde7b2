"""Steps with a large effect need a second press, and a stopped robot obeys no mouse or paste."""

import pytest
from msgspec.structs import replace
from textual import events

from ground.app.chrome.button_row import ButtonRow
from ground.app.screens import SCREENS
from protocol.wire.enums import GoalState, Mode, Vehicle
from protocol.wire.messages import NavigatorStatus
from tests.support.each import each
from tests.support.tui.fakes import FakeStation
from tests.support.tui.pilot import Stage, play, staged
from tests.support.tui.stopped import entry, stopped
from tests.support.tui.underway import driving, status

KEY_BAR = [(x, 23) for x in range(14, 120, 7)]
"""Places on the key bar, without those of the stop key."""


def left(stage: Stage) -> bool:
    return stage.app._exit


def under_way(**changes: int) -> FakeStation:
    station = driving(FakeStation())
    message: NavigatorStatus = replace(status(station.now_ns), **changes)
    station.roster_now = [entry("r1", message)]
    return station


@each("screen", ["drive", "params"])
def test_app_is_left_at_the_second_press_while_a_robot_drives(screen: str) -> None:
    async def story() -> None:
        async with staged(station=under_way()) as stage:
            await stage.press(str(SCREENS[screen]), "ctrl+q")
            assert "r1 drives: ctrl+q again within 5 s leaves" in stage.log()
            stage.station.clock.advance(6_000_000_000)
            await stage.press("ctrl+q")
            assert not left(stage)
            await stage.pilot.press("ctrl+q")
            assert left(stage)

    play(story)


def test_robot_that_is_not_selected_keeps_the_app_open_too() -> None:
    async def story() -> None:
        station = under_way(goal=GoalState.REACHED)
        station.robots_now = ["r1", "r2"]
        by_hand = replace(status(station.now_ns), mode=Mode.MANUAL, goal=GoalState.NONE)
        station.roster_now.append(entry("r2", by_hand))
        async with staged(station=station) as stage:
            await stage.press("ctrl+q")
            assert "r2 drives" in stage.log()
            assert not left(stage)

    play(story)


@each(
    "changes",
    [
        {"goal": GoalState.REACHED},
        {"mode": Mode.HOLD},
        {"vehicle": Vehicle.FAILSAFE},
        {"vehicle": Vehicle.STANDBY},
    ],
)
def test_app_is_left_at_once_when_all_robots_stand(changes: dict[str, int]) -> None:
    async def story() -> None:
        async with staged(station=under_way(**changes)) as stage:
            await stage.pilot.press("ctrl+q")
            assert left(stage)

    play(story)


@each("key", ["q", "ctrl+c"])
def test_keys_that_usually_quit_name_the_one_that_does(key: str) -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press(key)
            assert "ctrl+q quits" in stage.log()
            assert not left(stage)

    play(story)


def test_letter_q_is_text_in_a_command() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("colon", "q")
            assert stage.app.base_screen is not None
            assert stage.app.base_screen.command_line.value == "q"
            assert "quits" not in stage.log()

    play(story)


@pytest.mark.sweep(4)
@pytest.mark.parametrize("screen", ["params", "drive", "worlds", "faults"])
def test_clicks_command_nothing_in_an_emergency_stop(screen: str) -> None:
    async def story() -> None:
        async with staged((120, 24), station=stopped(Vehicle.EMERGENCY_STOP)) as stage:
            await stage.press(str(SCREENS[screen]))
            for x, y in [*((x, y) for x in (5, 110) for y in (2, 3, 8)), *KEY_BAR]:
                await stage.pilot.click(offset=(x, y), times=2)
            assert stage.commands.given == []
            assert not left(stage)

    play(story)


def test_click_on_the_key_bar_holds_a_robot_that_drives() -> None:
    async def story() -> None:
        async with staged((120, 24)) as stage:
            bar = stage.app.screen.query_one("#keybar", ButtonRow)
            column = next(x for x in range(120) if bar.action_at(x) == "do('hold')")
            await stage.pilot.click(offset=(column, 23))
            assert stage.commands.given == ["hold"]
            stopped(Vehicle.EMERGENCY_STOP, stage.station)
            await stage.pilot.click(offset=(column, 23))
            assert stage.commands.given == ["hold"]
            assert "by keys only" in stage.log()

    play(story)


def test_pasted_text_clears_no_emergency_stop() -> None:
    async def story() -> None:
        async with staged(station=stopped(Vehicle.EMERGENCY_STOP)) as stage:
            for screen, key in SCREENS.items():
                await stage.press(str(key))
                stage.app.post_message(events.Paste("DDarg 1 2\nclear-estop\narm\n"))
                await stage.redraw()
                assert stage.commands.given == [], screen

    play(story)
