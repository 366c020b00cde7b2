"""Keys and pastes are separated, and keys that arrive in one block are handled in order."""

from itertools import pairwise

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from textual import events
from textual._ansi_sequences import ANSI_SEQUENCES_KEYS, IGNORE_SEQUENCE
from textual._xterm_parser import XTermParser

from ground.app.input.driver import (
    END,
    HELD_S,
    LONGEST_KEY,
    MAX_LENGTH,
    SILENT_S,
    START,
    InputParser,
    InputPiece,
    PasteParser,
)
from ground.app.input.key_queue import KeyQueue
from ground.app.screens import SCREENS
from ground.app.screens.choice import ChoiceScreen
from ground.app.screens.list_screen import ScrolledScreen
from ground.app.widgets.command_line import CommandLine
from tests.support.app import Stage, staged
from tests.support.each import each

ESC = "\x1b"
LATER_S = 10.0


def pieces_of(*parts: str, apart_s: float = 0.0) -> list[InputPiece]:
    """Return the pieces of these parts, which arrive `apart_s` apart."""
    parser = PasteParser()
    found: list[InputPiece] = []
    for number, part in enumerate(parts):
        now_s = number * apart_s
        found += [*parser.due(now_s), *parser.feed(part, now_s)]
    return [*found, *parser.due(len(parts) * apart_s + LATER_S)]


def joined(pieces: list[InputPiece]) -> list[InputPiece]:
    """Join neighbouring pieces of keys."""
    found: list[InputPiece] = []
    for piece in pieces:
        if found and not piece.pasted and not found[-1].pasted:
            found[-1] = InputPiece(found[-1].text + piece.text)
        else:
            found.append(piece)
    return found


def test_paste_is_one_piece_between_the_keys() -> None:
    assert pieces_of(f":{START}goal 1 2{END}\r") == [
        InputPiece(":"), InputPiece("goal 1 2", pasted=True), InputPiece("\r"),
    ]  # fmt: skip


@given(st.lists(st.integers(0, 60), max_size=8))
def test_result_does_not_depend_on_read_boundaries(places: list[int]) -> None:
    whole = f"{ESC}[A{ESC}x{START}a {ESC}[2Jb\n{END}q{START}{END}{ESC}[24~ {START}z{END}"
    cuts = [0, *sorted(min(place, len(whole)) for place in places), len(whole)]
    assert joined(pieces_of(*(whole[a:b] for a, b in pairwise(cuts)))) == joined(pieces_of(whole))


def test_escape_within_a_paste_is_no_key() -> None:
    assert pieces_of(f"{START}{ESC}[31mred{ESC} a{ESC}[A{END}") == [
        InputPiece("[31mred a[A", pasted=True)
    ]


def test_control_characters_are_removed_from_a_paste() -> None:
    assert pieces_of(f"{START}a\x00\x07\tb\r\nc\rd\u202e{END}") == [
        InputPiece("a b\nc\nd", pasted=True)
    ]


def test_long_paste_is_cut_at_its_limit() -> None:
    chunks = ["x" * 4096] * 300
    found = pieces_of(START, *chunks, f"y{END}h")
    assert found == [InputPiece("x" * MAX_LENGTH, pasted=True), InputPiece("h")]


def test_paste_without_an_end_times_out() -> None:
    parser = PasteParser()
    assert parser.feed(f"{START}abc", 0.0) == []
    assert parser.due(0.9 * SILENT_S) == []
    assert parser.due(SILENT_S) == [InputPiece("abc", pasted=True)]
    assert parser.feed(" ", SILENT_S) == [InputPiece(" ")]


def test_paste_may_pause() -> None:
    parts = (f"{START}a", "b" * 80, "c" * 80, f"d{END}h")
    pasted = f"a{'b' * 80}{'c' * 80}d"
    assert pieces_of(*parts, apart_s=0.9 * SILENT_S) == [
        InputPiece(pasted, pasted=True),
        InputPiece("h"),
    ]


def test_paste_may_arrive_letter_by_letter() -> None:
    parts = [START, *"goal 1 2" * 20, END, "h"]
    assert pieces_of(*parts, apart_s=0.001) == [
        InputPiece("goal 1 2" * 20, pasted=True),
        InputPiece("h"),
    ]


@each("key", [" ", f"{ESC}[24~"])
def test_repeated_stop_key_ends_a_paste_without_end(key: str) -> None:
    """Repeat the key 30 times a second."""
    keys = "".join(
        piece.text for piece in pieces_of(START, *[key] * 60, apart_s=0.033) if not piece[1]
    )
    assert keys.count(key) > 10


