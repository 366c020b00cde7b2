"""Test small terminals, many resizes, garbage input and missing colours."""

import pytest
from textual import events
from textual.filter import NoColor
from textual.geometry import Size

from ground.app.appearance import default_theme, is_ascii_terminal
from ground.app.screens import SCREENS
from ground.app.screens.drive import drive_layout
from ground.app.screens.log import LogScreen
from ground.app.widgets.command_line import CommandLine, printable
from ground.app.widgets.lines import Lines, Printable
from tests.support.each import each
from tests.support.tui.fakes import FakeStation
from tests.support.tui.pilot import Stage, play, staged
from tests.support.tui.underway import driving

TINY = ((1, 1), (2, 1), (1, 24), (20, 5), (40, 12), (59, 17), (300, 90))
GARBAGE = (
    "\x1b[2J\x1b[31mred\x07\x00",
    "\n\n\r\n",
    "goal 9 7\nestop\n",
    "x" * 5000,
    "\ud7ff\u202e\u0000 goal",
    "'unclosed \"quotes",
    "\U00013000 \uff46\uff55\uff4c\uff4c",
    "[bold red]markup[/] [link=http://x]y",
)


async def resize(stage: Stage, width: int, height: int) -> None:
    stage.app.post_message(events.Resize(Size(width, height), Size(width, height)))
    await stage.redraw()


@each("size", TINY)
def test_app_runs_in_a_terminal_of_any_size(size: tuple[int, int]) -> None:
    async def story() -> None:
        async with staged(size) as stage:
            await stage.press("G", "right", "escape", "?", "escape", "colon", "x", "escape", "f12")
            assert stage.station.stops == 1

    play(story)


def test_every_screen_runs_in_one_cell() -> None:
    async def story() -> None:
        async with staged((1, 1)) as stage:
            for key in SCREENS.values():
                await stage.press(str(key))
                await resize(stage, 200, 60)
                await resize(stage, 1, 1)

    play(story)


def test_small_terminal_shows_values_and_a_hint() -> None:
    async def story() -> None:
        async with staged((50, 30)) as stage:
            assert not stage.app.screen.query_one("#map").display
            assert "the map needs 60 columns and 18 rows" in stage.words("hint")
            await resize(stage, 80, 24)
            assert stage.app.screen.query_one("#map").display

    play(story)


def test_many_resizes_end_with_the_right_picture() -> None:
    async def story() -> None:
        async with staged() as stage:
            for step in range(60):
                size = Size(1 + step * 7 % 190, 1 + step * 5 % 60)
                stage.app.post_message(events.Resize(size, size))
                if step % 10 == 0:
                    stage.app.redraw()
            await resize(stage, 80, 24)
            assert stage.words("status").startswith("● r1")
            world = stage.station.world
            assert world is not None
            map_columns = drive_layout(80, 20, world.size_m).map_columns
            side = stage.app.screen.query_one("#side", Lines)
            assert side.size.width == 80 - map_columns - 1

    play(story)


def test_pasted_garbage_is_plain_text() -> None:
    async def story() -> None:
        async with staged() as stage:
            for text in GARBAGE:
                await stage.press("colon")
                stage.app.post_message(events.Paste(text))
                await stage.redraw()
                value = stage.app.screen.query_one(CommandLine).value
                assert value.isprintable() or value == ""
                assert len(value) <= 400
                assert stage.commands.given == []
                assert stage.station.stops == 0
                await stage.press("enter", "escape")
                assert all(line.isprintable() for line in stage.commands.given)
                stage.commands.given.clear()

    play(story)


def test_paste_on_the_map_presses_no_keys() -> None:
    async def story() -> None:
        async with staged() as stage:
            stage.app.post_message(events.Paste("h x R 5"))
            await stage.redraw()
            assert stage.commands.given == []

    play(story)


def test_paste_is_reduced_to_its_first_line() -> None:
    assert printable("\n  \n goal 1 2 \n estop") == "goal 1 2"
    assert printable("\x1b[31mx\x00") == "[31mx"
    assert printable("") == ""


@pytest.mark.sweep(3)
@pytest.mark.parametrize("theme", ["dark", "mono", "ansi"])
def test_no_color_removes_all_colours(theme: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")

    async def story() -> None:
        async with staged((100, 30), theme=theme) as stage:
            assert [type(one) for one in stage.app.get_line_filters()] == [NoColor, Printable]
            await stage.press("?", "escape", "v", "escape", "ctrl+p", "escape")
            await stage.press("2", "3", "4", "5")

    play(story)


def test_terminal_determines_theme_and_characters() -> None:
    assert default_theme({"NO_COLOR": "1", "TERM": "xterm-256color"}) == "mono"
    assert default_theme({"NO_COLOR": "", "TERM": "xterm-256color"}) == "dark"
    assert default_theme({"TERM": "linux"}) == "ansi"
    assert is_ascii_terminal({"TERM": "linux", "LANG": "de_DE.UTF-8"})
    assert is_ascii_terminal({"LC_ALL": "C", "LANG": "de_DE.UTF-8"})
    assert not is_ascii_terminal({"LANG": "C.UTF-8"})
    assert not is_ascii_terminal({})


def test_ascii_screens_have_ascii_only() -> None:
    async def story() -> None:
        async with staged((160, 50), theme="ansi", ascii_only=True) as stage:
            for key in ("1", "2", "3", "4", "5"):
                await stage.press(key)
                for panel in stage.app.screen.query(Lines):
                    for y in range(panel.size.height):
                        assert panel.render_line(y).text.isascii(), panel

    play(story)


def test_log_of_many_lines_is_searched_and_filtered() -> None:
    async def story() -> None:
        station = driving(FakeStation())
        for number in range(100_000):
            station.note(f"line {number}", 4 if number % 1000 == 0 else 6)
        async with staged(station=station) as stage:
            await stage.press("4")
            assert "line 99999" in stage.words("lines")
            await stage.press("s")
            assert "line 99000" in stage.words("lines")
            assert "line 99999" not in stage.words("lines")
            await stage.press("s", "s")
            screen = stage.app.screen
            assert isinstance(screen, LogScreen)
            screen.find("line 95000")
            assert "line 95000" in stage.words("lines")
            await stage.redraw()
            assert "paused" in stage.words("heading")
            await stage.press("f")
            assert "line 99999" in stage.words("lines")

    play(story)


def test_defect_is_raised_to_the_caller_of_the_app(
    capfd: pytest.CaptureFixture[str],
) -> None:
    async def story() -> None:
        async with staged() as stage:
            stage.app.call_later(raise_defect)
            await stage.pilot.pause()

    with pytest.raises(ZeroDivisionError):
        play(story)
    assert "Traceback" not in capfd.readouterr().err


def raise_defect() -> None:
    raise ZeroDivisionError("defect")
