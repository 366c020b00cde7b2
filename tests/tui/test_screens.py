"""The screens Params, Plots, Links, Worlds and Faults by keys."""

from pathlib import Path

import pytest
from textual.app import ScreenStackError

from ground.app.app import GroundApp, screen_of
from ground.app.screens import SCREENS
from ground.app.screens.faults import FaultsScreen, InjectableFault, fault_of
from ground.app.screens.plots import PlotsScreen, TimeSpan, axis_row
from ground.app.screens.worlds import (
    WorldsScreen,
    change_world,
    looked_up,
    query_worlds,
    reached_count,
    read_reached_counts,
)
from ground.app.widgets.map import MapWidget
from ground.app.widgets.rows import words_of
from ground.client.parameter import Parameter
from ground.map.scene import MapTarget
from ground.station.history.time_series import MessageSeries, numeric_fields
from plant.world.file import load
from protocol.topics import ODOMETRY, SONAR, STATUS
from runtime.errors import UserError
from runtime.units import NS_PER_S as S
from tests.support.app import (
    FakeCommandSink,
    FakeStack,
    FakeStation,
    Stage,
    drive_messages,
    driving,
    on,
    parameter,
    staged,
)
from tests.support.each import each


def parameters() -> tuple[Parameter, ...]:
    return (
        parameter("d_obs_m", 0.3, 0.4, "avoidance zone"),
        parameter("radius_m", 0.12, 0.12, "radius of the robot"),
        parameter("track_m", 0.2, 0.2, "distance between the wheels"),
    )


def with_parameters() -> FakeStation:
    station = driving(FakeStation())
    station.parameters_now = parameters()
    return station


async def test_incomplete_parameters_are_not_listed() -> None:
    station = with_parameters()
    async with staged(station=station) as stage:
        await stage.press("3")
        assert "3 parameters, 1 changed" in stage.words("heading")
        assert "d_obs_m          *" in stage.words("rows")
        station.parameters_now = None
        await stage.redraw()
        assert "41 missing: requested 2 times" in stage.words("heading")
        assert stage.words("rows") == ""


async def test_parameter_is_found_changed_and_reset() -> None:
    async with staged(station=with_parameters()) as stage:
        await stage.press("3", "slash")
        await stage.type("wheels")
        await stage.press("enter")
        assert stage.words("rows").split()[0] == "track_m"
        await stage.press("enter")
        assert stage.words("prompt") == "set track_m:"
        await stage.type("0.25")
        await stage.press("enter", "d")
        assert stage.commands.given == ["set track_m 0.25"]
        await stage.press("enter")
        assert stage.commands.given == ["set track_m 0.25", "set track_m 0.2"]
        await stage.press("escape")
        assert "radius_m" in stage.words("rows")


async def test_changed_parameters_are_shown_on_demand() -> None:
    async with staged(station=with_parameters()) as stage:
        await stage.press("3", "f")
        assert stage.words("rows").split()[0] == "d_obs_m"
        assert "radius_m" not in stage.words("rows")
        await stage.press("f", "u")
        assert "radius_m" in stage.words("rows")
        assert stage.station.asked == ["reread"]


async def test_empty_value_changes_no_parameter() -> None:
    async with staged(station=with_parameters()) as stage:
        await stage.press("3", "e", "enter")
        assert stage.commands.given == []


async def test_time_span_of_plots_can_be_changed() -> None:
    async with staged() as stage:
        await stage.press("2")
        assert "the last 60 s" in stage.words("heading")
        await stage.press("+")
        assert "the last 30 s" in stage.words("heading")
        await stage.press("minus", "minus")
        assert "the last 120 s" in stage.words("heading")


@pytest.mark.usefixtures("worlds")
async def test_another_world_starts_with_own_processes() -> None:
    stack = FakeStack()
    async with on("6", stack) as stage:
        assert isinstance(stage.app.screen, WorldsScreen)
        await stage.press("down")
        assert "wall  A wall, and a walker." in stage.words("about")
        assert "6 x 4 m, 2 obstacles, 1 moving" in stage.words("about")
        assert "reached of 10 seeds: bug left 0, vgm 7, vgm_memory 10" in stage.words("about")
        await stage.press("enter")
        assert stack.begun == []
        stage.commands.draft_items = (MapTarget(1.0, 2.0, None),)
        await stage.press("s")
        assert "press s again within 3 s to stop this run and start wall" in stage.log()
        await stage.press("up", "s", "down", "s")
        assert stack.begun == []
        await stage.press("s")
        assert (stack.begun, stack.driven) == (["wall"], ["wall"])
        assert stage.station.begun_again == 1
        assert len(stage.commands.draft_items) == 0
        change_world(stage.app, stack.scenario_of("wall"), "again")
        assert stage.commands.begun == [False, True]