@each("rest", [f"D D{END}", "D" * (LONGEST_KEY + 1)])
def test_late_rest_of_a_paste_presses_no_keys(rest: str) -> None:
    assert pieces_of(f"{START}a", rest, "h", apart_s=2 * SILENT_S) == [
        InputPiece("a", pasted=True), InputPiece("h"),
    ]  # fmt: skip


def test_paste_after_one_without_end_is_whole() -> None:
    found = pieces_of(f"{START}a", f"{START}{'b' * 99}{END}h", apart_s=2 * SILENT_S)
    assert found == [
        InputPiece("a", pasted=True),
        InputPiece("b" * 99, pasted=True),
        InputPiece("h"),
    ]


def test_end_mark_within_a_paste_does_not_end_it() -> None:
    assert pieces_of(f"{START}a{END} D D{END}") == [InputPiece("a[201~ D D", pasted=True)]
    assert pieces_of(f"{START}a{END}h{START}b{END}") == [
        InputPiece("a", pasted=True), InputPiece("h"), InputPiece("b", pasted=True),
    ]  # fmt: skip


def test_partial_mark_waits_a_limited_time() -> None:
    parser = PasteParser()
    assert parser.feed("a\x1b[2", 0.0) == [InputPiece("a")]
    assert parser.feed("4~", 0.05) == [InputPiece("\x1b[24~")]
    assert parser.feed(ESC, 1.0) == []
    assert parser.due(1.0 + HELD_S) == [InputPiece(ESC)]


# Messages for Textual.


def keys_of(*parts: str, apart_s: float = 0.0) -> list[str]:
    """Return names of keys and texts of pastes, after a pause at the end."""
    parser, found, now_s = InputParser(), [], 0.0
    for part in parts:
        found += [*parser.tick(now_s), *parser.feed(part, now_s)]
        now_s += apart_s
    found += parser.tick(now_s + LATER_S)
    keys = [one for one in found if isinstance(one, events.Key | events.Paste)]
    return [one.key if isinstance(one, events.Key) else f"<{one.text}>" for one in keys]


def test_keys_have_the_names_of_textual() -> None:
    assert keys_of(f"a {ESC}[A{ESC}[24~\x00{ESC}") == [
        "a",
        "space",
        "up",
        "f12",
        "ctrl+@",
        "escape",
    ]


def test_late_letter_after_escape_is_its_own_key() -> None:
    assert keys_of(ESC, "h", apart_s=1.0) == ["escape", "h"]
    assert keys_of(ESC, ESC, apart_s=1.0) == ["escape", "escape"]


KNOWN = [one for one in ANSI_SEQUENCES_KEYS if len(one) > 1 and one != ESC + ESC]


@each("sequence", KNOWN)
def test_known_sequence_gives_the_messages_of_textual(sequence: str) -> None:
    known = [repr(one) for one in XTermParser().feed(sequence)]
    parser = InputParser()
    assert [repr(one) for one in (*parser.feed(sequence, 0.0), *parser.tick(HELD_S))] == known
    assert known or ANSI_SEQUENCES_KEYS[sequence] is IGNORE_SEQUENCE


@each("report", [f"{ESC}[<35;10;5M", f"{ESC}[I", f"{ESC}[48;24;80;480;800t"])
def test_reports_of_a_terminal_are_passed_on(report: str) -> None:
    assert len(list(InputParser().feed(report, 0.0))) == 1


@each(
    "unknown",
    [
        f"{ESC}[?62;22c",
        f"{ESC}[48;;;;t",
        f"{ESC}[99999999999u",
        f"{ESC}[{'1;' * 99}a",
        f"{ESC}[[Z",
        f"{ESC}[M a ",
        f"{ESC}OZ",
        f"{ESC}]11;rgb:aaaa/0000/dddd{ESC}\\",
        f"{ESC}]11;rgb:aaaa/0000/dddd\x07",
        f"{ESC}P>|xterm a(390){ESC}\\",
        f"{ESC}[5;1",
        f"{ESC}]11;rgb:aaaa",
    ],
)
def test_unknown_sequence_neither_adds_nor_loses_keys(unknown: str) -> None:
    """Send it in one read, letter by letter, and slowly."""
    f12 = f"{ESC}[24~"
    assert keys_of(f"h{unknown}{f12}") == ["h", "f12"]
    assert keys_of(*unknown, f12) == ["f12"]
    assert keys_of(unknown, " ", apart_s=1.0) == ["space"]


