"""Frames are found in any stream of bytes, whole, damaged or torn."""

from random import Random

from firmware.board import FrameStream
from protocol.wire.codec import HEADER_SIZE, Encoder
from protocol.wire.message import Message
from protocol.wire.messages import BoardAnswer, BoardRestart
from tests.support.each import each

ANSWERS = [BoardAnswer(request=n, message_id=54_123, reason=n % 3) for n in range(20)]


def frames() -> list[bytes]:
    encoder = Encoder(1, 1)
    return [encoder.encode(answer) for answer in ANSWERS]


def received(stream: FrameStream, data: bytes, size: int) -> list[Message]:
    """Feed pieces of this size."""
    return [
        message for at in range(0, len(data), size) for message in stream.feed(data[at : at + size])
    ]


@each("size", [1, 2, 7, 1000])
def test_frames_in_pieces_are_complete(size: int) -> None:
    stream = FrameStream()
    assert received(stream, b"".join(frames()), size) == ANSWERS
    assert stream.skipped == 0


@each("seed", range(20))
def test_garbage_between_frames_is_skipped_and_counted(seed: int) -> None:
    random, stream, garbage = Random(seed), FrameStream(), 0
    data = b""
    for frame in frames():
        noise = random.randbytes(random.randrange(60))
        garbage += len(noise)
        data += noise + frame
    assert received(stream, data, random.randrange(1, 99)) == ANSWERS
    assert stream.skipped == garbage


def test_damaged_length_does_not_hold_back_the_next_frame() -> None:
    first, second = frames()[:2]
    damaged = bytearray(first)
    damaged[1] += 1  # now as long as the first byte of the next frame
    assert received(FrameStream(), bytes(damaged) + second, 1) == [ANSWERS[1]]


def test_torn_frame_is_given_up_when_a_whole_one_follows() -> None:
    first, second = frames()[:2]
    stream = FrameStream()
    assert received(stream, first[:-1] + second, 1) == [ANSWERS[1]]
    assert stream.skipped == len(first) - 1


@each("at", [2, 7, 8, 9])
def test_header_of_no_known_message_is_skipped_at_once(at: int) -> None:
    damaged = bytearray(frames()[0])
    damaged[at] = 0xEE
    stream = FrameStream()
    assert received(stream, bytes(damaged[:HEADER_SIZE]), HEADER_SIZE) == []
    assert stream.skipped == HEADER_SIZE


def test_start_of_a_frame_waits_for_its_rest() -> None:
    frame = Encoder(1, 1).encode(BoardRestart(confirmation=54_127))
    stream = FrameStream()
    assert list(stream.feed(frame[:5])) == []
    assert list(stream.feed(frame[5:])) == [BoardRestart(confirmation=54_127)]
    assert stream.skipped == 0