@pytest.mark.usefixtures("worlds")
async def test_world_is_previewed_before_its_start() -> None:
    async with on("6", None) as stage:
        shown = stage.app.screen.query_one("#preview", MapWidget)
        assert shown.scene.size_m == (6.0, 4.0)
        assert shown.scene.robot is not None
        assert (shown.scene.robot.x_m, shown.scene.robot.y_m) == (0.6, 2.0)
        assert shown.scene.goal is not None
        assert (len(shown.scene.obstacles), len(shown.scene.movers)) == (2, 1)
        assert any(strip.text.strip() for strip in map(shown.render_line, range(9)))


def test_preview_matches_the_plant() -> None:
    world, scene = looked_up("corridor")
    assert scene.size_m == world.size_m == load("corridor").size_m
    assert scene.goal is not None
    assert scene.goal.x_m == world.goal.x_m == load("corridor").goal.x_m


def test_study_has_outcomes_of_all_worlds() -> None:
    reached = read_reached_counts()
    assert {one["name"] for one in query_worlds("list")["worlds"]} == set(reached)
    assert {len(ends) for ends in reached.values()} == {7}
    assert all(0 <= count <= 10 for ends in reached.values() for count in ends.values())
    assert 10 in reached["box"].values()


@each(
    ("ends", "count"),
    [("10 reached", 10), ("6 reached, 4 stuck", 6), ("9 stuck, 1 timeout", 0), ("-", 0)],
)
def test_outcomes_at_the_goal_are_counted(ends: str, count: int) -> None:
    assert reached_count(ends) == count


def test_missing_study_gives_no_outcomes(tmp_path: Path) -> None:
    assert read_reached_counts(tmp_path / "outcomes.md") == {}


@pytest.mark.usefixtures("worlds")
async def test_processes_started_elsewhere_are_not_stopped() -> None:
    async with on("6", None) as stage:
        await stage.press("s")
        assert "sidestep up --world box" in stage.log()


@pytest.mark.usefixtures("worlds")
async def test_key_suspends_an_own_process() -> None:
    stack = FakeStack()
    async with on("7", stack) as stage:
        assert isinstance(stage.app.screen, FaultsScreen)
        await stage.press("enter", "s")
        assert stack.done == []
        assert "press s again within 3 s to hang robot r1" in stage.log()
        await stage.press("s")
        assert stack.done == [("robot r1", "hang")]
        await stage.press("s", "down", "s")
        assert stack.done == [("robot r1", "hang")], "each fault needs two presses of its own"


@pytest.mark.usefixtures("worlds")
async def test_fault_restarts_the_world() -> None:
    stack = FakeStack()
    async with on("7", stack) as stage:
        await stage.press("end", "up")
        assert "restarts the world with the fault" in stage.words("about")
        await stage.press("s")
        assert stage.words("prompt").startswith("sonar_frozen")
        await stage.press("backspace")
        await stage.type("9")
        await stage.press("enter")
        assert "unknown target '9'; known: 0, 1, all" in stage.log()
        await stage.press("s", "enter")
        assert stack.begun == ["box sonar_frozen"]


@each(
    ("words", "value", "start_s"), [("0", 0.0, 3.0), ("all 0.5", 0.5, 3.0), ("1 0.5 9", 0.5, 9.0)]
)
def test_fault_has_target_value_and_start_time(words: str, value: float, start_s: float) -> None:
    one = InjectableFault("sonar_dropout", "", kind="sonar_dropout", targets=("0", "1", "all"))
    found = fault_of(one, words.split())
    assert (found["target"], found["value"], found["start_s"]) == (words.split()[0], value, start_s)


@each("words", ["", "x", "0 y", "0 1 2 3"])
def test_malformed_fault_is_refused(words: str) -> None:
    one = InjectableFault("sonar_dropout", "", kind="sonar_dropout", targets=("0", "1"))
    with pytest.raises(UserError):
        fault_of(one, words.split())


def test_clearing_the_selection_needs_no_screen() -> None:
    app = GroundApp(FakeStation(), FakeCommandSink())
    with pytest.raises(ScreenStackError):
        _ = app.screen
    app.clear_selection()  # Textual calls this before there is a screen (Python >= 3.12)


