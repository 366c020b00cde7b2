"""The MAVLink dialect of the gateway: pymavlink's ardupilotmega, and missing standard messages.

pymavlink 2.4.50 has COMPONENT_METADATA and CONTROL_STATUS in no dialect, and AVAILABLE_MODES and
CURRENT_MODE only in `development`; its TIMESYNC has no target fields, and its mission messages have
no plan ids. Their layouts here are those of mavlink/mavlink of July 2026.
"""

from collections.abc import Callable, Sequence
from struct import Struct
from typing import Any, Final, TypeAlias

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega

mavlink: Final[Any] = ardupilotmega
MavMessage: TypeAlias = Any
"""A message of pymavlink, which carries no types."""

REQUEST_OPERATOR_CONTROL: Final = 32100
RESULT_NOT_IN_CONTROL: Final = 10
CONTROL_SYSTEM_MANAGER: Final = 1
CONTROL_TAKEOVER_ALLOWED: Final = 2

CODES: Final = {"char": "s", "uint8_t": "B", "uint16_t": "H", "uint32_t": "I", "int64_t": "q"}
"""Struct code of each type in use; in the order of their sizes on the wire, reversed."""


Field: TypeAlias = tuple[str, str, int]
"""The type of a field, its name, and its length, which is 0 for a scalar."""


def _defined(number: int, name: str, *fields: Field, extensions: tuple[Field, ...] = ()) -> Any:
    """Return a message class like those that mavgen writes, and register it for decoding.

    On the wire the fields are sorted by the size of their elements, largest first. Extensions
    follow in their own order, do not count for the checksum, and are 0 if they are not given.
    """
    main = sorted(fields, key=lambda field: -Struct(CODES[field[0]]).size)
    ordered, fields = [*main, *extensions], (*fields, *extensions)
    names = [field_name for _, field_name, _ in fields]
    ordered_names = [field_name for _, field_name, _ in ordered]
    codes = (f"{length or ''}{CODES[kind]}" for kind, _, length in ordered)
    facts = {
        "id": number,
        "msgname": name,
        "fieldnames": names,
        "ordered_fieldnames": ordered_names,
        "fieldtypes": [kind for kind, _, _ in fields],
        "native_format": bytearray(b"<" + "".join(CODES[kind] for kind, _, _ in ordered).encode()),
        "orders": [ordered_names.index(field_name) for field_name in names],
        "lengths": [1 if kind == "char" or not length else length for kind, _, length in ordered],
        "array_lengths": [length for _, _, length in ordered],
        "crc_extra": _crc_extra(name, main),
        "unpacker": Struct("<" + "".join(codes)),
        "__init__": _constructor(number, name, names, {one[1]: 0 for one in extensions}),
        "pack": _packer(ordered),
    }
    defined = type(f"MAVLink_{name.lower()}_message", (mavlink.MAVLink_message,), facts)
    mavlink.mavlink_map[number] = defined
    return defined


def _crc_extra(name: str, main: Sequence[Field]) -> int:
    layout = bytearray(f"{name} ".encode())
    for kind, field_name, length in main:
        layout += f"{kind} {field_name} ".encode() + (bytes([length]) if length else b"")
    checksum = mcrf4xx(bytes(layout))
    return checksum & 0xFF ^ checksum >> 8


def _constructor(
    number: int, name: str, names: list[str], absent: dict[str, Any]
) -> Callable[..., None]:
    def construct(self: Any, *values: object, **named: object) -> None:
        mavlink.MAVLink_message.__init__(self, number, name)
        self._fieldnames = names
        given = absent | dict(zip(names, values, strict=False)) | named
        for field_name in names:
            setattr(self, field_name, given[field_name])

    return construct


def _packer(ordered: Sequence[Field]) -> Callable[..., bytes]:
    def pack(self: Any, mav: Any, force_mavlink1: bool = False) -> bytes:
        flat: list[object] = []
        for kind, field_name, length in ordered:
            value = getattr(self, field_name)
            flat.extend(value) if length and kind != "char" else flat.append(value)
        payload = self.unpacker.pack(*flat)
        packed: bytes = self._pack(mav, self.crc_extra, payload, force_mavlink1=force_mavlink1)
        return packed

    return pack


ComponentMetadata: Final = _defined(
    397, "COMPONENT_METADATA", ("uint32_t", "time_boot_ms", 0), ("uint32_t", "file_crc", 0),
    ("char", "uri", 100),
)  # fmt: skip
AvailableModes: Final = _defined(
    435, "AVAILABLE_MODES", ("uint8_t", "number_modes", 0), ("uint8_t", "mode_index", 0),
    ("uint8_t", "standard_mode", 0), ("uint32_t", "custom_mode", 0), ("uint32_t", "properties", 0),
    ("char", "mode_name", 35),
)  # fmt: skip
CurrentMode: Final = _defined(
    436, "CURRENT_MODE", ("uint8_t", "standard_mode", 0), ("uint32_t", "custom_mode", 0),
    ("uint32_t", "intended_custom_mode", 0),
)  # fmt: skip
ControlStatus: Final = _defined(
    512, "CONTROL_STATUS", ("uint8_t", "flags", 0), ("uint8_t", "gcs_main", 0),
    ("uint8_t", "gcs_secondary", 10),
)  # fmt: skip
TimeSync: Final = _defined(
    111, "TIMESYNC", ("int64_t", "tc1", 0), ("int64_t", "ts1", 0),
    extensions=(("uint8_t", "target_system", 0), ("uint8_t", "target_component", 0)),
)  # fmt: skip
MissionCurrent: Final = _defined(
    42, "MISSION_CURRENT", ("uint16_t", "seq", 0),
    extensions=(
        ("uint16_t", "total", 0), ("uint8_t", "mission_state", 0), ("uint8_t", "mission_mode", 0),
        ("uint32_t", "mission_id", 0), ("uint32_t", "fence_id", 0),
        ("uint32_t", "rally_points_id", 0),
    ),
)  # fmt: skip
MissionCount: Final = _defined(
    44, "MISSION_COUNT", ("uint8_t", "target_system", 0), ("uint8_t", "target_component", 0),
    ("uint16_t", "count", 0),
    extensions=(("uint8_t", "mission_type", 0), ("uint32_t", "opaque_id", 0)),
)  # fmt: skip
MissionAck: Final = _defined(
    47, "MISSION_ACK", ("uint8_t", "target_system", 0), ("uint8_t", "target_component", 0),
    ("uint8_t", "type", 0),
    extensions=(("uint8_t", "mission_type", 0), ("uint32_t", "opaque_id", 0)),
)  # fmt: skip
