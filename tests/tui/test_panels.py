"""Panels: rows of live, late and missing values, stopped robots, and the last turn."""

from math import inf, nan

from msgspec.structs import replace

from checks.harness.messages import make
from ground.app.panels.aged import number
from ground.app.panels.robot_state import (
    FORMS,
    SidePanel,
    dead_sonars,
    form_for,
    mission_rows,
    progress_rows,
    sonar_rows,
)
from ground.app.panels.status import SessionInfo, status_row
from ground.app.screens.links import process_rows
from ground.app.widgets.bars import SPARKLINES, bar, binned, figure_row, spark
from ground.app.widgets.rows import Row, Span, cut, in_ascii, row, width_of, words_of
from ground.client.goal import Destination
from ground.client.status_line import goal_line, metres
from ground.map.scene import MapTarget
from ground.station.history.goal_progress import GoalProgress
from protocol.topics import DECISION, MCU, MISSION, ODOMETRY, STATUS, TRUTH
from protocol.wire.enums import Branch, GoalState, MissionState, Mode, Vehicle
from protocol.wire.messages import MissionStatus, NavigatorStatus, PlanarOdometry
from protocol.wire.reasons import Reason, reason_text
from runtime.units import NS_PER_MS as MS
from runtime.units import NS_PER_S as S
from tests.support.app import (
    FakeStation,
    drive_messages,
    driving,
    mcu_status,
    parameter,
    staged,
    status,
)
from tests.support.each import each
from tests.support.ground.recordings import decided


def shown(**changes: int) -> FakeStation:
    station = driving(FakeStation())
    now_ns = station.clock.now_ns()
    message: NavigatorStatus = replace(status(now_ns), **changes)
    station.bus.say(STATUS, message)
    return station


def rows_of_stopped(station: FakeStation) -> list[Row]:
    return SidePanel().rows(station, 16, 60)


def role_of(rows: list[Row], words: str) -> str:
    return next(span.role for one in rows for span in one if span.text.strip() == words)


@each(
    ("vehicle", "name", "short", "role"),
    [
        (Vehicle.EMERGENCY_STOP, "EMERGENCY STOP", "E-STOP", "danger"),
        (Vehicle.FAILSAFE, "FAILSAFE", "FAILSAFE", "caution"),
    ],
)
@each("goal", [GoalState.NONE, GoalState.REACHED, GoalState.ABORTED])
def test_stopped_robot_has_the_colour_of_its_vehicle_state(
    vehicle: Vehicle, name: str, short: str, role: str, goal: GoalState
) -> None:
    station = shown(vehicle=vehicle, goal=goal)
    assert role_of(rows_of_stopped(station), name) == role
    status_line = [status_row(station, SessionInfo(), 120)]
    assert role_of(status_line, short) == role
    assert role_of(status_line, "▲") == role


@each(
    ("vehicle", "mark", "role"),
    [
        (Vehicle.EMERGENCY_STOP, "▲", "danger"),
        (Vehicle.FAILSAFE, "▲", "caution"),
        (Vehicle.ACTIVE, "●", "ok"),
        (Vehicle.STANDBY, "●", "ok"),
    ],
)
def test_mark_of_a_stopped_robot_is_no_mark_of_health(
    vehicle: Vehicle, mark: str, role: str
) -> None:
    station = shown(vehicle=vehicle)
    assert status_row(station, SessionInfo(), 120)[0] == Span(mark, role)
    assert role_of(process_rows(station), "● present") == role
    station.stopping_now = "E-STOP not acknowledged"
    assert status_row(station, SessionInfo(), 120)[0] == Span("▲", "danger")


@each("mode", [Mode.AUTO, Mode.HOLD, Mode.MANUAL])
def test_reason_of_the_last_stop_disappears_when_armed_again(mode: Mode) -> None:
    station = shown(
        vehicle=Vehicle.ACTIVE, mode=mode, goal=GoalState.ABORTED, goal_reason=Reason.BUDGET
    )
    assert reason_text(Reason.BUDGET) not in " ".join(map(words_of, rows_of_stopped(station)))


