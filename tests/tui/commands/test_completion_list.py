"""Test the list of completions, the hint on arguments, and the search in the history."""

from ground.app.widgets.command_line import CommandLine, candidate_rows
from ground.app.widgets.rows import words_of
from ground.console.completion import Candidate
from tests.support.tui.pilot import Stage, play, staged


def line_of(stage: Stage) -> CommandLine:
    return stage.app.screen.query_one(CommandLine)


def shown(stage: Stage) -> str:
    panel = stage.app.screen.query_one("#candidates")
    return stage.words("candidates") if panel.display else ""


def test_completions_are_listed_with_their_meaning() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("colon")
            await stage.type("mode ")
            await stage.redraw()
            assert "hold          stopped; keeps its goal" in shown(stage)
            await stage.press("g")
            assert shown(stage).split()[0] == "guided"
            await stage.press("escape")
            assert shown(stage) == ""

    play(story)


def test_tab_and_arrows_choose_a_completion() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("colon")
            await stage.type("ho")
            await stage.press("ctrl+u")
            await stage.type("mode ")
            await stage.press("tab", "tab", "down")
            assert line_of(stage).value == "mode auto"
            await stage.press("up", "shift+tab")
            assert line_of(stage).value == "mode manual"
            await stage.press("escape")
            assert line_of(stage).value == "mode "
            await stage.press("tab", "enter")
            assert stage.commands.given == ["mode manual"]

    play(story)


def test_down_chooses_from_the_list_when_there_is_no_newer_line() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("colon")
            await stage.type("screen p")
            stage.commands.recall = lambda text, step: text  # type: ignore[method-assign]
            await stage.press("down")
            assert line_of(stage).value == "screen plots"

    play(story)


def test_arguments_and_units_are_shown_behind_the_cursor() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("g")
            await stage.until(lambda: "[X] [Y] [DEG]  metres, degrees" in drawn(stage))
            await stage.press("right", "end")
            assert line_of(stage).value == "goal "
            await stage.type("1 2")
            await stage.until(lambda: "[DEG]  degrees" in drawn(stage))
            await stage.press("enter")
            assert stage.commands.given == ["goal 1 2"]

    play(story)


def drawn(stage: Stage) -> str:
    return line_of(stage).render_line(0).text


def test_value_of_a_parameter_has_its_range_as_a_hint() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("3", "e")
            await stage.until(lambda: "0 to 5 m, now 0.4" in drawn(stage))
            assert shown(stage) == ""
            await stage.press("h")
            assert shown(stage) == ""

    play(story)


def test_history_is_searched_and_a_line_is_edited() -> None:
    async def story() -> None:
        async with staged() as stage:
            stage.commands.given = ["goal 1 2", "hold", "goal 3 4 90"]
            await stage.press("colon", "ctrl+r")
            assert stage.words("prompt") == "search the history:"
            await stage.type("go")
            await stage.redraw()
            assert [line.strip() for line in shown(stage).splitlines()] == [
                "goal 3 4 90",
                "goal 1 2",
            ]
            await stage.press("tab", "tab", "enter")
            assert line_of(stage).value == "goal 1 2"
            assert stage.commands.given[3:] == []
            await stage.press("enter")
            assert stage.commands.given[3:] == ["goal 1 2"]

    play(story)


def test_long_list_shows_the_chosen_row_and_the_count() -> None:
    many = [Candidate(f"w{number}", f"w{number}", "text") for number in range(40)]
    rows = list(map(words_of, candidate_rows(many, 30, 60, 20)))
    assert len(rows) == 8
    assert any(row.startswith(" w30 ") for row in rows)
    assert "40 in all" in rows[-1]
    assert candidate_rows(many, None, 60, 0) == []
    assert all(len(words_of(row)) <= 10 for row in candidate_rows(many, None, 10, 3))
