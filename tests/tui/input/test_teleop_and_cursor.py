"""Test teleop by key repeats, the goal cursor, and the frame rate."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.app.frame_rate import FrameRate
from ground.app.input.map_cursor import Cursor, step_of
from ground.app.input.teleop_keys import AGAIN_NS, FAST, FIRST_NS, SLOW, DeadManSwitch
from tests.support.each import each
from tests.support.tui.fakes import MS, S


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
