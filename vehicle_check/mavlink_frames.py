"""The judge's MAVLink: pymavlink's dialect, standard messages that are missing there, signatures.

The layouts are those of mavlink/mavlink, `common.xml` of 2026. They are decoded beside pymavlink's
table of messages, which stays unchanged. Signatures are made here, so that tests can forge them.
"""

import re
from collections.abc import Callable, Mapping
from hashlib import sha256
from pathlib import Path
from struct import Struct
from types import MappingProxyType, SimpleNamespace
from typing import Any, Final, NamedTuple, TypeAlias

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega

from runtime.errors import UserError
from runtime.files import bytes_in

mavlink: Final[Any] = ardupilotmega
MavMessage: TypeAlias = Any
"""A message of pymavlink, which carries no types, or one of `EXTRA`."""

REQUEST_OPERATOR_CONTROL: Final = 32100
NOT_IN_CONTROL: Final = 10
SYSTEM_MANAGER: Final = 1
TAKEOVER_ALLOWED: Final = 2
HEADER_2: Final = 10
SIGNED: Final = 1
SIGNATURE: Final = 13

CODES: Final = MappingProxyType(
    {"char": "s", "uint8_t": "B", "uint16_t": "H", "uint32_t": "I", "int64_t": "q"}
)
Field: TypeAlias = tuple[str, str, int]
"""The type of a field, its name, and its length, which is 0 for a scalar."""


def _code(field: Field) -> str:
    return f"{field[2] or ''}{CODES[field[0]]}"


class MessageLayout(NamedTuple):
    """A message that is missing in pymavlink. Its fields are in the order of the wire."""

    number: int
    name: str
    fields: tuple[Field, ...]
    extensions: tuple[Field, ...] = ()

    @property
    def crc_extra(self) -> int:
        """The byte of the checksum that depends on the layout."""
        text = bytearray(f"{self.name} ".encode())
        for kind, name, length in self.fields:
            text += f"{kind} {name} ".encode() + (bytes([length]) if length else b"")
        checksum = mcrf4xx(bytes(text))
        return checksum & 0xFF ^ checksum >> 8

    @property
    def struct(self) -> Struct:
        """The payload with its extensions."""
        return Struct("<" + "".join(_code(field) for field in (*self.fields, *self.extensions)))

    def decode(self, frame: bytes) -> SimpleNamespace | None:
        """Return the fields of a whole MAVLink 2 frame; None if its checksum is wrong."""
        end = len(frame) - 2 - (SIGNATURE if frame[2] & SIGNED else 0)
        checksum = int.from_bytes(frame[end : end + 2], "little")
        if mcrf4xx(bytes(frame[1:end]) + bytes([self.crc_extra])) != checksum:
            return None
        size = self.struct.size
        payload = bytes(frame[HEADER_2:end])[:size].ljust(size, b"\0")
        values = list(self.struct.unpack(payload))
        found = SimpleNamespace()
        for kind, name, length in (*self.fields, *self.extensions):
            count = length if length and kind != "char" else 1
            taken, values = values[:count], values[count:]
            one = taken[0] if count == 1 else taken
            setattr(found, name, one.rstrip(b"\0") if isinstance(one, bytes) else one)
        return found


class ExtraMessage(mavlink.MAVLink_message):  # type: ignore[misc]
    """A message with one of the layouts, for sending."""

    def __init__(self, layout: MessageLayout, **values: Any) -> None:
        super().__init__(layout.number, layout.name)
        self._layout = layout
        self._values = values

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        """Return the frame; a field that was not given is 0."""
        flat: list[object] = []
        for kind, name, length in (*self._layout.fields, *self._layout.extensions):
            is_array = bool(length) and kind != "char"
            absent: object = b"" if kind == "char" else [0] * length if is_array else 0
            value = self._values.get(name, absent)
            flat.extend(value if is_array else [value])
        payload = self._layout.struct.pack(*flat)
        packed: bytes = self._pack(mav, self._layout.crc_extra, payload, force_mavlink1)
        return packed


