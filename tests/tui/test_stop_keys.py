"""The robot can be stopped everywhere; teleop, the goal cursor, and their ends."""

import os
from itertools import product
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from textual import events

from ground.app.frame_rate import FrameRate
from ground.app.input.driver import InputParser
from ground.app.input.gamepad import ALONG, AXIS, BUTTON, EVENT
from ground.app.input.map_cursor import Cursor, step_of
from ground.app.input.teleop_keys import AGAIN_NS, FAST, FIRST_NS, SLOW, DeadManSwitch
from ground.app.screens import SCREENS
from protocol.wire.enums import Vehicle
from runtime.units import NS_PER_MS as MS
from runtime.units import NS_PER_S as S
from tests.support.app import Stage, driving, staged, stopped
from tests.support.each import each

SCREEN_KEYS = {name: str(number) for name, number in SCREENS.items()}


def later(stage: Stage, seconds: float = 2.0) -> Stage:
    """Let time pass, so that the next press of the stop is a first one."""
    stage.station.clock.advance(round(seconds * 1e9))
    return stage


def shape_of(stage: Stage) -> tuple[type, str]:
    """Return which screen takes the keys, and the kind of its focused widget."""
    return type(stage.app.screen), type(stage.app.focused).__name__


async def test_stop_keys_work_on_every_screen() -> None:
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


async def test_stop_keys_work_in_dialogs_and_command_lines() -> None:
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


@each("opening", ["?", "m"])
async def test_space_stops_the_robot_in_dialogs(opening: str) -> None:
    async with staged() as stage:
        await stage.press(opening, "space")
        assert stage.station.stops == 1
        await stage.press("space")
        assert stage.station.stops_of_all == 1
        await later(stage).press("S")
        assert stage.station.stops_of_all == 2


async def test_second_press_within_a_second_stops_all_robots() -> None:
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


async def test_stop_keys_that_type_a_letter_are_text_in_a_command() -> None:
    async with staged() as stage:
        await stage.press("colon")
        await stage.type("S ")
        assert stage.station.stops == stage.station.stops_of_all == 0


async def test_stop_is_released_by_two_presses_only() -> None:
    async with staged(station=stopped(Vehicle.EMERGENCY_STOP)) as stage:
        await stage.press("D")
        assert stage.commands.given == []
        assert "press D again within 3 s to clear E-STOP of r1" in stage.log()
        await later(stage, 3.5).press("D")
        assert stage.commands.given == []
        await stage.press("D")
        assert stage.commands.given == ["clear-estop"]


async def test_robot_that_is_not_stopped_has_nothing_to_clear() -> None:
    async with staged(station=stopped(Vehicle.FAILSAFE)) as stage:
        await stage.press("D", "D")
        assert stage.commands.given == []
        assert "r1 is not in E-STOP: nothing to clear" in stage.log()
        assert "again" not in stage.log()
        stage.station.stopping_now = "E-STOP not acknowledged"
        await stage.press("D", "D")
        assert stage.commands.given == ["clear-estop"]


async def test_teleop_lasts_until_any_other_key() -> None:
    async with staged() as stage:
        await stage.press("t", "up")
        stage.drive.poll()
        assert stage.commands.steered[-1] == (0.25, 0.0)
        await stage.press("A")
        stage.drive.poll()
        assert stage.commands.steered[-1] == (0.08, 0.5)
        stage.station.clock.advance(700_000_000)
        stage.drive.poll()
        assert stage.commands.steered[-1] == (0.0, 0.0)
        assert stage.commands.teleop
        await stage.press("q")
        assert not stage.commands.teleop