def test_reason_is_shown_while_the_robot_is_stopped() -> None:
    station = shown(vehicle=Vehicle.FAILSAFE, vehicle_reason=Reason.BUDGET)
    text = " ".join(map(words_of, rows_of_stopped(station)))
    assert "control loop too slow (computer busy)" in text


def side_rows(station: FakeStation, height: int = 16, width: int = 33) -> list[Row]:
    return SidePanel().rows(station, height, width, recording="REC")


def side(station: FakeStation, height: int = 16) -> str:
    return "\n".join(map(words_of, side_rows(station, height)))


def test_late_value_fades_and_then_shows_its_age() -> None:
    station = driving(FakeStation())
    roles = []
    for _ in range(3):
        pose = next(one for one in side_rows(station) if one and one[0].text == "pose ")[1]
        roles.append((pose.role, pose.text.startswith("--")))
        station.clock.advance(130 * MS)
    assert roles == [("text", False), ("faint", False), ("faint", True)]


def test_missing_values_are_not_zero() -> None:
    text = side(FakeStation())
    assert "0.0" not in text
    assert text.count("--") >= 5


def test_board_is_shown_with_time_and_memory_only_if_there_is_one() -> None:
    station = driving(FakeStation())
    assert "MCU" not in side(station)
    station.bus.say(MCU, mcu_status())
    assert "MCU (emulated) 6.0 ms  52.2 kB" in side(station)
    station.clock.advance(3_000 * MS)
    assert "MCU (emulated) -- 3.0 s" in side(station)


def test_dead_sonar_has_its_own_colour_and_differs_from_no_echo() -> None:
    station = driving(FakeStation())
    names, *_, ranges = sonar_rows(station, 33, 1)
    assert words_of(names).split() == ["L79", "L56", "L34", "L11", "│R11", "R34", "R56", "R79"]
    assert words_of(ranges).split("│")[1].split() == ["2.1", "2.0", "dead", ">3"]
    assert [span.role for span in ranges if "dead" in span.text] == ["dead"]
    assert dead_sonars(station) == ["R56"]
    assert "▲ senses" in side(station)


def test_ranges_are_shown_against_those_of_the_robot_itself() -> None:
    station = driving(FakeStation())
    station.parameters_now = (parameter("sonar_max_m", 3.0, 5.0, ""),)
    _, title, *_, ranges = map(words_of, sonar_rows(station, 60, 2))
    assert "5 m" in title
    assert ">5" in ranges
    assert "!!" not in ranges


def test_unknown_range_of_the_robot_is_not_that_of_another_one() -> None:
    station = driving(FakeStation())
    station.parameters_now = None
    rows = [words_of(one) for one in sonar_rows(station, 60, 2)]
    assert "--" in rows[1]
    assert ">" not in rows[-1]
    assert "none" in rows[-1]
    assert not set("▁▂▃▄▅▆▇█") & set("".join(rows))


def test_sonars_in_the_zone_and_at_the_guard_are_marked() -> None:
    for bars in (0, 1, 3):
        rows = sonar_rows(driving(FakeStation()), 60, bars)
        text = "\n".join(map(words_of, rows))
        assert len(rows) == bars + 2
        assert text.count("!") == 3
        assert all(width_of(one) <= 60 for one in rows)


@each("height", [1, 3, 7, 12, 16, 20, 30, 60])
@each("width", [20, 33, 46, 90])
def test_side_panel_fits_and_begins_with_the_sentence(height: int, width: int) -> None:
    rows = side_rows(driving(FakeStation()), height, width)
    assert len(rows) <= height
    assert all(width_of(one) <= width for one in rows)
    assert words_of(rows[0]).startswith("AVOIDING")
    if height >= 12 and width >= 33:
        text = "\n".join(map(words_of, rows))
        for words in ("to go", "27 %", "goal ", "pose ", "L79", "dead", "loop", "rec"):
            assert words in text


def test_side_forms_shrink_and_the_first_fitting_one_is_taken() -> None:
    heights = [form.rows(3, 0) for form in FORMS]
    assert heights == sorted(heights, reverse=True)
    for form in FORMS:
        assert form_for(form.rows(3, 0), 3, 0).rows(3, 0) == form.rows(3, 0)


