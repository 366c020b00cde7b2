"""Read the dialect: messages and enumerations of sidestep.xml, and those in use of common.xml.

Layouts follow MAVLink 2. On the wire the fields of a message are sorted by the size of their
elements, largest first; extensions follow. crc_extra is a checksum over the layout.

Layouts and numbers of the common dialect are upstream's. The descriptions are our own: this
repository contains no text of upstream's files.
"""

import importlib.util
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final, NamedTuple

from fastcrc.crc16 import mcrf4xx

COMMON_MESSAGES: Final = {
    "HEARTBEAT": "State of the sender, sent periodically from inside its control loop.",
    "SYSTEM_TIME": "Time of the sender's master clock.",
    "PARAM_REQUEST_READ": "Request one parameter, by name (index -1) or by index.",
    "PARAM_REQUEST_LIST": "Request all parameters.",
    "PARAM_VALUE": "Value of a parameter.",
    "PARAM_SET": "Set a parameter.",
    "MISSION_SET_CURRENT": "Select the current item.",
    "MISSION_CURRENT": "Index of the current item.",
    "MISSION_REQUEST_LIST": "Request the mission.",
    "MISSION_COUNT": "Number of items of a mission; starts a transfer.",
    "MISSION_CLEAR_ALL": "Delete the mission.",
    "MISSION_ITEM_REACHED": "An item has been reached.",
    "MISSION_ACK": "Result and end of a mission transfer.",
    "MISSION_REQUEST_INT": "Request one item.",
    "MANUAL_CONTROL": "Joystick axes and buttons, axes -1000 to 1000.",
    "MISSION_ITEM_INT": "One item. For a robot x and y are metres times 10000 in its own frame, "
    "whatever the frame in which a client gave the place.",
    "COMMAND_INT": "Command with a position as integers.",
    "COMMAND_LONG": "Command with seven parameters.",
    "COMMAND_ACK": "Answer to a command; result_param2 is a Reason.",
    "TIMESYNC": "Request for the time (tc1 = 0), or the answer to it.",
    "STATUSTEXT": "Line of text for the operator.",
}
"""Messages in use, each with its description."""

OPTIONAL: Final = {
    "HEARTBEAT": ("mavlink_version",),
    "COMMAND_INT": ("current", "autocontinue", "param1", "param2", "param3", "param4"),
    "COMMAND_LONG": ("confirmation", *(f"param{number}" for number in range(1, 8))),
    "MISSION_ITEM_INT": ("current", "autocontinue"),
}
"""Fields with a default value in Python, besides `target_*` and extensions."""

COMMON_ENUMS: Final[dict[str, tuple[str, ...]]] = {
    "MAV_MISSION_TYPE": ("MISSION", "FENCE"),
    "MAV_CMD": (
        "NAV_WAYPOINT",
        "NAV_LOITER_UNLIM",
        "NAV_LOITER_TIME",
        "NAV_RETURN_TO_LAUNCH",
        "NAV_DELAY",
        "DO_JUMP",
        "DO_CHANGE_SPEED",
        "DO_SET_MODE",
        "DO_FLIGHTTERMINATION",
        "DO_REPOSITION",
        "DO_PAUSE_CONTINUE",
        "DO_SET_MISSION_CURRENT",
        "PREFLIGHT_REBOOT_SHUTDOWN",
        "MISSION_START",
        "COMPONENT_ARM_DISARM",
        "NAV_FENCE_POLYGON_VERTEX_INCLUSION",
        "NAV_FENCE_POLYGON_VERTEX_EXCLUSION",
        "NAV_FENCE_CIRCLE_INCLUSION",
        "NAV_FENCE_CIRCLE_EXCLUSION",
    ),
    "MAV_RESULT": (
        "ACCEPTED",
        "TEMPORARILY_REJECTED",
        "DENIED",
        "UNSUPPORTED",
        "FAILED",
        "IN_PROGRESS",
    ),
    "MAV_SEVERITY": (
        "EMERGENCY",
        "ALERT",
        "CRITICAL",
        "ERROR",
        "WARNING",
        "NOTICE",
        "INFO",
        "DEBUG",
    ),
    "MAV_STATE": (
        "UNINIT",
        "BOOT",
        "CALIBRATING",
        "STANDBY",
        "ACTIVE",
        "CRITICAL",
        "EMERGENCY",
        "POWEROFF",
        "FLIGHT_TERMINATION",
    ),
    "MAV_TYPE": ("GCS", "GROUND_ROVER"),
    "MAV_AUTOPILOT": ("GENERIC", "ARDUPILOTMEGA", "INVALID"),
    "MAV_MODE_FLAG": ("CUSTOM_MODE_ENABLED", "SAFETY_ARMED"),
    "MAV_FRAME": (
        "GLOBAL",
        "GLOBAL_RELATIVE_ALT",
        "LOCAL_ENU",
        "GLOBAL_INT",
        "GLOBAL_RELATIVE_ALT_INT",
        "GLOBAL_TERRAIN_ALT",
        "GLOBAL_TERRAIN_ALT_INT",
        "LOCAL_FLU",
    ),
    "MAV_PARAM_TYPE": ("INT32", "REAL32"),
}
"""Members in use of each enumeration."""


