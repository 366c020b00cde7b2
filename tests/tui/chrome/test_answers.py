"""Test that the last answer is visible on every screen, and that Escape closes what is open."""

from pathlib import Path

import pytest

from ground.app.chrome.answers import SHOWN_S, answer_row
from ground.app.screens import SCREENS
from ground.app.start import is_first_start
from ground.app.widgets.rows import width_of, words_of
from ground.station.history.event_log import LogLine
from protocol.wire.enums import Severity
from tests.support.each import each
from tests.support.tui.fakes import S
from tests.support.tui.pilot import play, staged


@pytest.mark.usefixtures("worlds")
def test_refusal_is_shown_on_every_screen_for_some_seconds() -> None:
    async def story() -> None:
        async with staged() as stage:
            for key in map(str, SCREENS.values()):
                await stage.press(key)
                stage.station.note(f"set side 0.{key}: not a whole number", Severity.WARNING)
                await stage.redraw()
                assert f"▲ set side 0.{key}: not a whole number" in stage.words("answer"), key
                stage.station.clock.advance(round((SHOWN_S + 0.1) * S))
                await stage.redraw()
                assert stage.words("answer") == "", key

    play(story)


def test_answer_is_shown_while_the_explanation_covers_the_log() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("e", "y")
            assert "no command to copy yet" in stage.words("answer")
            await stage.press("escape")
            assert stage.app.screen.query_one("#log").display
            await stage.press("escape")
            assert stage.app.screen.query_one("#log").display

    play(story)


def test_answer_leaves_room_to_type_and_a_click_begins_a_line() -> None:
    async def story() -> None:
        async with staged() as stage:
            stage.station.note("x" * 200)
            await stage.redraw()
            await stage.pilot.click("#answer")
            await stage.type("goal 3 1")
            await stage.redraw()
            assert stage.app.screen.query_one("#command").size.width >= 37
            assert stage.words("answer").endswith("…")
            await stage.press("enter")
            assert stage.commands.given == ["goal 3 1"]

    play(story)


@each("width", [20, 40, 80])
def test_cut_answer_names_the_log(width: int) -> None:
    answer = LogLine(0.0, Severity.WARNING, "ground", "x" * 200)
    shown = answer_row(answer, width)
    assert width_of(shown) == width
    assert words_of(shown).endswith("… see Log" if width >= 40 else "…")
    assert "…" not in words_of(answer_row(answer._replace(text="short"), width))


def test_hints_are_shown_on_the_first_start_until_there_is_an_answer(tmp_path: Path) -> None:
    assert is_first_start(tmp_path / "state")
    assert not is_first_start(tmp_path / "state")

    async def story() -> None:
        async with staged() as stage:
            assert stage.words("answer") == ""
            stage.app.is_first_start = True
            await stage.redraw()
            assert stage.words("answer") == "  g sets a goal  space stops  ? shows all keys"
            stage.station.note("goal 3 1: ok 14 ms")
            await stage.redraw()
            assert stage.words("answer") == " goal 3 1: ok 14 ms"

    play(story)