def test_progress_shows_times_and_never_invents_them() -> None:
    station = driving(FakeStation())
    assert "6.42 m   8.9 s  ~24 s left" in side(station)
    assert "8.9 s so far  ~24 s left" in words_of(progress_rows(station, 60)[0])
    station.progress_now = GoalProgress()
    text = side(station)
    assert "-- s left" in text
    assert "-- %" in text


@each(
    ("reason", "words"),
    [
        (Reason.UNREACHABLE, "unreachable after 8.9 s"),
        (Reason.LOST, "lost after 8.9 s, position doubt 0."),
        (Reason.BLOCKED, "stuck after 8.9 s"),
    ],
)
def test_progress_names_the_end_of_a_goal(reason: Reason, words: str) -> None:
    station = driving(FakeStation())
    ended = replace(status(station.now_ns), goal=GoalState.STUCK, goal_reason=reason)
    station.bus.say(STATUS, ended)
    text = words_of(progress_rows(station, 60)[0])
    assert words in text
    assert ("doubt" in text) == (reason == Reason.LOST)


def test_true_error_is_shown_in_a_simulation_only() -> None:
    station = driving(FakeStation())
    assert "±45 mm" in side(station)
    assert "true error 50 mm" in side(station)
    station.clock.advance(200 * MS)
    for topic, message in drive_messages(station.now_ns).items():
        if topic is not TRUTH:
            station.bus.say(topic, message)
    assert "true error" in side(station)
    station.clock.advance(1000 * MS)
    for topic, message in drive_messages(station.now_ns).items():
        if topic is not TRUTH:
            station.bus.say(topic, message)
    assert "true error" not in side(station)


def test_sentence_is_kept_for_half_a_second_unless_the_state_changes() -> None:
    station, panel = driving(FakeStation()), SidePanel()
    texts = []
    for yaw in (0.1, 0.2, 0.3):
        decision = drive_messages(station.now_ns)[DECISION]
        station.bus.say(DECISION, replace(decision, yaw_rate_rad_s=yaw))
        texts.append("\n".join(map(words_of, panel.rows(station, 16, 60)[:2])))
        station.clock.advance(100 * MS)
    assert texts[0] == texts[1] == texts[2]
    station.bus.say(STATUS, status(station.now_ns, vehicle=Vehicle.FAILSAFE))
    assert words_of(panel.rows(station, 16, 60)[0]).startswith("FAILSAFE")


def test_fields_of_the_status_line_have_a_fixed_width() -> None:
    def shown(trip_ms: float, percent: float) -> str:
        station = driving(FakeStation())
        station.round_trip_ms_now, station.link_percent_now = trip_ms, percent
        return words_of(status_row(station, SessionInfo(kind="SIM 1.0x"), 80))

    for other in (shown(42.0, 100.0), shown(142.0, 99.0), shown(8.0, 9.0)):
        assert len(other) == len(shown(8.0, 100.0))
        assert other.index("SIM") == shown(8.0, 100.0).index("SIM")


@each("width", [0, 1, 2, 10, 40, 60, 80, 200])
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


@each(
    ("share", "text"),
    [(0.0, "····"), (0.5, "██··"), (1.0, "████"), (9.0, "████"), (-1.0, "····"), (0.125, "▌···")],
)
def test_bar_is_exact_to_an_eighth_of_a_cell(share: float, text: str) -> None:
    assert bar(share, 4) == text


@each("share", [nan, inf, -inf])
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
        shown.append(words_of(figure_row(station, cost, 40)))
    assert shown[1].startswith("loop  0.41 ms")
    assert shown[1].endswith("0.41..0.41")
    assert [text.split("ms")[0] for text in shown[1:]] == [shown[1].split("ms")[0]] * 4


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
    station.mission_items_now = tuple(
        MapTarget(float(k), 1.0, None if k else 0.0) for k in range(12)
    )
    running = MissionStatus(
        time_ns=station.now_ns, mission_id=1, hold_left_ms=2000, count=12, current=7,
        state=MissionState.RUNNING, reason=0,
    )  # fmt: skip
    station.bus.say(MISSION, running)
    words = [words_of(one) for one in mission_rows(station)]
    assert "RUNNING 8/12, holds 2 s" in words[0]
    assert words[1].split()[0] == "7"
    assert words[2].startswith("▶  8")
    assert len(words) == 7