TIMESYNC: Final = MessageLayout(
    111, "TIMESYNC", (("int64_t", "tc1", 0), ("int64_t", "ts1", 0)),
    (("uint8_t", "target_system", 0), ("uint8_t", "target_component", 0)),
)  # fmt: skip
COMPONENT_METADATA: Final = MessageLayout(
    397, "COMPONENT_METADATA",
    (("uint32_t", "time_boot_ms", 0), ("uint32_t", "file_crc", 0), ("char", "uri", 100)),
)  # fmt: skip
AVAILABLE_MODES: Final = MessageLayout(
    435, "AVAILABLE_MODES",
    (("uint32_t", "custom_mode", 0), ("uint32_t", "properties", 0), ("uint8_t", "number_modes", 0),
     ("uint8_t", "mode_index", 0), ("uint8_t", "standard_mode", 0), ("char", "mode_name", 35)),
)  # fmt: skip
CURRENT_MODE: Final = MessageLayout(
    436, "CURRENT_MODE",
    (("uint32_t", "custom_mode", 0), ("uint32_t", "intended_custom_mode", 0),
     ("uint8_t", "standard_mode", 0)),
)  # fmt: skip
CONTROL_STATUS: Final = MessageLayout(
    512, "CONTROL_STATUS",
    (("uint8_t", "flags", 0), ("uint8_t", "gcs_main", 0), ("uint8_t", "gcs_secondary", 10)),
)  # fmt: skip
MISSION_CURRENT: Final = MessageLayout(
    42, "MISSION_CURRENT", (("uint16_t", "seq", 0),),
    (("uint16_t", "total", 0), ("uint8_t", "mission_state", 0), ("uint8_t", "mission_mode", 0),
     ("uint32_t", "mission_id", 0), ("uint32_t", "fence_id", 0),
     ("uint32_t", "rally_points_id", 0)),
)  # fmt: skip
MISSION_COUNT: Final = MessageLayout(
    44, "MISSION_COUNT",
    (("uint16_t", "count", 0), ("uint8_t", "target_system", 0), ("uint8_t", "target_component", 0)),
    (("uint8_t", "mission_type", 0), ("uint32_t", "opaque_id", 0)),
)  # fmt: skip
MISSION_ACK: Final = MessageLayout(
    47, "MISSION_ACK",
    (("uint8_t", "target_system", 0), ("uint8_t", "target_component", 0), ("uint8_t", "type", 0)),
    (("uint8_t", "mission_type", 0), ("uint32_t", "opaque_id", 0)),
)  # fmt: skip
EXTRA: Final[Mapping[int, MessageLayout]] = MappingProxyType(
    {
        one.number: one
        for one in (
            TIMESYNC, COMPONENT_METADATA, AVAILABLE_MODES, CURRENT_MODE, CONTROL_STATUS,
            MISSION_CURRENT, MISSION_COUNT, MISSION_ACK,
        )
    }
)  # fmt: skip


UNRELEASED: Final = frozenset(
    one.number for one in (COMPONENT_METADATA, AVAILABLE_MODES, CURRENT_MODE, CONTROL_STATUS)
)
"""Messages that pymavlink 2.4.50 has in no dialect of a ground station, or in development only."""


NUMBERS: Final[Mapping[str, int]] = MappingProxyType(
    {entry.msgname: number for number, entry in mavlink.mavlink_map.items()}
    | {layout.name: number for number, layout in EXTRA.items()}
)
"""The message ids by the names of messages."""


def number_of(frame: bytes) -> int:
    """Return the message id of a whole frame."""
    if frame[0] == mavlink.PROTOCOL_MARKER_V1:
        return frame[5]
    return int.from_bytes(frame[7:10], "little")


KEY_LENGTH: Final = 32
HEXADECIMAL: Final = re.compile("[0-9a-fA-F]{64}")
MAX_PASSPHRASE: Final = 200
MAX_BYTES: Final = 4096
EPOCH_S: Final = 1_420_070_400
"""2015-01-01, from which the time stamps of signatures count units of 10 us."""
UNITS_PER_S: Final = 100_000


class Signer:
    """Signs the frames of one link. `timestamp` grows with each frame, and follows a clock.

    A vehicle refuses new links whose time stamps are more than a minute behind.
    """

    def __init__(
        self, key: bytes, link: int, timestamp: int, clock: Callable[[], int] = lambda: 0
    ) -> None:
        self.key = key
        self.link = link
        self.timestamp = timestamp
        self._clock = clock

    def signed(self, frame: bytes) -> bytes:
        """Return a MAVLink 2 frame with a signature."""
        crc_extra = _crc_extra(frame)
        flagged = bytearray(frame)
        flagged[2] |= 1
        flagged[-2:] = mcrf4xx(bytes(flagged[1:-2]) + bytes([crc_extra])).to_bytes(2, "little")
        self.timestamp = max(self.timestamp + 1, self._clock())
        head = bytes(flagged) + bytes([self.link]) + self.timestamp.to_bytes(6, "little")
        return head + sha256(self.key + head).digest()[:6]


_CRC_EXTRA: Final[dict[bytes, int]] = {}
"""The byte of the layout by message id."""


def _crc_extra(frame: bytes) -> int:
    """Return the byte of the layout with which a frame's checksum was made."""
    number = bytes(frame[7:10])
    if number not in _CRC_EXTRA:
        checksum, body = int.from_bytes(frame[-2:], "little"), bytes(frame[1:-2])
        found = (one for one in range(256) if mcrf4xx(body + bytes([one])) == checksum)
        _CRC_EXTRA[number] = next(found)
    return _CRC_EXTRA[number]


def is_signed_with(frame: bytes, key: bytes) -> bool:
    """Return True if the signature at the end of a frame was made with this key."""
    return sha256(key + frame[:-6]).digest()[:6] == frame[-6:]


def timestamp_at(unix_s: float) -> int:
    """Return the time stamp of a signature."""
    return round((unix_s - EPOCH_S) * UNITS_PER_S)


def read_key(path: Path) -> bytes:
    """Read a key: 32 raw bytes, 64 hexadecimal digits, or a passphrase.

    The key of a passphrase is its SHA-256, as in MAVProxy, Mission Planner and QGroundControl.
    UserError if the file holds none of them.
    """
    try:
        data = bytes_in(path, MAX_BYTES)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}: name a file with a key") from error
    if len(data) == KEY_LENGTH:
        return data
    try:
        text = data.decode("utf-8").strip()
    except UnicodeDecodeError:
        text = ""
    if HEXADECIMAL.fullmatch(text):
        return bytes.fromhex(text)
    if not text or len(text) > MAX_PASSPHRASE or "\n" in text:
        words = "32 bytes, 64 hexadecimal digits, or one line with a passphrase"
        raise UserError(f"{path}: a signing key is {words}")
    return sha256(text.encode()).digest()
