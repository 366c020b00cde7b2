"""Test that rows are copied, and that the log is sorted and its lines are chosen."""

import pytest

from ground.app.filtered_log import FilteredLog
from ground.app.screens.log import LogScreen
from ground.station.history.event_log import EventLog, LogLine
from protocol.wire.enums import Severity
from tests.support.tui.fakes import FakeStation, S
from tests.support.tui.pilot import Stage, play, staged
from tests.support.tui.plant_side import FakeStack, on
from tests.support.tui.underway import driving


def with_log() -> FakeStation:
    station = driving(FakeStation())
    for number, severity in enumerate((Severity.INFO, Severity.ERROR, Severity.WARNING)):
        station.clock.advance(S)
        station.note(f"line {number}", severity)
    return station


def test_parameter_is_copied_as_the_command_that_sets_it() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("3", "down", "y")
            assert stage.app.clipboard == "param set guard_stop_m 0.1"
            assert "copied: param set guard_stop_m 0.1" in stage.log()

    play(story)


@pytest.mark.usefixtures("worlds")
@pytest.mark.parametrize(
    ("screen", "text"),
    [("5", "r1  (all frames)"), ("6", "box"), ("7", "hang robot r1  now")],
)
def test_row_of_a_list_is_copied(screen: str, text: str) -> None:
    async def story(stage: Stage) -> None:
        await stage.press("y")
        assert stage.app.clipboard.startswith(text)

    play(lambda: on(screen, FakeStack(), story))


def test_empty_list_copies_nothing() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("3", "slash", "z", "z", "enter", "y")
            assert stage.app.clipboard == ""
            assert "no row to copy" in stage.log()

    play(story)


def test_chosen_line_of_the_log_is_copied() -> None:
    async def story() -> None:
        async with staged(station=with_log()) as stage:
            await stage.press("4", "y")
            assert stage.app.clipboard == "3.0 W ground line 2"
            await stage.press("up", "up", "y")
            assert "line 1" in stage.app.clipboard
            assert "paused" in stage.words("heading")
            await stage.press("f")
            assert "following" in stage.words("heading")

    play(story)


def test_line_of_the_log_is_chosen_by_a_click() -> None:
    async def story() -> None:
        async with staged(station=with_log()) as stage:
            await stage.press("4")
            await stage.pilot.click("#lines", offset=(20, 1))
            await stage.press("y")
            assert stage.app.clipboard == "2.0 E ground line 1"

    play(story)


def test_log_is_sorted_by_level() -> None:
    async def story() -> None:
        async with staged(station=with_log()) as stage:
            await stage.press("4", "o", "o")
            assert isinstance(stage.app.screen, LogScreen)
            assert [one.text for one in stage.app.screen.filtered.lines] == [
                "line 1",
                "line 2",
                "line 0",
            ]
            stage.station.note("line 3", Severity.CRITICAL)
            await stage.redraw()
            assert stage.app.screen.filtered.lines[0].text == "line 3"
            await stage.press("o", "o", "o")
            assert stage.app.screen.filtered.lines[0].text == "line 0"

    play(story)


def test_sorted_log_stays_bounded() -> None:
    log, filtered = EventLog(5), FilteredLog()
    filtered.heads.sort_by(2)
    for number in range(40):
        log.add(LogLine(number, Severity.INFO, f"r{number % 3}", f"line {number}"))
        filtered.update(log, Severity.DEBUG, 80)
    assert len(filtered.lines) == len(filtered.parts) == 5
    assert {one.text for one in filtered.lines} == {f"line {number}" for number in range(35, 40)}
    assert [one.source for one in filtered.lines] == sorted(one.source for one in filtered.lines)
