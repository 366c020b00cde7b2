"""Test the dialog of choices: descriptions, the choice in force, and its filter."""

from ground.app.screens.choice import Choice, ChoiceScreen
from protocol.wire.enums import Vehicle
from tests.support.tui.pilot import Stage, play, staged
from tests.support.tui.stopped import stopped

MANY = [Choice(f"run-{number}", f"file {number}") for number in range(1, 60)]


def taken(stage: Stage, choices: list[Choice]) -> list[str]:
    """Open the dialog and return the list that will hold the choice."""
    found: list[str] = []
    stage.app.choose("recording", choices, found.append)
    return found


def test_navigators_have_a_description_and_the_current_one_a_mark() -> None:
    async def story() -> None:
        async with staged((100, 30)) as stage:
            await stage.press("v")
            rows = stage.words("choices").splitlines()
            assert "● vgm " in rows[2]
            assert "turns its goal away" in rows[2]
            assert sum("●" in row for row in rows) == 1
            await stage.press("down", "enter")
            assert stage.commands.given == ["navigator bug1"]

    play(story)


def test_choices_are_filtered_while_typing() -> None:
    async def story() -> None:
        async with staged() as stage:
            found = taken(stage, MANY)
            await stage.press("slash")
            await stage.type("jkq 4")
            assert "nothing matches" in stage.words("choices")
            await stage.press("ctrl+u")
            await stage.type("run-4")
            assert "11 of 59" in stage.words("choices")
            await stage.press("down", "enter")
            assert found == ["run-40"]

    play(story)


def test_escape_clears_the_filter_then_closes() -> None:
    async def story() -> None:
        async with staged() as stage:
            found = taken(stage, MANY)
            await stage.press("slash", "4", "escape")
            assert isinstance(stage.app.screen, ChoiceScreen)
            assert "of 59" not in stage.words("choices")
            await stage.press("escape")
            assert not isinstance(stage.app.screen, ChoiceScreen)
            assert found == []

    play(story)


def test_letters_of_the_filter_stop_no_robot_and_f12_does() -> None:
    async def story() -> None:
        async with staged() as stage:
            taken(stage, MANY)
            await stage.press("slash", "S", "space")
            assert stage.station.stops == 0
            await stage.press("f12")
            assert stage.station.stops == 1

    play(story)


def test_chosen_row_of_a_long_list_stays_in_sight() -> None:
    async def story() -> None:
        async with staged((40, 12)) as stage:
            found = taken(stage, MANY)
            await stage.press("up")
            assert "run-59" in stage.words("choices")
            await stage.press("enter")
            assert found == ["run-59"]

    play(story)


def test_click_takes_a_choice() -> None:
    async def story() -> None:
        async with staged() as stage:
            found = taken(stage, MANY[:5])
            await stage.redraw()
            await stage.pilot.click("#choices", offset=(5, 0))
            assert found == []
            await stage.pilot.click("#choices", offset=(5, 3))
            assert found == ["run-3"]

    play(story)


def test_click_only_selects_in_an_emergency_stop() -> None:
    async def story() -> None:
        async with staged(station=stopped(Vehicle.EMERGENCY_STOP)) as stage:
            found = taken(stage, MANY[:5])
            await stage.redraw()
            await stage.pilot.click("#choices", offset=(5, 3))
            assert found == []
            await stage.press("enter")
            assert found == ["run-3"]

    play(story)


def test_title_counts_the_choices_out_of_sight() -> None:
    async def story() -> None:
        async with staged((60, 20)) as stage:
            taken(stage, MANY)
            await stage.redraw()
            assert "▼ 45 below" in stage.words("choices").splitlines()[0]
            assert "▲" not in stage.words("choices").splitlines()[0]
            await stage.press("up")
            assert "▲ 45 above" in stage.words("choices").splitlines()[0]
            assert "▼" not in stage.words("choices").splitlines()[0]

    play(story)
