"""The codec compared with pymavlink: equal bytes, equal values, and only RemoteError raised."""

from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from protocol.wire.codec import CHECKSUM_SIZE, LARGEST_FRAME, Encoder, decode, is_frame
from protocol.wire.message import LAYOUT, Message
from protocol.wire.messages import MESSAGES, GroundTruth, Statustext, WheelCommand
from runtime.errors import LocalError, RemoteError
from tests.support.each import each
from tests.support.protocol.made_up import any_message, messages_of, wire_values
from tests.support.protocol.oracle import frame_by_pymavlink, read_by_pymavlink, value_read

COMMAND = WheelCommand(
    time_ns=50_000_000, seq=1, sense_seq=1, left_mrad_s=-900, right_mrad_s=900, ttl_ms=150
)
octets = st.integers(0, 255)
FEW = settings().max_examples // 3
"""Of each of some fifty messages."""


def refused(frame: bytes) -> bool:
    try:
        decode(frame)
    except RemoteError:
        return True
    return False


@each("cls", MESSAGES)
def test_every_message_is_byte_identical_with_pymavlinks(cls: type[Message]) -> None:
    @settings(max_examples=FEW)
    @given(messages_of(cls), octets, octets)
    def story(message: Message, system: int, component: int) -> None:
        ours = Encoder(system, component).encode(message)
        assert ours == frame_by_pymavlink(message, system, component, 0)

    story()


@each("cls", MESSAGES)
def test_every_message_is_read_as_pymavlink_reads_it(cls: type[Message]) -> None:
    @settings(max_examples=FEW)
    @given(messages_of(cls))
    def story(message: Message) -> None:
        frame = Encoder(1, 1).encode(message)
        theirs = read_by_pymavlink(frame)
        ours = decode(frame).message
        for field in LAYOUT[cls.__name__].fields:
            assert repr(getattr(ours, field.name)) == repr(value_read(field, theirs))

    story()


@given(any_message, octets, octets)
def test_round_trip_preserves_nan_and_infinity(
    message: Message, system: int, component: int
) -> None:
    frame = decode(Encoder(system, component).encode(message))
    assert wire_values(frame.message) == wire_values(message)
    assert (frame.system_id, frame.component_id, frame.sequence) == (system, component, 0)


def test_the_sequence_counts_frames_and_wraps() -> None:
    encoder = Encoder(7, 1)
    seen = [decode(encoder.encode(COMMAND)).sequence for _ in range(300)]
    assert seen == [count % 256 for count in range(300)]


@given(st.binary(max_size=300))
@example(b"")
@example(b"\xfd")
@example(b"\xfe" * 20)
def test_random_bytes_raise_nothing_but_remote_error(noise: bytes) -> None:
    assert refused(noise)


@given(any_message, st.binary(min_size=1, max_size=255))
def test_valid_header_with_random_bytes_raises_remote_error(message: Message, noise: bytes) -> None:
    header = bytearray(Encoder(1, 1).encode(message)[:10])
    header[1] = len(noise)
    refused(bytes(header) + noise + b"\0\0")  # one in 65,536 has the right checksum by chance


