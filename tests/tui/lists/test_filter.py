"""Test the filter of every list: live, remembered, and without commands by single keys."""

import pytest

from ground.app.screens.log import LogScreen
from protocol.wire.enums import Severity
from tests.support.tui.fakes import FakeStation
from tests.support.tui.pilot import Stage, play, staged
from tests.support.tui.plant_side import FakeStack, on
from tests.support.tui.underway import driving, parameter

LISTS = ("3", "4", "5", "6", "7")
ROBOT_KEYS = "hrxaAmvbRLdtWiz"


def with_parameters() -> FakeStation:
    station = driving(FakeStation())
    names = ("d_obs_m", "d_min_m", "radius_m", "side", "track_m")
    station.parameters_now = tuple(parameter(name, 0.3, 0.3, f"about {name}") for name in names)
    return station


def test_filter_narrows_at_each_letter() -> None:
    async def story() -> None:
        async with staged(station=with_parameters()) as stage:
            await stage.press("3", "slash", "d")
            assert "4 of 5" in stage.words("heading")
            await stage.press("_")
            assert "2 of 5" in stage.words("heading")
            assert [line.split()[0] for line in stage.words("rows").splitlines()] == [
                "d_obs_m",
                "d_min_m",
            ]
            await stage.press("escape")
            assert len(stage.words("rows").splitlines()) == 5
            assert " of " not in stage.words("heading")

    play(story)


@pytest.mark.usefixtures("worlds")
@pytest.mark.sweep(3)
@pytest.mark.parametrize("screen", LISTS)
def test_typing_a_filter_sends_no_command(screen: str) -> None:
    async def story(stage: Stage) -> None:
        await stage.press("slash")
        await stage.type(ROBOT_KEYS)
        assert stage.app.screen.is_modal is False
        assert stage.words("prompt") == "filter:"
        await stage.press("enter")
        assert stage.commands.given == []
        assert stage.station.asked == []
        assert stage.app.screen.is_modal is False

    play(lambda: on(screen, FakeStack(), story))


@pytest.mark.usefixtures("worlds")
@pytest.mark.sweep(3)
@pytest.mark.parametrize("screen", LISTS)
def test_single_keys_do_not_command_the_robot_on_lists(screen: str) -> None:
    async def story(stage: Stage) -> None:
        for key in ROBOT_KEYS:
            await stage.press(key)
            assert stage.app.screen.is_modal is False, key
            await stage.press("escape")
        assert stage.commands.given == []
        assert not stage.station.lease.ours

    play(lambda: on(screen, FakeStack(), story))


def test_stop_keys_work_while_a_filter_is_typed() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("3", "slash", "x", "f12")
            assert stage.station.stops == 1
            assert stage.words("prompt") == "filter:"

    play(story)


def test_each_screen_remembers_its_filter() -> None:
    async def story() -> None:
        async with staged(station=with_parameters()) as stage:
            await stage.press("3", "slash")
            await stage.type("obs")
            await stage.press("enter", "4")
            assert "/obs" not in stage.words("heading")
            await stage.press("3")
            assert "1 of 5  /obs" in stage.words("heading")
            await stage.press("slash", "r", "a", "d")
            assert "1 of 5  /rad" in stage.words("heading")
            await stage.press("enter", "escape")
            assert len(stage.words("rows").splitlines()) == 5

    play(story)


def test_filter_without_a_match_is_shown_in_the_list() -> None:
    async def story() -> None:
        async with staged(station=with_parameters()) as stage:
            await stage.press("3", "slash")
            await stage.type("zzz")
            await stage.press("enter")
            assert "0 of 5" in stage.words("heading")
            assert "nothing matches zzz: Esc clears the filter" in stage.words("rows")
            await stage.press("e")
            assert stage.words("prompt") != "set d_obs_m:"

    play(story)


def test_arrows_choose_a_row_while_a_filter_is_typed() -> None:
    async def story() -> None:
        async with staged(station=with_parameters()) as stage:
            await stage.press("3", "slash", "d", "_", "down", "enter", "e")
            assert stage.words("prompt") == "set d_min_m:"

    play(story)


def test_choice_stays_on_its_row_when_the_filter_is_cleared() -> None:
    async def story() -> None:
        async with staged(station=with_parameters()) as stage:
            await stage.press("3", "slash")
            await stage.type("track")
            await stage.press("enter", "escape", "e")
            assert stage.words("prompt") == "set track_m:"

    play(story)


@pytest.mark.usefixtures("worlds")
def test_filtered_world_is_the_one_that_starts() -> None:
    stack = FakeStack()

    async def story(stage: Stage) -> None:
        await stage.press("slash")
        await stage.type("walker")
        await stage.press("enter")
        assert "1 of 2" in stage.words("heading")
        await stage.press("s", "s")
        assert stack.begun == ["wall"]

    play(lambda: on("6", stack, story))


@pytest.mark.usefixtures("worlds")
def test_faults_are_filtered() -> None:
    async def story(stage: Stage) -> None:
        await stage.press("slash")
        await stage.type("when:restart sonar")
        assert "sonar_frozen" in stage.words("rows")
        assert "1 of" in stage.words("heading")

    play(lambda: on("7", FakeStack(), story))


def test_log_is_filtered_by_robot_level_and_words() -> None:
    async def story() -> None:
        station = driving(FakeStation())
        station.note("goal 1 2: ok")
        station.note("goal 9 9: refused", Severity.WARNING)
        station.note("link is back", Severity.WARNING)
        async with staged(station=station) as stage:
            await stage.press("4", "slash")
            await stage.type("goal")
            assert "2 of 3" in stage.words("heading")
            await stage.type(" level:warn")
            assert "1 of 3" in stage.words("heading")
            assert "refused" in stage.words("lines")
            await stage.press("ctrl+u")
            await stage.type("robot:ground link")
            assert "1 of 3" in stage.words("heading")
            await stage.press("ctrl+u")
            await stage.type("robot:r7")
            assert "nothing matches robot:r7" in stage.words("lines")

    play(story)


def test_fifty_thousand_lines_arrive_while_the_log_is_filtered() -> None:
    """Each line is examined once; only a shorter filter examines all lines again."""

    async def story() -> None:
        station = driving(FakeStation())
        for number in range(10_000):
            station.note(f"line {number}")
        async with staged(station=station) as stage:
            await stage.press("4", "slash")
            filtered = log_of(stage).filtered
            before = filtered.examined
            await stage.type("line 99")
            assert filtered.examined - before < 7 * 10_000
            await stage.redraw()
            before = filtered.examined
            for batch in range(50):
                for number in range(1000):
                    station.note(f"line {batch * 1000 + number}")
                stage.app.redraw()
            assert filtered.examined - before == 50_000
            assert len(filtered.lines) <= len(station.log) == 10_000
            assert len(filtered.parts) <= 10_000
            assert "line 49999" in stage.words("lines")

    play(story)


def log_of(stage: Stage) -> LogScreen:
    assert isinstance(stage.app.screen, LogScreen)
    return stage.app.screen
