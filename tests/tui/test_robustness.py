"""Small and slow terminals, resizes, garbage, and texts that would control the terminal."""

import os
from dataclasses import replace
from threading import Thread

import pytest
from rich.segment import Segment
from textual import events
from textual.color import Color
from textual.filter import NoColor
from textual.geometry import Size

from checks.harness.until import until
from ground.app.appearance import default_theme, is_ascii_terminal
from ground.app.frame_rate import MAX_DIVISOR, RECOVERY_NS, FrameRate
from ground.app.screens import SCREENS as APP_SCREENS
from ground.app.screens.drive import drive_layout
from ground.app.screens.log import LogScreen
from ground.app.start import TerminalText
from ground.app.widgets.command_line import CommandLine, printable
from ground.app.widgets.lines import Lines, Printable
from ground.client.telemetry import Age
from ground.console.completion import Assistance, Candidate
from ground.station.link.loss import Loss, LossKind
from ground.station.link.streams import StreamRow
from ground.station.robot.lease_state import LeaseView
from protocol.topics import HEARTBEAT, Role
from protocol.wire.enums import Severity
from runtime.units import NS_PER_MS as MS
from tests.support.app import FakeCommandSink, FakeStation, Stage, driving, parameter, staged
from tests.support.each import each
from tests.support.hostile import LETTERS, OWNED, TEXT, raw_in

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
async def test_app_runs_in_a_terminal_of_any_size(size: tuple[int, int]) -> None:
    async with staged(size) as stage:
        await stage.press("G", "right", "escape", "?", "escape", "colon", "x", "escape", "f12")
        assert stage.station.stops == 1


async def test_every_screen_runs_in_one_cell() -> None:
    async with staged((1, 1)) as stage:
        for key in APP_SCREENS.values():
            await stage.press(str(key))
            await resize(stage, 200, 60)
            await resize(stage, 1, 1)


async def test_small_terminal_shows_values_and_a_hint() -> None:
    async with staged((50, 30)) as stage:
        assert not stage.app.screen.query_one("#map").display
        assert "the map needs 60 columns and 18 rows" in stage.words("hint")
        await resize(stage, 80, 24)
        assert stage.app.screen.query_one("#map").display


async def test_many_resizes_end_with_the_right_picture() -> None:
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


async def test_pasted_garbage_is_plain_text() -> None:
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


async def test_paste_on_the_map_presses_no_keys() -> None:
    async with staged() as stage:
        stage.app.post_message(events.Paste("h x R 5"))
        await stage.redraw()
        assert stage.commands.given == []


def test_paste_is_reduced_to_its_first_line() -> None:
    assert printable("\n  \n goal 1 2 \n estop") == "goal 1 2"
    assert printable("\x1b[31mx\x00") == "[31mx"
    assert printable("") == ""


