"""Test that keys which arrive in one block are handled in order, each by the screen that is open
then."""

import pytest

from ground.app.input.driver import InputParser
from ground.app.input.key_queue import KeyQueue
from ground.app.screens import SCREENS
from ground.app.screens.choice import ChoiceScreen
from ground.app.screens.list_screen import ScrolledScreen
from ground.app.widgets.command_line import CommandLine
from tests.support.each import each
from tests.support.tui.pilot import Stage, play, staged


async def send(stage: Stage, text: str) -> None:
    """Let a terminal send these characters in one piece."""
    for message in InputParser().feed(text, 0.0):
        stage.app.post_message(message)
    for _ in range(3):
        await stage.redraw()


@pytest.mark.sweep(2)
@pytest.mark.parametrize(
    ("typed", "given"),
    [
        (":wp upload\r:arm\r", ["wp upload", "arm"]),
        (":hold\r:arm\r:hold\r", ["hold", "arm", "hold"]),
        (":arm\rh", ["arm", "hold"]),
        (":arx\x7fm\r", ["arm"]),
        (":rm\x1b[D\x1b[Da\r", ["arm"]),
        ("v/bug1\r", ["navigator bug1"]),
        ("v/jkq\x15bug2\rh", ["navigator bug2", "hold"]),
        ("v/bug\x1b[B\r", ["navigator bug1"]),
        ("v3m2", ["navigator bug1", "mode hold"]),
        ("v\x1b[B\rh", ["navigator bug1", "hold"]),
        ("41h", ["hold"]),
        (":\x1b[200~arm\x1b[201~\rh", ["arm", "hold"]),
    ],
)
def test_keys_in_one_piece_are_handled_in_their_order(typed: str, given: list[str]) -> None:
    async def story() -> None:
        async with staged() as stage:
            await send(stage, typed)
            assert stage.commands.given == given

    play(story)


@pytest.mark.sweep(3)
@pytest.mark.parametrize("name", ["params", "log", "links", "worlds", "faults"])
def test_keys_behind_the_slash_are_the_filter(name: str, worlds: None) -> None:
    async def story() -> None:
        async with staged() as stage:
            await send(stage, f"{SCREENS[name]}/h S\r/s xD\r")
            screen = stage.app.screen
            assert isinstance(screen, ScrolledScreen)
            assert screen.words == "s xD"
            assert stage.commands.given == []
            assert stage.station.stops == stage.station.stops_of_all == 0

    play(story)


@each("opening", [":", "v/", "4/", "g", "\x10"])
def test_space_is_text_where_text_is_typed(opening: str) -> None:
    async def story() -> None:
        async with staged() as stage:
            await send(stage, f"{opening}a b")
            assert stage.station.stops == 0
            await send(stage, "\x1b[24~")
            assert stage.station.stops == 1

    play(story)


@pytest.mark.parametrize(
    "opening",
    [":arm\r", ":a\x1b", "v", "vj", "v/b\x1b", "?", "?j", "4", "4j", "4/a\r", "4/a\x1b", "e", "G",
     "t", "\x10a\x1b", "1"],
)  # fmt: skip
def test_space_in_the_same_piece_stops_where_nothing_is_typed(opening: str) -> None:
    async def story() -> None:
        async with staged() as stage:
            await send(stage, f"{opening} ")
            assert stage.station.stops == 1

    play(story)


def test_stop_does_not_wait_for_a_screen_to_open(monkeypatch: pytest.MonkeyPatch) -> None:
    async def story() -> None:
        async with staged() as stage:
            monkeypatch.setattr("ground.app.input.key_queue.is_ready", lambda _: False)
            monkeypatch.setattr(KeyQueue, "_wait", lambda _: None)
            await send(stage, " ")
            assert stage.station.stops == 1
            await send(stage, "h:")
            assert stage.commands.given == []
            await send(stage, "\x1b[24~")
            assert stage.station.stops_of_all == 1

    play(story)


def test_palette_gets_what_is_typed_behind_its_key() -> None:
    async def story() -> None:
        async with staged() as stage:
            await send(stage, "\x10hold S")
            assert stage.app.focused is not None
            assert getattr(stage.app.focused, "value", "") == "hold S"
            assert stage.station.stops_of_all == 0

    play(story)


def test_digit_and_letter_in_the_filter_of_a_dialog_are_text() -> None:
    async def story() -> None:
        async with staged() as stage:
            await send(stage, "v/1")
            assert isinstance(stage.app.screen, ChoiceScreen)
            assert "1 of 6" in stage.words("choices")
            await send(stage, "\x1b")
            assert isinstance(stage.app.screen, ChoiceScreen)

    play(story)


def test_pasted_line_replaces_the_selected_filter() -> None:
    async def story() -> None:
        async with staged() as stage:
            await send(stage, "4/lease\r/\x1b[200~goal\nx\x1b[201~")
            line = stage.app.screen.query_one(CommandLine)
            assert line.value == "goal"

    play(story)
