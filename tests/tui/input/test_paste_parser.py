"""Keys and pastes of a terminal are told apart, also when the end of a paste never comes."""

from itertools import pairwise

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from textual import events
from textual._ansi_sequences import ANSI_SEQUENCES_KEYS, IGNORE_SEQUENCE
from textual._xterm_parser import XTermParser

from ground.app.input.driver import InputParser
from ground.app.input.paste_parser import (
    END,
    HELD_S,
    LONGEST_KEY,
    MOST,
    SILENT_S,
    START,
    InputPiece,
    PasteParser,
)

ESC = "\x1b"
LATER_S = 10.0


def told(*parts: str, apart_s: float = 0.0) -> list[InputPiece]:
    """What came of these parts, each so long after the one before."""
    pastes = PasteParser()
    found: list[InputPiece] = []
    for number, part in enumerate(parts):
        now_s = number * apart_s
        found += [*pastes.due(now_s), *pastes.feed(part, now_s)]
    return [*found, *pastes.due(len(parts) * apart_s + LATER_S)]


def joined(pieces: list[InputPiece]) -> list[InputPiece]:
    """Neighbouring keys in one piece."""
    found: list[InputPiece] = []
    for piece in pieces:
        if found and not piece.pasted and not found[-1].pasted:
            found[-1] = InputPiece(found[-1].text + piece.text)
        else:
            found.append(piece)
    return found


def test_a_paste_is_one_piece_between_the_keys() -> None:
    assert told(f":{START}goal 1 2{END}\r") == [
        InputPiece(":"), InputPiece("goal 1 2", pasted=True), InputPiece("\r"),
    ]  # fmt: skip


@given(st.lists(st.integers(0, 60), max_size=8))
def test_it_does_not_matter_how_what_comes_is_cut(places: list[int]) -> None:
    whole = f"{ESC}[A{ESC}x{START}a {ESC}[2Jb\n{END}q{START}{END}{ESC}[24~ {START}z{END}"
    cuts = [0, *sorted(min(place, len(whole)) for place in places), len(whole)]
    assert joined(told(*(whole[a:b] for a, b in pairwise(cuts)))) == joined(told(whole))


def test_an_escape_within_a_paste_is_no_key() -> None:
    assert told(f"{START}{ESC}[31mred{ESC} a{ESC}[A{END}") == [
        InputPiece("[31mred a[A", pasted=True)
    ]


def test_what_steers_a_terminal_is_taken_out_of_a_paste() -> None:
    assert told(f"{START}a\x00\x07\tb\r\nc\rd\u202e{END}") == [InputPiece("a b\nc\nd", pasted=True)]


def test_of_a_long_paste_the_beginning_is_kept_and_its_end_is_found() -> None:
    chunks = ["x" * 4096] * 300
    found = told(START, *chunks, f"y{END}h")
    assert found == [InputPiece("x" * MOST, pasted=True), InputPiece("h")]


def test_a_paste_without_an_end_is_over_when_nothing_more_comes() -> None:
    pastes = PasteParser()
    assert pastes.feed(f"{START}abc", 0.0) == []
    assert pastes.due(0.9 * SILENT_S) == []
    assert pastes.due(SILENT_S) == [InputPiece("abc", pasted=True)]
    assert pastes.feed(" ", SILENT_S) == [InputPiece(" ")]


def test_a_paste_that_pauses_is_not_over() -> None:
    parts = (f"{START}a", "b" * 80, "c" * 80, f"d{END}h")
    pasted = f"a{'b' * 80}{'c' * 80}d"
    assert told(*parts, apart_s=0.9 * SILENT_S) == [
        InputPiece(pasted, pasted=True),
        InputPiece("h"),
    ]


def test_a_slow_line_sends_a_paste_letter_by_letter() -> None:
    parts = [START, *"goal 1 2" * 20, END, "h"]
    assert told(*parts, apart_s=0.001) == [
        InputPiece("goal 1 2" * 20, pasted=True),
        InputPiece("h"),
    ]


@pytest.mark.parametrize("key", [" ", f"{ESC}[24~"])
def test_who_beats_on_the_stop_is_heard_although_a_paste_has_no_end(key: str) -> None:
    """A key that repeats, 30 times a second."""
    keys = "".join(piece.text for piece in told(START, *[key] * 60, apart_s=0.033) if not piece[1])
    assert keys.count(key) > 10


@pytest.mark.parametrize("rest", [f"D D{END}", "D" * (LONGEST_KEY + 1)])
def test_the_late_rest_of_a_paste_that_was_given_up_presses_no_keys(rest: str) -> None:
    assert told(f"{START}a", rest, "h", apart_s=2 * SILENT_S) == [
        InputPiece("a", pasted=True), InputPiece("h"),
    ]  # fmt: skip