@each(("typed", "key"), [("x", "alt+x"), ("O", "alt+shift+o"), ("[", "left_square_bracket")])
def test_escape_and_a_letter_are_a_chord(typed: str, key: str) -> None:
    assert keys_of(ESC + typed) == [key]
    assert keys_of(f"{ESC}{typed}{ESC}[24~") == [key, "f12"]


@each(
    "garbage",
    [
        f"{ESC}[99999999999u",
        f"{ESC}[48;;;;t",
        f"{ESC}[1114112u",
        f"{START}{ESC}[48;;;;t{ESC}[O",
        f"{START}{ESC}",
        f"{ESC}[<1;1",
        f"{ESC}]52;c;" + "A" * 500,
    ],
)
def test_keys_work_after_garbage(garbage: str) -> None:
    assert keys_of(garbage, "h", f"{ESC}[24~", apart_s=1.0)[-2:] == ["h", "f12"]


@given(st.lists(st.text(st.sampled_from(f"{ESC}[]0129;~?<uMtORA \x00"), max_size=40), max_size=6))
def test_no_input_stops_the_parser(parts: list[str]) -> None:
    assert keys_of(*parts, "", "h", apart_s=1.0)[-1] == "h"


@given(st.text(st.sampled_from(f"{ESC}[]0129;:~?<uMtORPA$ \x00\x07\\"), max_size=60))
def test_stop_key_survives_garbage_in_the_same_read(text: str) -> None:
    assume(START not in text)
    assert keys_of(f"{text}{ESC}[24~")[-1] == "f12"


@given(st.text(max_size=60))
def test_pasted_text_never_presses_a_key(text: str) -> None:
    found = keys_of(f"{START}{text}{END}")
    assert len(found) == 1
    assert found[0].startswith("<")


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
async def test_keys_in_one_piece_are_handled_in_their_order(typed: str, given: list[str]) -> None:
    async with staged() as stage:
        await send(stage, typed)
        assert stage.commands.given == given


@pytest.mark.sweep(3)
@pytest.mark.parametrize("name", ["params", "log", "links", "worlds", "faults"])
async def test_keys_behind_the_slash_are_the_filter(name: str, worlds: None) -> None:
    async with staged() as stage:
        await send(stage, f"{SCREENS[name]}/h S\r/s xD\r")
        screen = stage.app.screen
        assert isinstance(screen, ScrolledScreen)
        assert screen.words == "s xD"
        assert stage.commands.given == []
        assert stage.station.stops == stage.station.stops_of_all == 0


@each("opening", [":", "v/", "4/", "g", "\x10"])
async def test_space_is_text_where_text_is_typed(opening: str) -> None:
    async with staged() as stage:
        await send(stage, f"{opening}a b")
        assert stage.station.stops == 0
        await send(stage, "\x1b[24~")
        assert stage.station.stops == 1


@each(
    "opening",
    [":arm\r", ":a\x1b", "v", "vj", "v/b\x1b", "?", "?j", "4", "4j", "4/a\r", "4/a\x1b", "e", "G",
     "t", "\x10a\x1b", "1"],
)  # fmt: skip
async def test_space_in_the_same_piece_stops_where_nothing_is_typed(opening: str) -> None:
    async with staged() as stage:
        await send(stage, f"{opening} ")
        assert stage.station.stops == 1


async def test_stop_does_not_wait_for_a_screen_to_open(monkeypatch: pytest.MonkeyPatch) -> None:
    async with staged() as stage:
        monkeypatch.setattr("ground.app.input.key_queue.is_ready", lambda _: False)
        monkeypatch.setattr(KeyQueue, "_wait", lambda _: None)
        await send(stage, " ")
        assert stage.station.stops == 1
        await send(stage, "h:")
        assert stage.commands.given == []
        await send(stage, "\x1b[24~")
        assert stage.station.stops_of_all == 1


async def test_palette_gets_what_is_typed_behind_its_key() -> None:
    async with staged() as stage:
        await send(stage, "\x10hold S")
        assert stage.app.focused is not None
        assert getattr(stage.app.focused, "value", "") == "hold S"
        assert stage.station.stops_of_all == 0


async def test_digit_and_letter_in_the_filter_of_a_dialog_are_text() -> None:
    async with staged() as stage:
        await send(stage, "v/1")
        assert isinstance(stage.app.screen, ChoiceScreen)
        assert "1 of 7" in stage.words("choices")
        await send(stage, "\x1b")
        assert isinstance(stage.app.screen, ChoiceScreen)


async def test_pasted_line_replaces_the_selected_filter() -> None:
    async with staged() as stage:
        await send(stage, "4/lease\r/\x1b[200~goal\nx\x1b[201~")
        line = stage.app.screen.query_one(CommandLine)
        assert line.value == "goal"
