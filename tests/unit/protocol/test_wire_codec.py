"""The codec by examples: every branch, limit and error, byte by byte.

`test_codec.py` holds it against pymavlink; here every byte is written down.
"""

import pytest
from fastcrc.crc16 import mcrf4xx

from protocol.wire.codec import LARGEST_FRAME, SMALLEST_FRAME, Encoder, Frame, decode, is_frame
from protocol.wire.message import Message
from protocol.wire.messages import GroundTruth, Statustext, WheelCommand
from runtime.errors import LocalError, RemoteError
from tests.support.each import each

COMMAND = WheelCommand(
    time_ns=50_000_000,
    seq=1,
    sense_seq=2,
    epoch=7,
    left_mrad_s=-900,
    right_mrad_s=901,
    ttl_ms=150,
)
COMMAND_BYTES = bytes.fromhex(
    "fd 1d 00 00 00 03 04 56d300"  # head: sequence 0 of system 3, component 4
    "80f0fa0200000000 01000000 02000000 07000000 7cfcffff 85030000 96"  # a zero is left out
    "d078"
)
FRAMES: tuple[tuple[Message, int, int, bytes], ...] = (
    (COMMAND, 3, 4, COMMAND_BYTES),
    (
        Statustext(severity=6, text="caf\xe9"),
        0,
        255,
        bytes.fromhex("fd 06 00 00 00 00 ff fd0000 06 636166c3a9 ef92"),
    ),
    (
        Statustext(severity=6, text="BOX"),
        1,
        1,
        bytes.fromhex("fd 04 00 00 00 01 01 fd0000 06 424f58 7118"),
    ),
    (
        Statustext(severity=0, text=""),
        255,
        0,
        bytes.fromhex("fd 01 00 00 00 ff 00 fd0000 00 d3a8"),
    ),
)
CRC_EXTRA_OF_STATUSTEXT = 83


def sealed(payload: bytes, flags: bytes = b"\0\0") -> bytes:
    """Return a frame of a STATUSTEXT with this payload and a correct checksum."""
    body = bytes([len(payload)]) + flags + b"\0\x01\x01\xfd\0\0" + payload
    return b"\xfd" + body + mcrf4xx(body + bytes([CRC_EXTRA_OF_STATUSTEXT])).to_bytes(2, "little")


@each(("message", "system", "component", "frame"), FRAMES)
def test_message_becomes_these_bytes_and_comes_back(
    message: Message, system: int, component: int, frame: bytes
) -> None:
    assert Encoder(system, component).encode(message) == frame
    assert decode(frame) == Frame(
        message=message, system_id=system, component_id=component, sequence=0
    )


def test_frame_cannot_be_changed_and_names_its_fields() -> None:
    frame = decode(COMMAND_BYTES)
    with pytest.raises(AttributeError):
        frame.sequence = 1  # type: ignore[misc]
    with pytest.raises(TypeError):
        Frame(COMMAND, 3, 4, 0)  # type: ignore[call-arg]


def test_sequence_wraps_after_255() -> None:
    encoder = Encoder(1, 1)
    frames = [encoder.encode(COMMAND) for _ in range(258)]
    assert [frame[4] for frame in frames] == [*range(256), 0, 1]
    assert [decode(frame).sequence for frame in frames] == [*range(256), 0, 1]


@each("numbers", [(-1, 0), (256, 0), (0, -1), (0, 256)])
def test_encoder_refuses_a_sender_beyond_a_byte(numbers: tuple[int, int]) -> None:
    words = f"^system {numbers[0]}, component {numbers[1]}: each must be 0 to 255$"
    with pytest.raises(LocalError, match=words):
        Encoder(*numbers)


def test_message_that_does_not_fit_is_named_and_takes_no_number() -> None:
    encoder = Encoder(1, 1)
    with pytest.raises(LocalError, match=r"^Statustext\.severity = 999: ") as refused:
        encoder.encode(Statustext(severity=999, text=""))
    assert refused.value.__cause__ is not None
    truth = GroundTruth(**(dict.fromkeys(GroundTruth.__struct_fields__, 0) | {"x_m": 1e39}))  # type: ignore[arg-type]
    with pytest.raises(LocalError, match=r"^GroundTruth\.x_m = 1e\+39: "):
        encoder.encode(truth)
    assert decode(encoder.encode(COMMAND)).sequence == 0


