"""A client of the parameter protocol, and the format of `param.pck`."""

from dataclasses import dataclass, field
from struct import Struct, error
from typing import Any, Final, NamedTuple

from runtime.units import NS_PER_S
from vehicle_check.dialect import mavlink
from vehicle_check.session import Client

QUIET_S: Final = 0.5
GIVE_UP_S: Final = 5.0
"""After so long without any parameter the vehicle has none left to send."""
NO_INDEX: Final = 0xFFFF
AT_ONCE: Final = 50
MAX_PARAMETERS: Final = 10_000
PCK_HEADER: Final = Struct("<HHH")
PCK_MAGIC: Final = 0x671B
PCK_MAGIC_DEFAULTS: Final = 0x671C
PCK_VALUES: Final = {1: Struct("<b"), 2: Struct("<h"), 3: Struct("<i"), 4: Struct("<f")}
HAS_DEFAULT: Final = 1


class Value(NamedTuple):
    """A parameter from PARAM_VALUE."""

    position: int
    value: float
    kind: int


@dataclass
class ParameterList:
    """The whole list of one client."""

    values: dict[str, Value] = field(default_factory=dict)
    count: int = 0
    seconds: float = 0.0

    @property
    def is_whole(self) -> bool:
        """True if every index has arrived."""
        indexes = {one.position for one in self.values.values()}
        return bool(self.count) and indexes >= set(range(self.count))

    def take(self, message: Any) -> None:
        """Store a PARAM_VALUE; the answer to a single request may have no index."""
        name = name_of(message)
        self.count = min(int(message.param_count), MAX_PARAMETERS)
        index = int(message.param_index)
        if index == NO_INDEX and name in self.values:
            index = self.values[name].position
        self.values[name] = Value(index, float(message.param_value), int(message.param_type))


def name_of(message: Any) -> str:
    """Return the name of a parameter."""
    name = message.param_id
    text = name.decode("ascii", "replace") if isinstance(name, bytes) else str(name)
    return text.rstrip("\0")


def download(client: Client, within_s: float = 8.0) -> ParameterList:
    """Request the whole list, then missing parameters, 50 at a time, as DroneKit does."""
    station = client.station
    target = station.address
    start_ns = station.now_ns
    found, since = ParameterList(), client.mark()
    client.send(mavlink.MAVLink_param_request_list_message(*target))
    end_ns = start_ns + round(within_s * NS_PER_S)
    while station.now_ns < end_ns and not found.is_whole:
        if station.now_ns - start_ns > (found.seconds + GIVE_UP_S) * NS_PER_S:
            break
        if client.expect("PARAM_VALUE", QUIET_S, since=since) is None:
            if not found.count:
                client.send(mavlink.MAVLink_param_request_list_message(*target))
            for index in missing(found)[:AT_ONCE]:
                client.send(mavlink.MAVLink_param_request_read_message(*target, b"", index))
        for one in client.heard("PARAM_VALUE", since):
            found.take(one.message)
            found.seconds = (one.at_ns - start_ns) / NS_PER_S
        since = client.mark()
    return found


def missing(found: ParameterList) -> list[int]:
    """Return the indexes that have not arrived."""
    return sorted(set(range(found.count)) - {one.position for one in found.values.values()})


def read(client: Client, name: str = "", index: int = -1) -> Any:
    """Read one parameter by its name or index; return PARAM_VALUE or None."""
    station = client.station
    target = station.address
    message = mavlink.MAVLink_param_request_read_message(*target, name.encode(), index)

    def is_it(one: Any) -> bool:
        return name_of(one) == name if index < 0 else one.param_index == index

    found = client.ask(message, "PARAM_VALUE", is_it)
    return None if found is None else found.message


def write(client: Client, name: str, value: float, kind: int) -> Any:
    """Set one parameter; return the PARAM_VALUE of the answer, or None."""
    station = client.station
    target = station.address
    message = mavlink.MAVLink_param_set_message(*target, name.encode(), value, kind)
    found = client.ask(message, "PARAM_VALUE", lambda one: name_of(one) == name)
    return None if found is None else found.message


class Packed(NamedTuple):
    """The contents of `param.pck`."""

    magic: int
    given: int
    total: int
    values: dict[str, float]
    defaults: dict[str, float]


def unpacked(data: bytes) -> Packed | None:
    """Parse a `param.pck` of ArduPilot; None if it is malformed."""
    values: dict[str, float] = {}
    defaults: dict[str, float] = {}
    try:
        magic, count, total = PCK_HEADER.unpack_from(data)
        if magic not in (PCK_MAGIC, PCK_MAGIC_DEFAULTS):
            return None
        at, name = PCK_HEADER.size, b""
        while at < len(data):
            if data[at] == 0:
                at += 1
                continue
            layout = PCK_VALUES[data[at] & 0x0F]
            common, length = data[at + 1] & 0x0F, (data[at + 1] >> 4) + 1
            name = name[:common] + data[at + 2 : at + 2 + length]
            has_default = data[at] >> 4 & HAS_DEFAULT
            at += 2 + length
            values[name.decode("ascii")] = layout.unpack_from(data, at)[0]
            at += layout.size
            if has_default:
                defaults[name.decode("ascii")] = layout.unpack_from(data, at)[0]
                at += layout.size
    except (error, KeyError, IndexError, UnicodeDecodeError):
        return None
    return Packed(magic, count, total, values, defaults)