@pytest.mark.parametrize("name", SCREENS)
async def test_keys_act_before_a_screen_has_its_widgets(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with staged() as stage:
        shown = stage.app.base_screen
        assert shown is not None
        coming = screen_of(name, stage.app)
        monkeypatch.setattr(type(stage.app), "base_screen", coming)
        assert coming.key_layers()
        assert "estop" in stage.app.doable()
        monkeypatch.undo()


async def test_key_bar_of_the_log_names_filter_follow_and_sort() -> None:
    async with staged((80, 24)) as stage:
        await stage.press("4")
        assert "/ Filter  f Follow: on  o Sort: off" in stage.words("keybar")
        await stage.press("f", "o")
        assert "/ Filter  f Follow: off  o Sort: time▼" in stage.words("keybar")


FIELD = f"{ODOMETRY.path} x_m"


def after_drive() -> FakeStation:
    """Return a station whose speed was its time for ten seconds."""
    station = FakeStation()
    for tick in range(100):
        station.history["speed"].add(tick * 0.1, tick * 0.1)
    station.clock.advance(10 * S)
    return driving(station)


def title(stage: Stage, place: int) -> str:
    return stage.words(f"plot-{place}").splitlines()[0]


async def test_cursor_shows_the_values_under_it_and_pauses() -> None:
    async with staged(station=after_drive()) as stage:
        await stage.press("2", "shift+left")
        at_s = 10.0 - 10.0
        assert f"{at_s:.2f} m/s" in title(stage, 0)
        await stage.press("right", "right", "right")
        assert "3.00 m/s" in title(stage, 0)
        assert "values at -7.0 s" in stage.words("heading")
        stage.station.clock.advance(60 * S)
        await stage.redraw()
        assert "3.00 m/s" in title(stage, 0)
        assert "paused" in stage.words("heading")
        await stage.press("escape")
        assert "paused" not in stage.words("heading")
        assert "-- m/s" in title(stage, 0)


async def test_pause_keeps_the_picture() -> None:
    async with staged(station=after_drive()) as stage:
        await stage.press("2", "p")
        before = stage.words("plot-0")
        stage.station.clock.advance(30 * S)
        stage.station.history["speed"].add(40.0, 77.0)
        await stage.redraw()
        assert stage.words("plot-0") == before
        await stage.press("p")
        assert "77.00 m/s" in title(stage, 0)


async def test_click_places_the_cursor() -> None:
    async with staged(station=after_drive()) as stage:
        await stage.press("2", "+", "+")
        await stage.pilot.click("#plot-0", offset=(8, 1))
        await stage.redraw()
        assert "values at -15.0 s" in stage.words("heading")


async def test_field_of_a_message_is_plotted_and_remembered() -> None:
    station = after_drive()
    async with staged(station=station) as stage:
        await stage.press("2", "e", "down", "down", "enter")
        assert not stage.app.screen.query_one("#plot-5").display
        await stage.press("e", "slash")
        await stage.type("odometry x_m")
        await stage.press("enter")
        assert title(stage, 5).split()[:2] == ["tlm/odometry", "x_m"]
        station.fields.poll(station.now_ns)
        station.clock.advance(S // 2)
        await stage.press("1", "2")
        assert "4.12 m" in title(stage, 5)


async def test_seventh_plot_replaces_the_last() -> None:
    async with staged() as stage:
        await stage.press("2", "slash", "slash")
        await stage.type("odometry y_m")
        await stage.press("enter")
        assert "tlm/odometry y_m replaces late: 6 plots at most" in stage.log()
        assert title(stage, 5).split()[1] == "y_m"


def test_fields_have_units_and_values() -> None:
    fields, messages = numeric_fields(), drive_messages(0)
    assert fields[FIELD].unit == "m"
    assert fields[FIELD].value_in(messages[ODOMETRY]) == 4.12
    assert fields[f"{ODOMETRY.path} yaw_rate_rad_s"].unit == "rad/s"
    assert fields[f"{SONAR.path} range_mm[6]"].value_in(messages[SONAR]) == 230.0
    assert fields[f"{STATUS.path} mode"].unit == ""
    assert fields[FIELD].value_in(messages[SONAR]) != fields[FIELD].value_in(messages[SONAR])


def test_fields_that_are_not_watched_are_dropped() -> None:
    station = driving(FakeStation())
    kept = MessageSeries(station.telemetry, 0)
    kept.watch([FIELD, "no such field"])
    kept.poll(station.now_ns)
    kept.poll(station.now_ns)
    assert list(kept.series) == [FIELD]
    assert len(kept.series[FIELD].points()) == 1
    kept.watch([])
    assert kept.series == {}


def test_time_axis_has_seconds_in_every_width() -> None:
    span = TimeSpan(60.0, 100.0)
    for width in (10, 20, 80, 160):
        for columns in (1, 2):
            assert len(words_of(axis_row(span, width, columns))) <= max(width, 18)
    words = words_of(axis_row(span, 80, 1))
    assert (words.split(), len(words)) == (["-60", "s", "-30", "s", "0", "s"], 80)


async def test_keys_are_known_before_the_screen_has_its_widgets() -> None:
    async with staged(station=after_drive()) as stage:
        shown = stage.app.base_screen
        assert shown
        screen = PlotsScreen(shown.interface)
        assert not screen.typing
        assert screen.key_layers()