SIDESTEP_XML: Final = Path(__file__).resolve().parents[2] / "protocol" / "dialect" / "sidestep.xml"
CODES: Final = {
    "char": "s",
    "uint8_t": "B",
    "int8_t": "b",
    "uint16_t": "H",
    "int16_t": "h",
    "uint32_t": "I",
    "int32_t": "i",
    "uint64_t": "Q",
    "int64_t": "q",
    "float": "f",
    "double": "d",
}
"""Struct code of each type."""
SIZES: Final = {"s": 1, "B": 1, "b": 1, "H": 2, "h": 2, "I": 4, "i": 4, "f": 4}
"""Size of one element in bytes; 8 for other codes."""
TIMEOUT: Final = "param[@label='Timeout'][@units='ms']"
BEARING: Final = ".//param[@label='Bearing'][@units='deg']"
RIM: Final = ".//param[@label='Rim'][@units='mm']"
PLACE: Final = "enums/enum/entry[@name='MAV_CMD_SIDESTEP_NAV_POSE']/param[@label='X'][@units='m']"
VERSION_TYPE: Final = "uint8_t_mavlink_version"
MAVLINK_VERSION: Final = "3"


class FieldDefinition(NamedTuple):
    """One field of a message.

    `length` is 0 for a scalar. `default` is None if a value is required. `maximum` is the largest
    valid value; empty if only the type limits it. `invalid` is the value of an unknown one.
    """

    name: str
    kind: str
    length: int
    text: str
    units: str
    enum: str
    maximum: str
    invalid: str
    default: str | None
    is_extension: bool

    @property
    def code(self) -> str:
        """Struct code of the type."""
        return CODES[self.kind]

    @property
    def element_size(self) -> int:
        """Size of one element in bytes."""
        return SIZES.get(self.code, 8)


class MessageType(NamedTuple):
    """A message with its fields in the order of the XML."""

    name: str
    number: int
    text: str
    fields: tuple[FieldDefinition, ...]

    @property
    def wire_fields(self) -> list[FieldDefinition]:
        """The fields in wire order."""
        base = [field for field in self.fields if not field.is_extension]
        extensions = [field for field in self.fields if field.is_extension]
        return sorted(base, key=lambda field: -field.element_size) + extensions

    @property
    def crc_extra(self) -> int:
        """Checksum over message name, field types and field names, without extensions."""
        layout = bytearray(f"{self.name} ".encode())
        for field in self.wire_fields:
            if not field.is_extension:
                layout += f"{field.kind} {field.name} ".encode()
                layout += bytes([field.length] if field.length else [])
        checksum = mcrf4xx(bytes(layout))
        return checksum & 0xFF ^ checksum >> 8


class Entry(NamedTuple):
    """One member of an enumeration; its name is without the prefix of the enumeration.

    `timeout_ms` is 0 without a timeout. `is_fixed`: no parameter of the robot replaces it.
    """

    name: str
    value: int
    text: str
    timeout_ms: int = 0
    is_fixed: bool = False

    @property
    def words(self) -> str:
        """The description, with the timeout if it is the same for all robots."""
        if not self.is_fixed:
            return self.text
        ms = self.timeout_ms
        return f"{self.text} for {ms} ms" if ms < 1000 else f"{self.text} for {ms / 1000:g} s"


class EnumType(NamedTuple):
    """An enumeration with its members."""

    name: str
    text: str
    entries: tuple[Entry, ...]


class SonarRing(NamedTuple):
    """The sonar ring: bearings from right to left, one cone apart, and the radius of the robot."""

    first_deg: float
    last_deg: float
    cone_deg: float
    radius_mm: int

    @property
    def sonars(self) -> int:
        """Number of sonars."""
        return round((self.last_deg - self.first_deg) / self.cone_deg) + 1


class Dialect(NamedTuple):
    """All messages in use, sorted by id, and all enumerations in use, by name.

    `place_m`: the unit of the places in mission items.
    """

    messages: tuple[MessageType, ...]
    enums: dict[str, EnumType]
    ring: SonarRing
    place_m: float