REFUSED = {
    "empty": (b"", "frame of 0 bytes is too short"),
    "too short": (b"\xfd" + bytes(SMALLEST_FRAME - 2), "frame of 12 bytes is too short"),
    "shortest": (bytes(SMALLEST_FRAME), "frame starts with 0x00, not with 0xfd of MAVLink 2"),
    "longest": (bytes(LARGEST_FRAME), "frame starts with 0x00, not with 0xfd of MAVLink 2"),
    "too long": (bytes(LARGEST_FRAME + 1), "frame is longer than 267 bytes"),
    "MAVLink 1": (
        b"\xfe" + COMMAND_BYTES[1:],
        "frame starts with 0xfe, not with 0xfd of MAVLink 2",
    ),
    "cut off": (COMMAND_BYTES[:-1], "frame of 40 bytes announces 29 bytes of payload"),
    "with more": (COMMAND_BYTES + b"\0", "frame of 42 bytes announces 29 bytes of payload"),
    "signed": (sealed(b"\x06", b"\1\0"), "frame needs unsupported features (flags 0x01)"),
    "unknown": (
        COMMAND_BYTES[:7] + b"\x01\x02\x03" + COMMAND_BYTES[10:],
        f"message id {0x030201} is not in the dialect",
    ),
    "unknown above 65535": (
        COMMAND_BYTES[:9] + b"\x01" + COMMAND_BYTES[10:],
        f"message id {0x01D356} is not in the dialect",
    ),
    "checksum": (COMMAND_BYTES[:-2] + b"\0\0", "checksum of WHEEL_COMMAND does not match"),
    "low byte of the checksum": (
        COMMAND_BYTES[:-2] + b"\xd1\x78",
        "checksum of WHEEL_COMMAND does not match",
    ),
    "high byte of the checksum": (
        COMMAND_BYTES[:-2] + b"\xd0\x79",
        "checksum of WHEEL_COMMAND does not match",
    ),
    "not UTF-8": (sealed(b"\x06\xff\xfe"), "a text of STATUSTEXT is not UTF-8"),
}


@each(("frame", "words"), REFUSED.values())
def test_error_names_the_first_fault(frame: bytes, words: str) -> None:
    with pytest.raises(RemoteError) as refused:
        decode(frame)
    assert str(refused.value) == words


@each("at", range(len(COMMAND_BYTES)))
def test_changed_byte_is_refused(at: int) -> None:
    with pytest.raises(RemoteError):
        decode(COMMAND_BYTES[:at] + bytes([COMMAND_BYTES[at] ^ 1]) + COMMAND_BYTES[at + 1 :])


def test_flags_that_may_be_ignored_are_under_the_checksum() -> None:
    assert decode(sealed(b"\x06", b"\0\1")).message == Statustext(severity=6, text="")


def test_untruncated_zeros_are_accepted() -> None:
    whole = sealed(b"\x06" + b"a".ljust(50, b"\0") + b"\x01\x02\x03")
    expected = Statustext(severity=6, text="a", id=0x0201, chunk_seq=3)
    assert decode(whole).message == expected
    assert decode(sealed(b"\x06a" + bytes(20))).message == Statustext(severity=6, text="a")


def test_known_part_of_a_newer_payload_is_read() -> None:
    longer = sealed(b"\x06" + b"a".ljust(50, b"\0") + b"\x01\x02\x03" + b"new".ljust(201, b"."))
    assert len(longer) == LARGEST_FRAME
    expected = Statustext(severity=6, text="a", id=0x0201, chunk_seq=3)
    assert decode(longer).message == expected


def test_outer_form_is_recognised_without_decoding() -> None:
    assert is_frame(COMMAND_BYTES)
    assert is_frame(COMMAND_BYTES[:-1] + b"\0"), "the checksum is not looked at"
    assert is_frame(b"\xfd\x01".ljust(SMALLEST_FRAME, b"\0"))
    for bad in (
        b"",
        COMMAND_BYTES[:-1],
        COMMAND_BYTES + b"\0",
        b"\xfe" + COMMAND_BYTES[1:],
        b"\xfd\0".ljust(SMALLEST_FRAME - 1, b"\0"),
    ):
        assert not is_frame(bad)