@pytest.mark.sweep(3)
@pytest.mark.parametrize("theme", ["dark", "mono", "ansi"])
async def test_no_color_removes_all_colours(theme: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    async with staged((100, 30), theme=theme) as stage:
        assert [type(one) for one in stage.app.get_line_filters()] == [NoColor, Printable]
        await stage.press("?", "escape", "v", "escape", "ctrl+p", "escape")
        await stage.press("2", "3", "4", "5")


def test_terminal_determines_theme_and_characters() -> None:
    assert default_theme({"NO_COLOR": "1", "TERM": "xterm-256color"}) == "mono"
    assert default_theme({"NO_COLOR": "", "TERM": "xterm-256color"}) == "dark"
    assert default_theme({"TERM": "linux"}) == "ansi"
    assert is_ascii_terminal({"TERM": "linux", "LANG": "de_DE.UTF-8"})
    assert is_ascii_terminal({"LC_ALL": "C", "LANG": "de_DE.UTF-8"})
    assert not is_ascii_terminal({"LANG": "C.UTF-8"})
    assert not is_ascii_terminal({})


async def test_ascii_screens_have_ascii_only() -> None:
    async with staged((160, 50), theme="ansi", ascii_only=True) as stage:
        for key in ("1", "2", "3", "4", "5"):
            await stage.press(key)
            for panel in stage.app.screen.query(Lines):
                for y in range(panel.size.height):
                    assert panel.render_line(y).text.isascii(), panel


async def test_log_of_many_lines_is_searched_and_filtered() -> None:
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


async def test_defect_is_raised_to_the_caller_of_the_app(
    capfd: pytest.CaptureFixture[str],
) -> None:
    async def story() -> None:
        async with staged() as stage:
            stage.app.call_later(raise_defect)
            await stage.pilot.pause()

    with pytest.raises(ZeroDivisionError):
        await story()
    assert "Traceback" not in capfd.readouterr().err


def raise_defect() -> None:
    raise ZeroDivisionError("defect")


SCREENS = {
    "drive": (), "plots": ("2",), "params": ("3",), "log": ("4",), "links": ("5",),
    "worlds": ("6",), "faults": ("7",), "help": ("question_mark",), "why": ("e",),
    "palette": ("ctrl+p",), "robots": ("o",), "completion": ("colon", "g"),
}  # fmt: skip
SHOWS = ("drive", "params", "log", "links", "worlds", "faults", "completion")
"""Screens that must show the hostile text, so that a blank screen does not pass."""


def hostile() -> FakeStation:
    station = driving(FakeStation())
    station.parameters_now = (replace(parameter(f"p{TEXT}", 0.3, 0.4, f"doc {TEXT}"), unit=TEXT),)
    station.rows = [StreamRow(HEARTBEAT, 1.0, MS, Age.LIVE, 1, 0, 0.0, 3, f"no {TEXT}")]
    station.lease_now = LeaseView(held=True, holder=TEXT, name=TEXT)
    station.robots_now = ["r1", f"r{TEXT}"]
    station.queue.last = station.restart_cause_now = station.restarted_now = TEXT
    station.restarts_of = {Role.ROBOT: 2}
    for number in range(3):
        station.note(f"{number} {TEXT}", Severity.ERROR)
    station.loss_now = Loss(LossKind.HUNG, TEXT, TEXT, TEXT, station.now_ns)
    return station


def screen_of(stage: Stage) -> str:
    """Return all text on the terminal, including Textual's own widgets."""
    strips = stage.app.screen._compositor.render_strips()
    return "\n".join("".join(segment.text for segment in strip) for strip in strips)


@pytest.fixture
def worlds(monkeypatch: pytest.MonkeyPatch) -> None:
    def ask(*words: str) -> dict[str, object]:
        if words == ("list",):
            return {"worlds": [{"name": f"w{TEXT}", "says": f"says {TEXT}"}]}
        fault = {"kind": f"k{TEXT}", "targets": [TEXT], "unit": TEXT, "says": TEXT}
        return {"faults": [fault]}

    monkeypatch.setattr("ground.app.screens.worlds.query_worlds", ask)
    monkeypatch.setattr("ground.app.screens.faults.query_worlds", ask)
    monkeypatch.setattr("ground.app.screens.worlds.read_reached_counts", dict)


@pytest.mark.usefixtures("worlds")
async def test_no_screen_shows_a_control_character(monkeypatch: pytest.MonkeyPatch) -> None:
    offered = Assistance((Candidate(f"g{TEXT}", f"g{TEXT}", f"meaning {TEXT}"),), f"hint {TEXT}")
    monkeypatch.setattr(FakeCommandSink, "assist", lambda _self, _text: offered)
    async with staged((120, 40), station=hostile()) as stage:
        for name, keys in SCREENS.items():
            await stage.press("escape", "1", *keys)
            shown = screen_of(stage)
            assert raw_in(shown) == [], name
            assert (OWNED in shown) or name not in SHOWS, name


@each("letter", LETTERS)
def test_replacing_characters_keeps_the_width_of_a_row(letter: str) -> None:
    """Textual has counted the cells already, so that one more would break the line."""
    before = [Segment(f"a{letter}b"), Segment("c")]
    after = Printable().apply(before, Color(0, 0, 0))
    assert raw_in("".join(segment.text for segment in after)) == []
    assert sum(one.cell_length for one in after) == sum(one.cell_length for one in before)


ROUND_NS = 50 * MS


class StubTerminal:
    """A terminal that the test makes busy."""

    busy = False


def drawn(pace: FrameRate, from_ns: int, rounds: int) -> int:
    """Return the number of frames in so many rounds of 50 ms."""
    return sum(pace.due(from_ns + number * ROUND_NS) for number in range(rounds))


def paced() -> tuple[FrameRate, StubTerminal]:
    pace, line = FrameRate(10.0), StubTerminal()
    pace.terminal = line
    return pace, line


def test_full_rate_while_the_terminal_keeps_up() -> None:
    pace, _ = paced()
    assert drawn(pace, 0, 40) == 20


def test_no_frame_before_the_last_was_taken() -> None:
    pace, line = paced()
    assert pace.due(0)
    line.busy = True
    assert drawn(pace, ROUND_NS, 100) == 0
    line.busy = False
    assert pace.due(101 * ROUND_NS)


def test_a_late_frame_halves_the_rate_once() -> None:
    pace, line = paced()
    pace.due(0)
    line.busy = True
    drawn(pace, ROUND_NS, 100)
    assert pace.divisor == 2
    line.busy = False
    assert drawn(pace, 101 * ROUND_NS, 40) == 10


def test_rate_has_a_lower_limit() -> None:
    pace, line = paced()
    at_ns = 0
    for _ in range(20):
        line.busy = False
        drawn(pace, at_ns, 40)
        line.busy = True
        drawn(pace, at_ns + 40 * ROUND_NS, 40)
        at_ns += 80 * ROUND_NS
    assert pace.divisor == MAX_DIVISOR
    line.busy = False
    assert drawn(pace, at_ns, 32) >= 1


def test_rate_recovers_when_the_terminal_keeps_up() -> None:
    pace, line = paced()
    pace.due(0)
    line.busy = True
    drawn(pace, ROUND_NS, 4)
    line.busy = False
    assert drawn(pace, RECOVERY_NS + 10 * ROUND_NS, 40) >= 19
    assert pace.divisor == 1


def test_text_is_busy_until_the_terminal_has_read_it() -> None:
    reading, writing = os.pipe()
    with TerminalText(writing) as text, os.fdopen(reading, "rb") as end:
        text.write("x" * 1000)
        assert text.busy
        text.flush()
        assert not text.busy
        thread = Thread(target=lambda: (text.write("x" * 1_000_000), text.flush()))
        thread.start()
        until(lambda: text.busy)
        assert thread.is_alive()
        while thread.is_alive():
            end.read1(65_536)
            thread.join(0.001)
        assert not text.busy
