"""Test the rows of the panels for values that are live, late or missing."""

from math import inf, nan

import pytest

from ground.app.panels.mission import mission_rows
from ground.app.panels.robot_state import side_rows, whole
from ground.app.panels.status import SessionInfo, status_row
from ground.app.widgets.bars import bar, binned, spark
from ground.app.widgets.rows import cut, in_ascii, row, width_of, words_of
from ground.app.widgets.sparklines import SPARKLINES, figure_rows
from ground.map.scene import MapTarget
from protocol.topics import MISSION
from protocol.wire.enums import MissionState
from protocol.wire.messages import MissionStatus
from tests.support.tui.fakes import MS, FakeStation
from tests.support.tui.underway import driving


def side(station: FakeStation, height: int = 16) -> str:
    return "\n".join(map(words_of, side_rows(station, height, 30)))


def test_late_value_fades_and_then_shows_its_age() -> None:
    station = driving(FakeStation())
    roles = []
    for _ in range(3):
        pose = side_rows(station, 16, 30)[0][1]
        roles.append((pose.role, pose.text.startswith("--")))
        station.clock.advance(130 * MS)
    assert roles == [("text", False), ("faint", False), ("faint", True)]


def test_missing_values_are_not_zero() -> None:
    text = side(FakeStation())
    assert "0.0" not in text
    assert text.count("--") >= 5


def test_missing_sonar_differs_from_no_echo() -> None:
    text = side(driving(FakeStation()))
    assert "R56 ·············   --" in text
    assert "R79 █████████████  none" in text


def test_sonars_are_side_by_side_in_a_low_panel() -> None:
    rows = side_rows(driving(FakeStation()), 7, 38)
    assert len(rows) <= 7
    assert "0.08 !!" in words_of(rows[4])
    assert all(width_of(one) <= 38 for one in rows)


@pytest.mark.parametrize("width", [0, 1, 2, 10, 40, 60, 80, 200])
def test_status_line_drops_the_least_important_parts(width: int) -> None:
    shown = status_row(driving(FakeStation()), SessionInfo(kind="SIM 1.0x"), width)
    assert width_of(shown) <= width
    if width >= 80:
        assert "SIM 1.0x" in words_of(shown)


def test_slow_simulation_is_shown_on_80_columns() -> None:
    session = SessionInfo(kind="SIM 0.8x", hint="computer busy")
    shown = status_row(driving(FakeStation()), session, 80)
    assert "SIM 0.8x, computer busy" in words_of(shown)
    assert width_of(shown) <= 80


@pytest.mark.parametrize(
    ("share", "text"),
    [(0.0, "····"), (0.5, "██··"), (1.0, "████"), (9.0, "████"), (-1.0, "····"), (0.125, "▌···")],
)
def test_bar_is_exact_to_an_eighth_of_a_cell(share: float, text: str) -> None:
    assert bar(share, 4) == text


@pytest.mark.parametrize("share", [nan, inf, -inf])
def test_bar_of_an_infinite_or_nan_share_is_empty(share: float) -> None:
    assert bar(share, 4) == "····"


def test_sparkline_keeps_gaps_and_is_right_aligned() -> None:
    assert spark([0.0, nan, 7.0], 5) == "  ▁ █"
    assert spark([], 3) == "   "
    assert spark([2.0, 2.0], 2) == "▁▁"


def test_values_stay_in_their_bin_while_time_passes() -> None:
    points = [(1.0, 1.0), (2.0, 2.0)]
    assert binned(points, 4, 3.9, 4.0)[1:3] == [1.0, 2.0]
    assert binned(points, 4, 4.0, 4.0)[0:2] == [1.0, 2.0]


def test_peak_bins_keep_the_greatest_value() -> None:
    points = [(0.2, 3.0), (0.4, 9.0), (0.6, 5.0), (1.5, 4.0)]
    assert binned(points, 2, 1.9, 2.0, peak=True) == [9.0, 4.0]
    assert binned(points, 2, 1.9, 2.0) == [5.0, 4.0]


def test_peak_figure_is_stable_between_cycles() -> None:
    station = driving(FakeStation())
    spent_us = (300.0, 412.0, 280.0, 350.0, 411.0)
    cost = next(figure for figure in SPARKLINES if figure.series == "cycle_us")
    shown = []
    for tick, us in enumerate(spent_us):
        station.history["cycle_us"].add(station.time_s + 0.05 * tick, us)
        shown.append([words_of(one) for one in figure_rows(station, cost, 32)])
    assert "cycle≤  412 us" in shown[1][0]
    assert [rows[0].split("us")[0] for rows in shown[1:]] == [shown[1][0].split("us")[0]] * 4


def test_cut_row_ends_with_an_ellipsis() -> None:
    assert words_of(cut(row("abcdef"), 4)) == "abc…"
    assert words_of(cut(row("abc"), 3)) == "abc"
    assert cut(row("abc"), 0) == ()


def test_all_panel_characters_have_an_ascii_form() -> None:
    text = in_ascii(side(driving(FakeStation())))
    assert text.isascii()
    assert "?" not in text


def test_mission_is_listed_around_the_current_item() -> None:
    station = driving(FakeStation())
    assert mission_rows(station) == []
    station.items_now = tuple(MapTarget(float(k), 1.0, None if k else 0.0) for k in range(12))
    running = MissionStatus(
        time_ns=station.now_ns, mission_id=1, hold_left_ms=2000, count=12, current=7,
        state=MissionState.RUNNING, reason=0,
    )  # fmt: skip
    station.air.put(MISSION, running, station.now_ns)
    words = [words_of(one) for one in mission_rows(station)]
    assert "RUNNING 8/12, holds 2 s" in words[0]
    assert words[1].split()[0] == "7"
    assert words[2].startswith("▶  8")
    assert len(words) == 7


def test_minus_zero_degrees_are_zero() -> None:
    assert f"{whole(-0.2):.0f}" == "0"
    assert f"{whole(-0.6):.0f}" == "-1"
