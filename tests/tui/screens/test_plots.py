"""Test the Plots screen: chosen fields, pause, cursor and time axis."""

from ground.app.screens.plots import PlotsScreen, TimeSpan, axis_row
from ground.app.widgets.rows import words_of
from ground.station.history.time_series import MessageSeries, numeric_fields
from protocol.topics import ODOMETRY, SONAR, STATUS
from tests.support.tui.fakes import FakeStation, S
from tests.support.tui.pilot import Stage, play, staged
from tests.support.tui.underway import drive_messages, driving

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


def test_cursor_shows_the_values_under_it_and_pauses() -> None:
    async def story() -> None:
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

    play(story)


def test_pause_keeps_the_picture() -> None:
    async def story() -> None:
        async with staged(station=after_drive()) as stage:
            await stage.press("2", "p")
            before = stage.words("plot-0")
            stage.station.clock.advance(30 * S)
            stage.station.history["speed"].add(40.0, 77.0)
            await stage.redraw()
            assert stage.words("plot-0") == before
            await stage.press("p")
            assert "77.00 m/s" in title(stage, 0)

    play(story)


def test_click_places_the_cursor() -> None:
    async def story() -> None:
        async with staged(station=after_drive()) as stage:
            await stage.press("2", "+", "+")
            await stage.pilot.click("#plot-0", offset=(8, 1))
            await stage.redraw()
            assert "values at -15.0 s" in stage.words("heading")

    play(story)


def test_field_of_a_message_is_plotted_and_remembered() -> None:
    async def story() -> None:
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

    play(story)


def test_seventh_plot_replaces_the_last() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("2", "slash", "slash")
            await stage.type("odometry y_m")
            await stage.press("enter")
            assert "tlm/odometry y_m replaces late: 6 plots at most" in stage.log()
            assert title(stage, 5).split()[1] == "y_m"

    play(story)


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


def test_keys_are_known_before_the_screen_has_its_widgets() -> None:
    async def story() -> None:
        async with staged(station=after_drive()) as stage:
            shown = stage.app.base_screen
            assert shown
            screen = PlotsScreen(shown.interface)
            assert not screen.typing
            assert screen.key_layers()

    play(story)