def test_after_a_paste_without_an_end_another_one_is_whole() -> None:
    found = told(f"{START}a", f"{START}{'b' * 99}{END}h", apart_s=2 * SILENT_S)
    assert found == [
        InputPiece("a", pasted=True),
        InputPiece("b" * 99, pasted=True),
        InputPiece("h"),
    ]


def test_an_end_that_is_pasted_too_ends_nothing() -> None:
    assert told(f"{START}a{END} D D{END}") == [InputPiece("a[201~ D D", pasted=True)]
    assert told(f"{START}a{END}h{START}b{END}") == [
        InputPiece("a", pasted=True), InputPiece("h"), InputPiece("b", pasted=True),
    ]  # fmt: skip


def test_half_a_mark_waits_for_the_other_half_and_not_for_ever() -> None:
    pastes = PasteParser()
    assert pastes.feed("a\x1b[2", 0.0) == [InputPiece("a")]
    assert pastes.feed("4~", 0.05) == [InputPiece("\x1b[24~")]
    assert pastes.feed(ESC, 1.0) == []
    assert pastes.due(1.0 + HELD_S) == [InputPiece(ESC)]


# As Textual is told.


def heard(*parts: str, apart_s: float = 0.0) -> list[str]:
    """Keys by name and pastes by text, when after the parts all is quiet."""
    ears, found, now_s = InputParser(), [], 0.0
    for part in parts:
        found += [*ears.tick(now_s), *ears.feed(part, now_s)]
        now_s += apart_s
    found += ears.tick(now_s + LATER_S)
    keys = [one for one in found if isinstance(one, events.Key | events.Paste)]
    return [one.key if isinstance(one, events.Key) else f"<{one.text}>" for one in keys]


def test_keys_are_those_that_textual_knows() -> None:
    assert heard(f"a {ESC}[A{ESC}[24~\x00{ESC}") == ["a", "space", "up", "f12", "ctrl+@", "escape"]


def test_escape_is_pressed_once_and_a_letter_after_it_is_its_own() -> None:
    assert heard(ESC, "h", apart_s=1.0) == ["escape", "h"]
    assert heard(ESC, ESC, apart_s=1.0) == ["escape", "escape"]


KNOWN = [one for one in ANSI_SEQUENCES_KEYS if len(one) > 1 and one != ESC + ESC]


@pytest.mark.parametrize("sequence", KNOWN)
def test_a_sequence_that_textual_knows_means_what_it_means_there(sequence: str) -> None:
    known = [repr(one) for one in XTermParser().feed(sequence)]
    ears = InputParser()
    assert [repr(one) for one in (*ears.feed(sequence, 0.0), *ears.tick(HELD_S))] == known
    assert known or ANSI_SEQUENCES_KEYS[sequence] is IGNORE_SEQUENCE


@pytest.mark.parametrize("report", [f"{ESC}[<35;10;5M", f"{ESC}[I", f"{ESC}[48;24;80;480;800t"])
def test_what_a_terminal_reports_is_handed_on(report: str) -> None:
    assert len(list(InputParser().feed(report, 0.0))) == 1


@pytest.mark.parametrize(
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
def test_an_unknown_sequence_presses_no_key_and_swallows_none(unknown: str) -> None:
    """In one read, letter by letter, and slowly."""
    f12 = f"{ESC}[24~"
    assert heard(f"h{unknown}{f12}") == ["h", "f12"]
    assert heard(*unknown, f12) == ["f12"]
    assert heard(unknown, " ", apart_s=1.0) == ["space"]


@pytest.mark.parametrize(
    ("typed", "key"), [("x", "alt+x"), ("O", "alt+shift+o"), ("[", "left_square_bracket")]
)
def test_escape_and_a_letter_is_a_chord(typed: str, key: str) -> None:
    assert heard(ESC + typed) == [key]
    assert heard(f"{ESC}{typed}{ESC}[24~") == [key, "f12"]


@pytest.mark.parametrize(
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
def test_after_any_garbage_keys_are_keys_again(garbage: str) -> None:
    assert heard(garbage, "h", f"{ESC}[24~", apart_s=1.0)[-2:] == ["h", "f12"]


@given(st.lists(st.text(st.sampled_from(f"{ESC}[]0129;~?<uMtORA \x00"), max_size=40), max_size=6))
def test_nothing_that_a_terminal_sends_stops_the_ears(parts: list[str]) -> None:
    assert heard(*parts, "", "h", apart_s=1.0)[-1] == "h"


@given(st.text(st.sampled_from(f"{ESC}[]0129;:~?<uMtORPA$ \x00\x07\\"), max_size=60))
def test_nothing_swallows_a_stop_that_comes_in_the_same_read(text: str) -> None:
    assume(START not in text)
    assert heard(f"{text}{ESC}[24~")[-1] == "f12"


@given(st.text(max_size=60))
def test_nothing_that_is_pasted_presses_a_key(text: str) -> None:
    found = heard(f"{START}{text}{END}")
    assert len(found) == 1
    assert found[0].startswith("<")
