"""Clients of the parameter protocol, the mission protocol and FTP, like those of ground stations.

Parameters are also read from `param.pck`; files come in bursts, then missing blocks.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from struct import Struct, error
from typing import Any, Final, NamedTuple

from runtime.units import NS_PER_S
from vehicle_check.ground_stations import Elapsed, GroundStation, ReceivedMessage
from vehicle_check.mavlink_frames import mavlink

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
class ListedParameters:
    """The whole list of one client."""

    values: dict[str, Value] = field(default_factory=dict)
    count: int = 0
    elapsed: Elapsed = field(default_factory=lambda: Elapsed(0.0))

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


def download_parameters(client: GroundStation, within_s: float = 8.0) -> ListedParameters:
    """Request the whole list, then missing parameters, 50 at a time, as DroneKit does."""
    station = client.station
    target = station.address
    stopwatch = station.stopwatch()
    found, since = ListedParameters(), client.mark()
    client.send(mavlink.MAVLink_param_request_list_message(*target))
    while (seconds := stopwatch.elapsed.seconds) < within_s and not found.is_whole:
        if seconds > found.elapsed.seconds + GIVE_UP_S:
            break
        if client.expect("PARAM_VALUE", QUIET_S, since=since) is None:
            if not found.count:
                client.send(mavlink.MAVLink_param_request_list_message(*target))
            for index in missing(found)[:AT_ONCE]:
                client.send(mavlink.MAVLink_param_request_read_message(*target, b"", index))
        for one in client.heard("PARAM_VALUE", since):
            found.take(one.message)
            found.elapsed = stopwatch.elapsed
        since = client.mark()
    return found


def missing(found: ListedParameters) -> list[int]:
    """Return the indexes that have not arrived."""
    return sorted(set(range(found.count)) - {one.position for one in found.values.values()})


def read_parameter(client: GroundStation, name: str = "", index: int = -1) -> Any:
    """Read one parameter by its name or index; return PARAM_VALUE or None."""
    station = client.station
    target = station.address
    message = mavlink.MAVLink_param_request_read_message(*target, name.encode(), index)

    def is_it(one: Any) -> bool:
        return name_of(one) == name if index < 0 else one.param_index == index

    found = client.ask(message, "PARAM_VALUE", is_it)
    return None if found is None else found.message


def write(client: GroundStation, name: str, value: float, kind: int) -> Any:
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


MISSION: Final = mavlink.MAV_MISSION_TYPE_MISSION
FENCE: Final = mavlink.MAV_MISSION_TYPE_FENCE
RALLY: Final = mavlink.MAV_MISSION_TYPE_RALLY
REQUESTS: Final = ("MISSION_REQUEST", "MISSION_REQUEST_INT")
REQUEST_ITEM: Final = mavlink.MAVLink_mission_request_int_message
DEGREES_E7: Final = 1e7
MAX_ITEMS: Final = 2_000
ANSWER_S: Final = 1.0
QUIET_TWICE: Final = 2
UPLOAD_S: Final = 6.0
UPLOAD_WITH_LOSS_S: Final = 30.0
RELATIVE: Final = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT


class PlanItem(NamedTuple):
    """One item of a plan; `x` and `y` are latitude and longitude in 1e-7 degrees."""

    command: int
    x: int
    y: int
    frame: int = RELATIVE
    params: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    z: float = 0.0


@dataclass
class UploadResult:
    """The result of an upload."""

    result: int | None = None
    opaque_id: int = 0
    requests: list[tuple[str, int]] = field(default_factory=list)
    may_be_old: bool = False
    """True on a lossy line: a vehicle may send the result of an earlier upload again."""
    is_first: bool = True
    """True until a refusal has been ignored as such a copy."""


def message_of(
    client: GroundStation,
    item: PlanItem,
    seq: int,
    kind: int,
    *,
    as_float: bool = False,
    current: int = 0,
) -> Any:
    """Return MISSION_ITEM_INT, or MISSION_ITEM."""
    station = client.station
    head = (*station.address, seq, item.frame, item.command, current, 1)
    if as_float:
        place = (item.x / DEGREES_E7, item.y / DEGREES_E7, item.z)
        return mavlink.MAVLink_mission_item_message(*head, *item.params, *place, kind)
    place = (item.x, item.y, item.z)
    return mavlink.MAVLink_mission_item_int_message(*head, *item.params, *place, kind)


def count_message(client: GroundStation, count: int, kind: int) -> Any:
    """Return MISSION_COUNT."""
    station = client.station
    return mavlink.MAVLink_mission_count_message(*station.address, count, kind)


def upload_plan(
    client: GroundStation,
    items: Sequence[PlanItem],
    kind: int = MISSION,
    *,
    as_float: bool = False,
    ignored: int | None = None,
) -> UploadResult:
    """Send a plan as the vehicle requests it; the first request for item `ignored` is not answered.

    The result is that of MISSION_ACK, None without one. With loss the announcement and the last
    item are sent again, as MAVSDK and MAVProxy do.
    """
    station, found = client.station, UploadResult(may_be_old=client.station.is_lossy)
    within_s = UPLOAD_WITH_LOSS_S if station.is_lossy else UPLOAD_S
    end_ns = station.now_ns + round(within_s * NS_PER_S)
    since, quiet, last = client.mark(), 0, len(items) - 1

    def send(seq: int) -> None:
        if seq <= last:
            client.send(message_of(client, items[seq], seq, kind, as_float=as_float))

    client.send(count_message(client, len(items), kind))
    while station.now_ns < end_ns and found.result is None:
        heard = station.wait(ANSWER_S, lambda: _has_traffic(client, since, kind))  # noqa: B023
        quiet = 0 if heard else quiet + 1
        if not heard and not found.requests:
            client.send(count_message(client, len(items), kind))
        elif not heard and station.is_lossy:
            # A vehicle asks for an item again by itself, but not behind the last one.
            asked = found.requests[-1][1]
            if asked != ignored and (asked == last or quiet >= QUIET_TWICE):
                send(asked)
        elif not heard and ignored is None:
            break
        taken, since = client.log[since:], client.mark()
        for seq in _taken(found, _of_kind(taken, kind), last, ignored):
            send(seq)
    return found


def _taken(
    found: UploadResult, frames: Sequence[ReceivedMessage], last: int, ignored: int | None
) -> list[int]:
    """Note what the vehicle has sent; return the items to send, without one to ignore once."""
    wanted = []
    for one in frames:
        if one.name in REQUESTS:
            seq = int(one.message.seq)
            if seq != ignored or seq in [at for _, at in found.requests]:
                wanted.append(seq)
            found.requests.append((one.name, seq))
        elif one.name == "MISSION_ACK" and _is_old(found, one, last):
            found.is_first = False
        elif one.name == "MISSION_ACK":
            found.result, found.opaque_id = int(one.message.type), int(one.message.opaque_id)
    return wanted


def _is_old(found: UploadResult, ack: ReceivedMessage, last: int) -> bool:
    """Return whether an acknowledgement is a copy of that of an earlier upload.

    An acceptance before the last item was requested is one, and so may be a first refusal.
    """
    if not found.may_be_old:
        return False
    if ack.message.type == mavlink.MAV_MISSION_ACCEPTED:
        return last not in [seq for _, seq in found.requests]
    return found.is_first and not found.requests


def _of_kind(frames: Sequence[ReceivedMessage], kind: int) -> list[ReceivedMessage]:
    """Return the frames of one kind of plan that have reached the ground station."""
    return [
        one for one in frames if not one.is_lost and getattr(one.message, "mission_type", 0) == kind
    ]


def _has_traffic(client: GroundStation, since: int, kind: int) -> bool:
    names = (*REQUESTS, "MISSION_ACK")
    return any(one.name in names for one in _of_kind(client.log[since:], kind))


class DownloadedPlan(NamedTuple):
    """A plan of the vehicle."""

    items: list[PlanItem]
    opaque_id: int
    names: list[str]


def download_plan(
    client: GroundStation, kind: int = MISSION, *, as_float: bool = False
) -> DownloadedPlan | None:
    """Download a plan; None if the vehicle does not send it."""
    station = client.station
    target = station.address
    ask = mavlink.MAVLink_mission_request_list_message(*target, kind)
    count = client.ask(ask, "MISSION_COUNT", lambda one: one.mission_type == kind, ANSWER_S)
    if count is None or count.message.count > MAX_ITEMS:
        return None
    items, names = [], []
    name = "MISSION_ITEM" if as_float else "MISSION_ITEM_INT"
    request = "mission_request" if as_float else "mission_request_int"
    make = getattr(mavlink, f"MAVLink_{request}_message")
    for seq in range(count.message.count):
        answer = client.ask(make(*target, seq, kind), name, _numbered(seq), ANSWER_S)
        if answer is None:
            return None
        one = answer.message
        scale = DEGREES_E7 if as_float else 1
        params = (one.param1, one.param2, one.param3, one.param4)
        place = round(one.x * scale), round(one.y * scale)
        items.append(PlanItem(one.command, *place, one.frame, params, one.z))
        names.append(answer.name)
    client.send(mavlink.MAVLink_mission_ack_message(*target, 0, kind))
    return DownloadedPlan(items, int(count.message.opaque_id), names)


def _numbered(seq: int) -> Any:
    return lambda one: one.seq == seq


def clear_plan(client: GroundStation, kind: int) -> int | None:
    """Delete a plan; return the result of MISSION_ACK."""
    station = client.station
    target = station.address
    message = mavlink.MAVLink_mission_clear_all_message(*target, kind)
    found = client.ask(message, "MISSION_ACK", lambda one: one.mission_type == kind, 2.0)
    return None if found is None else int(found.message.type)


TERMINATE: Final = 1
RESET: Final = 2
LIST: Final = 3
OPEN: Final = 4
READ: Final = 5
CRC32: Final = 14
BURST: Final = 15
ACK: Final = 128
NAK: Final = 129
END_OF_FILE: Final = 6
FILE_NOT_FOUND: Final = 10
HEADER: Final = Struct("<HBBBBBxI")
MAX_DATA: Final = 239
MAX_FILE: Final = 4_000_000
FTP_QUIET_S: Final = 0.3


class FileReply(NamedTuple):
    """An answer of the server."""

    sequence: int
    session: int
    opcode: int
    size: int
    request: int
    is_last: bool
    offset: int
    data: bytes

    @property
    def is_ack(self) -> bool:
        """True unless the server refuses."""
        return self.opcode == ACK

    @property
    def error(self) -> int:
        """The code of a refusal."""
        return self.data[0] if self.opcode == NAK and self.data else 0


def reply_of(payload: list[int]) -> FileReply:
    """Return the fields of a payload."""
    raw = bytes(payload)
    sequence, session, opcode, size, request, last, offset = HEADER.unpack_from(raw)
    data = raw[HEADER.size : HEADER.size + min(size, MAX_DATA)]
    return FileReply(sequence, session, opcode, size, request, bool(last), offset, data)


class FileClient:
    """FTP of one ground station."""

    def __init__(self, client: GroundStation) -> None:
        self._client = client
        self._sequence = 0

    def request(
        self, opcode: int, data: bytes = b"", *, session: int = 0, offset: int = 0, size: int = 0
    ) -> FileReply | None:
        """Send a request and return its answer; repeat it with the same number if frames drop."""
        self._sequence = (self._sequence + 1) & 0xFFFF
        expected = (self._sequence + 1) & 0xFFFF
        message = self._message(opcode, data, session, offset, size)
        within_s = 0.25 if self._client.station.is_lossy else 1.0

        def is_answer(one: object) -> bool:
            reply = reply_of(one.payload)  # type: ignore[attr-defined]
            return reply.sequence == expected and reply.request == opcode

        found = self._client.ask(message, "FILE_TRANSFER_PROTOCOL", is_answer, within_s)
        self._sequence = expected
        return None if found is None else reply_of(found.message.payload)

    def fetch(
        self, path: str, chunk: int = MAX_DATA, within_s: float = 5.0, at_most: int | None = None
    ) -> bytes | None:
        """Return a whole file or its start, None if it cannot be read in time."""
        end_ns = self._client.station.now_ns + round(within_s * NS_PER_S)
        opened = self.request(OPEN, path.encode())
        if opened is None or not opened.is_ack or len(opened.data) < 4:
            return None
        size = int.from_bytes(opened.data[:4], "little")
        if at_most is not None and size > at_most:
            found = self._filled(opened.session, {}, at_most, end_ns)
            self.request(TERMINATE, session=opened.session)
            return found
        if size > MAX_FILE:
            return None
        parts = self.burst(opened.session, size, chunk)
        found = self._filled(opened.session, parts, size, end_ns)
        self.request(TERMINATE, session=opened.session)
        return found

    def burst(self, session: int, size: int, chunk: int) -> dict[int, bytes]:
        """Request a burst from the start; return the blocks that arrive, by offset."""
        parts: dict[int, bytes] = {}
        self._sequence = (self._sequence + 1) & 0xFFFF
        since = self._client.mark()
        self._client.send(self._message(BURST, b"", session, 0, chunk))
        name = "FILE_TRANSFER_PROTOCOL"
        while sum(map(len, parts.values())) < size:
            if self._client.expect(name, FTP_QUIET_S, since=since) is None:
                break
            arrived, since = self._client.heard(name, since), self._client.mark()
            for one in arrived:
                reply = reply_of(one.message.payload)
                if reply.is_ack and reply.request == BURST and reply.data:
                    parts[reply.offset] = reply.data
        self._sequence = (self._sequence + 4096) & 0xFFFF
        return parts

    def _filled(
        self, session: int, parts: dict[int, bytes], size: int, end_ns: int
    ) -> bytes | None:
        found = bytearray()
        while len(found) < size:
            offset = len(found)
            part = parts.get(offset)
            if part is None:
                if self._client.station.now_ns > end_ns:
                    return None
                wanted = min(MAX_DATA, size - offset)
                reply = self.request(READ, session=session, offset=offset, size=wanted)
                if reply is None or not reply.is_ack or not reply.data:
                    return None
                part = reply.data
            found += part
        return bytes(found)

    def _message(self, opcode: int, data: bytes, session: int, offset: int, size: int) -> object:
        length = len(data) if data else size
        head = HEADER.pack(self._sequence, session, opcode, min(length, 255), 0, 0, offset)
        payload = list((head + data).ljust(251, b"\0"))
        station = self._client.station
        target = station.address
        return mavlink.MAVLink_file_transfer_protocol_message(0, *target, payload)
