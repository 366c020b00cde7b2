"""Test the tab bar and the key bar: what fits, what is marked, and what a click does."""

from ground.app.chrome.button_row import Button, buttons_width
from ground.app.chrome.key_bar import key_buttons
from ground.app.chrome.tabs import UnreadWarnings, tab_buttons
from ground.app.input.keymap import Keymap, Layer
from ground.app.widgets.rows import words_of
from ground.station.history.event_log import EventLog, LogLine
from protocol.wire.enums import Severity
from tests.support.each import each
from tests.support.tui.pilot import play, staged


@each("width", [0, 1, 20, 40, 80, 160])
def test_key_bar_fits_and_begins_with_the_stop(width: int) -> None:
    keys = Keymap().of(Layer.STOP, Layer.DRIVE, Layer.ROBOT, Layer.FLEET, Layer.STATION)
    left, right = key_buttons(keys, width)
    if width >= 40:
        assert buttons_width([*left, *right]) <= width
        assert words(left).startswith(" space E-STOP")
        assert words(right).endswith("? Help ")


def words(buttons: list[Button]) -> str:
    return "".join(words_of(one.row) for one in buttons)


@each(
    ("width", "text"),
    [
        (200, " 1 Drive  2 Plots ▌3 Params▐ 4 Log ▲2  5 Links  6 Worlds  7 Faults  8 Replay "),
        (80, " 1 Drive  2 Plots ▌3 Params▐ 4 Log ▲2  5 Links  6 Worlds  7 Faults  8 Replay "),
        (40, " 1  2 ▌3 Params▐ 4 ▲2  5  6  7  8 "),
        (20, "▌3 Params▐"),
        (3, "▌3 Params▐"),
    ],
)
def test_tabs_are_shortened_but_name_the_present_screen(width: int, text: str) -> None:
    assert words(tab_buttons("params", 2, width)) == text


def test_tabs_mark_the_present_screen_in_ascii() -> None:
    assert words(tab_buttons("drive", 0, 80, ascii_only=True)).startswith("[1 Drive] 2 Plots  3")


def test_warnings_are_unread_until_the_log_is_shown() -> None:
    unread, log = UnreadWarnings(), EventLog()
    for severity in (Severity.WARNING, Severity.INFO, Severity.CRITICAL):
        log.add(LogLine(0.0, severity, "r1", "text"))
    unread.look(log, reading=False)
    unread.look(log, reading=False)
    assert unread.count == 2
    unread.look(log, reading=True)
    log.add(LogLine(1.0, Severity.WARNING, "r1", "text"))
    unread.look(log, reading=False)
    assert unread.count == 1


def test_click_on_a_tab_shows_its_screen() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.pilot.click("#tabs", offset=(stage.words("tabs").index("Links"), 0))
            await stage.redraw()
            assert stage.app.current_mode == "links"
            assert "▌5 Links▐" in stage.words("tabs")

    play(story)


def test_click_on_the_stop_in_the_key_bar_stops() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.pilot.click("#keybar", offset=(stage.words("keybar").index("E-STOP"), 0))
            assert stage.station.stops == 1

    play(story)


def test_warnings_are_counted_on_the_tab_of_the_log() -> None:
    async def story() -> None:
        async with staged() as stage:
            stage.station.note("refused", Severity.WARNING)
            await stage.redraw()
            assert "4 Log ▲1" in stage.words("tabs")
            await stage.press("4", "1")
            assert "▲" not in stage.words("tabs")

    play(story)


@each("size", [(20, 5), (40, 12), (80, 24), (200, 60)])
def test_tab_bar_leaves_room_on_a_low_terminal(size: tuple[int, int]) -> None:
    async def story() -> None:
        async with staged(size) as stage:
            assert stage.app.screen.query_one("#tabs").display == (size[1] >= 10)
            assert stage.app.screen.query_one("#keybar").region.bottom == size[1]

    play(story)