def test_every_single_flipped_bit_is_refused() -> None:
    frame = Encoder(1, 1).encode(COMMAND)
    for bit in range(len(frame) * 8):
        broken = bytearray(frame)
        broken[bit // 8] ^= 1 << bit % 8
        assert refused(bytes(broken)), f"bit {bit}"


@given(any_message)
def test_every_truncation_is_refused(message: Message) -> None:
    frame = Encoder(1, 1).encode(message)
    assert all(refused(frame[:size]) for size in range(len(frame)))


def test_two_frames_in_one_sample_are_refused() -> None:
    assert refused(Encoder(1, 1).encode(COMMAND) * 2)


@each("text", ["", "a", "x" * 50])
@each("chunk_seq", [0, 255])
def test_zeros_at_the_end_are_left_out_and_read_back(text: str, chunk_seq: int) -> None:
    sent = Statustext(severity=6, text=text, id=65_535, chunk_seq=chunk_seq)
    frame = Encoder(1, 1).encode(sent)
    assert frame[-CHECKSUM_SIZE - 1] != 0
    assert decode(frame).message == sent


def test_frame_format_is_recognised_without_decoding() -> None:
    frame = Encoder(1, 1).encode(COMMAND)
    assert is_frame(frame)
    assert is_frame(frame[:-1] + bytes([frame[-1] ^ 1])), "the checksum is not looked at"
    for bad in (b"", frame[:-1], frame + b"\0", b"\xfe" + frame[1:], b"\xfd\0" + b"\0" * 10):
        assert not is_frame(bad)


def test_rejected_frame_gives_the_reason() -> None:
    frame = Encoder(1, 1).encode(COMMAND)
    causes = {
        b"": "too short",
        b"\xfe" + frame[1:]: "not with 0xfd",
        frame[:-1]: "announces",
        frame.ljust(LARGEST_FRAME + 1): f"longer than {LARGEST_FRAME} bytes",
        frame[:2] + b"\x01" + frame[3:]: "unsupported",
        frame[:7] + b"\xff\xff\xff" + frame[10:]: "16777215 is not in the dialect",
        frame[:-CHECKSUM_SIZE] + b"\0\0": "checksum of WHEEL_COMMAND",
    }
    for bad, words in causes.items():
        with pytest.raises(RemoteError, match=words):
            decode(bad)


def test_a_text_that_is_not_utf8_is_refused() -> None:
    text = Statustext(severity=6, text="caf\xe9")
    frame = frame_by_pymavlink(text, 1, 1, 0)
    assert decode(frame).message == text
    broken = Statustext(severity=6, text="AAAA")
    payload = Encoder(1, 1).encode(broken)[10:-2].replace(b"AAAA", b"\xff\xfe\xfd\xfc")
    with pytest.raises(RemoteError, match="not UTF-8"):
        decode(resealed(Encoder(1, 1).encode(broken), payload))


def test_known_part_of_a_longer_payload_is_read() -> None:
    frame = Encoder(1, 1).encode(COMMAND)
    payload = frame[10:-2].ljust(30, b"\0") + b"\x07\x08"
    longer = resealed(frame, payload)
    assert decode(longer).message == COMMAND
    assert read_by_pymavlink(longer).ttl_ms == 150


def resealed(frame: bytes, payload: bytes) -> bytes:
    """Return the frame with another payload and a correct checksum."""
    from fastcrc.crc16 import mcrf4xx

    number = int.from_bytes(frame[7:10], "little")
    crc_extra = next(x.crc_extra for x in LAYOUT.values() if x.number == number)
    body = bytes([len(payload)]) + frame[2:10] + payload
    return b"\xfd" + body + mcrf4xx(body + bytes([crc_extra])).to_bytes(2, "little")


@each(
    ("field", "value", "words"),
    [
        ("ttl_ms", 70_000, r"WheelCommand\.ttl_ms = 70000: .* from 0 to 65535"),
        ("ttl_ms", -1, r"WheelCommand\.ttl_ms = -1: .* from 0 to 65535"),
        ("left_mrad_s", 2**31, r"left_mrad_s = 2147483648: .* to 2147483647"),
        ("left_mrad_s", 1.5, r"left_mrad_s = 1\.5: must be an integer"),
        ("seq", None, r"seq = None: must be an integer"),
    ],
)
def test_our_own_bad_value_is_named_with_its_limit(field: str, value: int, words: str) -> None:
    fields = {f.name: getattr(COMMAND, f.name) for f in LAYOUT["WheelCommand"].fields}
    with pytest.raises(LocalError, match=words):
        Encoder(1, 1).encode(WheelCommand(**{**fields, field: value}))


def test_float_too_large_for_32_bits_is_a_local_error() -> None:
    fields: dict[str, Any] = {f.name: 0 for f in LAYOUT["GroundTruth"].fields}
    with pytest.raises(LocalError, match=r"GroundTruth\.x_m = 1e\+39"):
        Encoder(1, 1).encode(GroundTruth(**{**fields, "x_m": 1e39}))


def test_failed_frame_takes_no_sequence_number() -> None:
    encoder = Encoder(1, 1)
    with pytest.raises(LocalError):
        encoder.encode(Statustext(severity=999, text=""))
    assert decode(encoder.encode(COMMAND)).sequence == 0


def test_a_sender_outside_the_wires_range_is_refused() -> None:
    with pytest.raises(LocalError, match="system 256"):
        Encoder(256, 0)
