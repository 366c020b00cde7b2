"""Long texts arrive in pieces and are shown whole."""

from ground.text.wording import StatustextAssembler
from protocol.wire.enums import Severity
from protocol.wire.messages import Statustext
from protocol.wire.statustext import MAX_PIECES, PIECE_BYTES, pieces_of
from tests.support.each import each
from tests.support.ground.client import CYCLE


def piece(text: str, id: int = 0, chunk_seq: int = 0) -> Statustext:
    return Statustext(severity=6, text=text, id=id, chunk_seq=chunk_seq)


def test_a_short_text_is_shown_at_once() -> None:
    assert StatustextAssembler().receive(piece("mode AUTO")) == "mode AUTO"


@each("number", [0, 7])
def test_a_text_is_one_printable_line(number: int) -> None:
    """Escape line breaks, which would let a robot imitate other lines."""
    text = StatustextAssembler().receive(piece("a\nr2: b\x1b]0;c\x07\u202e", number))
    assert text == "a?r2: b?]0;c??"


def test_pieces_are_put_together() -> None:
    texts = StatustextAssembler()
    assert texts.receive(piece("a" * 50, 7, 0)) == ""
    assert texts.receive(piece("b" * 50, 7, 1)) == ""
    assert texts.receive(piece("end", 7, 2)) == "a" * 50 + "b" * 50 + "end"


def test_text_without_its_first_piece_is_shown() -> None:
    texts = StatustextAssembler()
    assert texts.receive(piece("end", 7, 2)) == "end"
    texts.receive(piece("a" * 50, 8, 0))
    assert texts.receive(piece("other", 9, 0)) == "other"


def test_pieces_without_end_are_shown_before_memory_runs_out() -> None:
    texts = StatustextAssembler()
    shown = [texts.receive(piece("x" * 50, 1, seq)) for seq in range(20)]
    assert len(shown[-1]) == 1000


def test_anything_else_is_no_text() -> None:
    assert StatustextAssembler().receive(CYCLE) == ""


@each("text", ["x", "Größe", "a" * 50, "b" * 51, "c" * 150, "d" * 999])
def test_what_is_taken_to_pieces_comes_together_again(text: str) -> None:
    texts = StatustextAssembler()
    *before, last = [texts.receive(piece) for piece in pieces_of(text, 7, Severity.NOTICE)]
    assert not any(before)
    assert last == text


def test_a_text_too_long_for_all_pieces_is_cut_and_still_ends() -> None:
    texts = StatustextAssembler()
    *before, last = [texts.receive(piece) for piece in pieces_of("x" * 100_000, 7, Severity.ERROR)]
    assert not any(before)
    assert last == "x" * (MAX_PIECES * PIECE_BYTES - 1)