def upstream_definitions() -> list[Path]:
    """Return the paths of the installed common.xml and of its includes, innermost last."""
    package = importlib.util.find_spec("pymavlink")
    assert package is not None
    assert package.submodule_search_locations is not None
    folder = Path(next(iter(package.submodule_search_locations))) / "dialects" / "v20"
    return [folder / name for name in ("common.xml", "standard.xml", "minimal.xml")]


def read_dialect() -> Dialect:
    """Read sidestep.xml and the installed files of pymavlink."""
    upstream = [ET.parse(path).getroot() for path in upstream_definitions()]
    own = ET.parse(SIDESTEP_XML).getroot()
    messages = [*_common_messages(upstream), *map(_own_message, own.iter("message"))]
    enums = {enum.name: enum for enum in _common_enums(upstream)}
    for element in own.iter("enum"):
        enum = _enum(element)
        kept = enums[enum.name].entries if enum.name in enums else ()
        enums[enum.name] = enum._replace(entries=(*kept, *enum.entries))
    ordered = tuple(sorted(messages, key=lambda message: message.number))
    return Dialect(ordered, enums, _ring(own), float(_only(own, PLACE)["increment"]))


def _ring(root: ET.Element) -> SonarRing:
    bearing = _only(root, BEARING)
    return SonarRing(
        first_deg=float(bearing["minValue"]),
        last_deg=float(bearing["maxValue"]),
        cone_deg=float(bearing["increment"]),
        radius_mm=int(_only(root, RIM)["default"]),
    )


def _only(root: ET.Element, path: str) -> dict[str, str]:
    """Return the attributes of the one element on a path."""
    (found,) = root.iterfind(path)
    return found.attrib


def _common_messages(roots: Iterable[ET.Element]) -> Iterator[MessageType]:
    for element in _named(roots, "message"):
        name = element.attrib["name"]
        if name in COMMON_MESSAGES:
            text = COMMON_MESSAGES[name]
            fields = tuple(_common_field(name, field) for field in _fields(element))
            yield MessageType(name, int(element.attrib["id"]), text, fields)


def _common_field(message: str, field: FieldDefinition) -> FieldDefinition:
    """Return the field without upstream's texts, and with a default if it may be omitted."""
    default = "0" if field.is_extension or field.name.startswith("target_") else None
    if field.name in OPTIONAL.get(message, ()):
        default = field.default or "0"
    return field._replace(text="", units="", enum="", maximum="", default=default)


def _common_enums(roots: Iterable[ET.Element]) -> Iterator[EnumType]:
    for element in _named(roots, "enum"):
        wanted = COMMON_ENUMS.get(element.attrib["name"], ())
        enum = _enum(element)
        kept = tuple(entry._replace(text="") for entry in enum.entries if entry.name in wanted)
        if kept:
            yield EnumType(enum.name, "", kept)


def _named(roots: Iterable[ET.Element], tag: str) -> Iterator[ET.Element]:
    for root in roots:
        yield from root.iter(tag)


def _own_message(element: ET.Element) -> MessageType:
    name, number = element.attrib["name"], int(element.attrib["id"])
    return MessageType(name, number, _text(element), tuple(_fields(element)))


def _fields(message: ET.Element) -> Iterator[FieldDefinition]:
    is_extension = False
    for element in message:
        if element.tag == "extensions":
            is_extension = True
        elif element.tag == "field":
            yield _field(element, is_extension)


def _field(element: ET.Element, is_extension: bool) -> FieldDefinition:
    kind, _, length = element.attrib["type"].rstrip("]").partition("[")
    default = element.get("default")
    if kind == VERSION_TYPE:
        kind, default = "uint8_t", MAVLINK_VERSION
    return FieldDefinition(
        name=element.attrib["name"],
        kind=kind,
        length=int(length or 0),
        text=(element.text or "").strip(),
        units=element.get("units", ""),
        enum=element.get("enum", ""),
        maximum=element.get("maxValue", ""),
        invalid=element.get("invalid", ""),
        default=default,
        is_extension=is_extension,
    )


def _enum(element: ET.Element) -> EnumType:
    name = element.attrib["name"]
    entries = tuple(entry_in(entry, f"{name}_") for entry in element.iter("entry"))
    return EnumType(name, _text(element), entries)


def entry_in(element: ET.Element, prefix: str = "") -> Entry:
    """Return a member; its timeout is the maxValue, or the default, of its parameter."""
    name, value = element.attrib["name"].removeprefix(prefix), int(element.attrib["value"], 0)
    timeout = element.find(TIMEOUT)
    if timeout is None:
        return Entry(name, value, _text(element))
    fixed_ms = timeout.get("maxValue")
    ms = int(fixed_ms or timeout.attrib["default"])
    return Entry(name, value, _text(element), ms, fixed_ms is not None)


def _text(element: ET.Element) -> str:
    return (element.findtext("description") or "").strip()