@each(
    ("reason", "words"),
    [
        (Reason.BY_OPERATOR, "aborted 1/2: by the operator"),
        (Reason.BY_HAND, "taken over 1/2: driven by hand"),
        (Reason.REPLACED, "taken over 1/2: replaced by a new goal"),
        (Reason.DISARMED, "aborted 1/2: disarmed by the operator"),
        (Reason.BY_EMERGENCY_STOP, "aborted 1/2: by the emergency stop"),
        (Reason.BUMPER, "FAILED 1/2: bumper contact"),
    ],
)
def test_mission_that_an_operator_ended_has_not_failed(reason: Reason, words: str) -> None:
    station = driving(FakeStation())
    ended = make(
        MissionStatus, time_ns=station.now_ns, mission_id=1, count=2, state=MissionState.FAILED,
        reason=reason,
    )  # fmt: skip
    station.bus.say(MISSION, ended)
    assert words in words_of(mission_rows(station)[0])


def test_rounded_zero_has_no_minus() -> None:
    assert number(-0.2, ".0f") == "0"
    assert number(-0.6, ".0f") == "-1"
    assert number(-0.001) == "0.00"
    assert number(-0.001, "6.2f") == "  0.00"
    assert metres(-0.001) == "0.00 m"
    assert (
        str(Destination(x_m=-0.0, y_m=-0.0001, heading_rad=-0.0001)) == "(0.000, 0.000) at 0.0 deg"
    )


def test_backward_speed_below_a_centimetre_is_zero_in_every_line() -> None:
    station = driving(FakeStation())
    odometry = drive_messages(station.now_ns)[ODOMETRY]
    assert isinstance(odometry, PlanarOdometry)
    back = replace(odometry, speed_m_s=-0.001, y_m=-0.001)
    station.bus.say(ODOMETRY, back)
    assert " 0.00 " in side(station)
    assert "-0.00" not in side(station)
    line = goal_line(station.telemetry, station.now_ns, 0)
    assert "0.00 m/s" in [part.text for part in line]


TURNS = (Branch.TO_GOAL, Branch.PASS_RIGHT, Branch.PASS_LEFT)


def turned(ago_ns: int = 2 * S) -> FakeStation:
    """Return a station whose robot passed on the right, and `ago_ns` before now on the left."""
    station = driving(FakeStation())
    last_ns = station.now_ns - ago_ns
    station.decided = [
        (last_ns + (tick - 2) * 50 * MS, decided(time_ns=tick * 50 * MS, branch=branch))
        for tick, branch in enumerate(TURNS)
    ]
    return station


async def test_key_explains_the_last_turn_and_closes_again() -> None:
    async with staged((110, 30), station=turned()) as stage:
        await stage.press("e")
        text = stage.words("why-below")
        assert "2.0 s ago: changes the side: passes on the right" in text
        assert "so it passes on the left" in " ".join(text.split())
        await stage.press("e")
        assert not stage.app.screen.has_class("-explaining")


async def test_other_key_explains_earlier_turns() -> None:
    async with staged((110, 30), station=turned()) as stage:
        for _ in range(4):
            await stage.press("E")
        assert "goes for the goal -> passes on the right" in stage.words("why-below")


async def test_robot_without_turns_has_no_explanation() -> None:
    async with staged((110, 30)) as stage:
        await stage.press("e")
        assert "the robot has not turned yet" in stage.words("why-below")


async def test_turns_are_collected_on_other_screens() -> None:
    station = turned()
    async with staged((110, 30), station=station) as stage:
        await stage.press("4")
        station.decided.append(
            (station.now_ns - S, decided(time_ns=150 * MS, branch=Branch.TO_GOAL))
        )
        station.decided.append(
            (station.now_ns - S + 50 * MS, decided(time_ns=200 * MS, branch=Branch.TO_GOAL))
        )
        await stage.press("1", "e")
        turn = "1.0 s ago: passes on the left -> goes for the goal"
        await stage.until_shown("why-below", turn)
