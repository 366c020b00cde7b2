"""Frames in a stream of bytes."""

from hypothesis import given
from hypothesis import strategies as st

from firmware.board import FrameStream
from protocol.wire.codec import LARGEST_FRAME, Encoder
from protocol.wire.messages import BoardAnswer

ANSWER = BoardAnswer(request=7, message_id=54108, reason=3)
FRAME = Encoder(1, 1).encode(ANSWER)


@given(st.binary(max_size=40).filter(lambda noise: b"\xfd" not in noise), st.integers(1, 30))
def test_frames_between_noise_are_found_in_any_pieces(noise: bytes, size: int) -> None:
    stream = FrameStream()
    sent = noise + FRAME + noise + FRAME
    pieces = [sent[at : at + size] for at in range(0, len(sent), size)]
    found = [message for piece in pieces for message in stream.feed(piece)]
    assert found == [ANSWER, ANSWER]
    assert stream.skipped == 2 * len(noise)


@given(st.binary(max_size=600))
def test_no_bytes_raise_and_few_are_kept(noise: bytes) -> None:
    stream = FrameStream()
    list(stream.feed(noise))
    assert stream.waiting < LARGEST_FRAME


def test_frame_behind_a_false_start_is_found() -> None:
    stream = FrameStream()
    assert list(stream.feed(b"\xfd\x03\x00" + FRAME + FRAME)) == [ANSWER, ANSWER]
    assert stream.skipped == 3