async def test_gamepad_drives_during_teleop_while_its_button_is_held(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = tmp_path / "js0"
    os.mkfifo(device)
    with open(device, "r+b", buffering=0) as pad:
        monkeypatch.setattr("ground.app.input.gamepad.gamepads", lambda: [device])
        async with staged() as stage:
            await stage.press("t")
            assert "the left stick with L1 held" in stage.words("prompt")
            pad.write(EVENT.pack(0, 1, BUTTON, 4) + EVENT.pack(0, -32767, AXIS, ALONG))
            stage.drive.poll()
            assert stage.commands.steered[-1] == (FAST[0], 0.0)
            pad.write(EVENT.pack(0, 0, BUTTON, 4))
            stage.drive.poll()
            assert stage.commands.steered[-1] == (0.0, 0.0)


async def test_teleop_ends_in_another_mode() -> None:
    async with staged() as stage:
        await stage.press("t")
        stage.station.clock.advance(2_000_000_000)
        driving(stage.station)
        stage.drive.poll()
        assert not stage.commands.teleop


async def test_space_stops_the_robot_during_teleop() -> None:
    async with staged() as stage:
        await stage.press("t", "up", "space")
        assert stage.station.stops == 1


@each("opening", ["colon", "m", "e"])
async def test_escape_and_a_quick_space_stop_the_robot(opening: str) -> None:
    """A terminal sends both in one piece, as the bytes of alt and space."""
    async with staged() as stage:
        await stage.press(opening)
        for event in InputParser().feed("\x1b ", 0.0):
            stage.app.post_message(event)
            await stage.redraw()
        assert stage.station.stops == 1
        assert stage.commands.given == []


def test_one_press_lasts_until_a_keyboard_repeats() -> None:
    keys = DeadManSwitch()
    keys.press("forward", 0)
    assert keys.twist(FIRST_NS - 1) == (FAST[0], 0.0)
    assert keys.twist(FIRST_NS) == (0.0, 0.0)


def test_repeated_presses_hold_the_speed() -> None:
    keys = DeadManSwitch()
    keys.press("forward", 0)
    for at_ms in range(500, 2000, 33):
        keys.press("forward", at_ms * MS)
    last_ns = 1985 * MS
    assert keys.twist(last_ns + AGAIN_NS - 20 * MS).speed_m_s == FAST[0]
    assert keys.twist(last_ns + AGAIN_NS).speed_m_s == 0.0


def test_opposite_key_reverses_at_once() -> None:
    keys = DeadManSwitch()
    keys.press("left", 0)
    keys.press("right", 10 * MS)
    assert keys.twist(11 * MS).yaw_rate_rad_s == -FAST[1]


def test_speed_and_yaw_rate_are_held_separately() -> None:
    keys = DeadManSwitch()
    keys.press("forward", 0)
    keys.press("left", 300 * MS, slow=True)
    assert keys.twist(400 * MS) == SLOW
    assert keys.twist(700 * MS) == (0.0, SLOW[1])


@given(st.lists(st.tuples(st.sampled_from(["forward", "back", "left", "right"]), st.booleans())))
def test_robot_stops_after_any_presses(
    presses: list[tuple[str, bool]],
) -> None:
    keys = DeadManSwitch()
    now_ns = 0
    for way, slow in presses:
        keys.press(way, now_ns, slow=slow)
        now_ns += 40 * MS
    assert keys.twist(now_ns + FIRST_NS) == (0.0, 0.0)


@each(("cell_m", "step_m"), [(0.0, 0.001), (0.03, 0.05), (0.05, 0.05), (0.11, 0.2), (7.0, 10.0)])
def test_cursor_step_is_round_and_visible(cell_m: float, step_m: float) -> None:
    assert step_of(cell_m) == pytest.approx(step_m)


def test_cursor_moves_on_the_grid_of_its_steps() -> None:
    cursor = Cursor(1.03, 0.98).moved(1, -1, 0.05)
    assert (cursor.x_m, cursor.y_m) == (1.1, 0.95)
    assert cursor.words() == "1.1 0.95"


def test_cursor_heading_starts_at_zero_and_wraps() -> None:
    cursor = Cursor(1.0, 2.0).turned(1)
    assert cursor.words() == "1 2 0"
    assert cursor.turned(-1).words() == "1 2 -15"
    assert cursor.turned(13).heading_deg == pytest.approx(-165.0)


def test_frame_rate_falls_without_focus() -> None:
    pace = FrameRate(10.0)
    drawn = sum(pace.due(k * 50 * MS) for k in range(40))
    assert drawn == 20
    pace.focused = False
    assert sum(pace.due(2 * S + k * 50 * MS) for k in range(40)) == 4
