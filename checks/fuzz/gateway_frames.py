"""Decoders of the gateway to fuzz: frames of any bytes, any payloads, and signed traffic.

Traffic is signed, forged and unsigned frames of four peers and two systems, through the whole
gateway. Its robot is simulated: it accepts, refuses or does not answer.
"""

import asyncio
import json
from collections import deque
from collections.abc import Sequence
from contextlib import closing
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

from fastcrc.crc16 import mcrf4xx

from checks.harness.messages import make
from checks.harness.played_gateway import PlayedEndpoint, PlayedGateway, PlayedWork
from gateways.mavlink.clients import ClientLink
from gateways.mavlink.coordinates import DEFAULT_ORIGIN, place_of
from gateways.mavlink.ftp_messages import HEADER as FILE_HEADER
from gateways.mavlink.ftp_messages import Opcode
from gateways.mavlink.mav_service import Sender
from gateways.mavlink.mav_vehicle import Face, MavVehicle
from gateways.mavlink.mavlink_dialect import (
    REQUEST_OPERATOR_CONTROL,
    MavMessage,
    MissionCount,
    mavlink,
)
from gateways.mavlink.robot_port import Answered, Refusal, Snapshot, StopPress, permitted
from gateways.mavlink.services import face_of
from gateways.mavlink.signing import EPOCH_S, PER_S, STAMP_NS, Policy, SigningGuard
from ground.client.missions import TransferOutcome
from ground.client.outcomes import Accepted, Operation, Outcome, Refused
from ground.client.parameter import parameters_in
from ground.commands.fence import ClearFence, FenceShown, SetFence, ShowFence
from ground.commands.mission import ClearMission, FetchMission, MissionFetched, UploadMission
from ground.commands.param import ParameterTable, ShowParameters
from ground.missions.mission import Circle, Mission, Waypoint
from ground.missions.transfer import Verdict
from ground.user.mavlink_keys import KeyRing, SigningKey
from protocol.wire.enums import GoalState, LeaseAction, MissionState, Mode, Navigator
from protocol.wire.enums import Vehicle as State
from protocol.wire.messages import (
    GatewayStatus,
    MissionStatus,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
    Statustext,
)
from protocol.wire.reasons import Reason
from robot.core.parameters import DEFAULTS
from robot.parameter_table import described
from runtime.clock import ManualClock
from runtime.units import NS_PER_S

SILENT, ARMED = 0x20, 0x40
"""Bits of the flags: no telemetry arrives, the robot is armed. Bits 3 and 4 choose the answer."""
ANSWERS: Final[tuple[Answered | None, ...]] = (
    Answered(Accepted(1)),
    Answered(Refused(Reason.LEASE_HELD, 1)),
    Answered(None, "r1 does not answer"),
    None,
)
SCAN: Final = SonarScan(
    time_ns=5, seq=1, range_mm=(900,) * 8, ping_age_us=(20_000,) * 8, valid=255, echo=60
)
PLACE: Final = dict.fromkeys(PlanarOdometry.__struct_fields__, 0.25)
STATUS: Final[dict[str, Any]] = dict.fromkeys(NavigatorStatus.__struct_fields__, 0) | {
    "ended_by": "",
    "held_by": "",
    "mode": Mode.GUIDED,
    "goal": GoalState.NONE,
    "navigator": Navigator.VGM,
    "side": 1,
}
MISSION: Final = make(MissionStatus, time_ns=5, mission_id=1, count=2, state=MissionState.READY)
WAYPOINTS: Final = (Waypoint(x_m=1.0, y_m=2.0), Waypoint(x_m=3.0, y_m=4.0, heading_deg=90.0))
KEPT: Final = TransferOutcome(verdict=Verdict(Reason.NONE, None, 1), done="")
MISSION_ANSWERS: Final[dict[type, Outcome]] = {
    FetchMission: MissionFetched(Mission(waypoints=WAYPOINTS)),
    ShowFence: FenceShown(Circle(x_m=0.0, y_m=0.0, radius_m=5.0)),
    **dict.fromkeys((UploadMission, ClearMission, SetFence, ClearFence), KEPT),
}


class AnsweringRobot:
    """A robot whose answers depend on the flags of the last message."""

    name = "r1"
    identity = "gateway/1"
    is_busy = False
    work: PlayedWork

    def __init__(self) -> None:
        self.flags = 0
        self._waiting: deque[tuple[asyncio.Future[Answered], Operation[Any] | None]] = deque()

    def snapshot(self, now_ns: int) -> Snapshot:
        """Return telemetry, or none of it."""
        if self.flags & SILENT:
            return Snapshot(now_ns)
        state = State.ACTIVE if self.flags & ARMED else State.STANDBY
        status = NavigatorStatus(**{**STATUS, "time_ns": now_ns, "vehicle": state})
        place = PlanarOdometry(**{**PLACE, "time_ns": now_ns})  # type: ignore[arg-type]
        return Snapshot(now_ns, status=status, odometry=place, scan=SCAN, mission=MISSION)

    def need_wheels(self, now_ns: int) -> None:
        """Do nothing: there are no encoders."""

    def new_texts(self) -> list[Statustext]:
        """Return no texts."""
        return []

    async def perform(
        self, operation: Operation[Any], name: str = "", refusal: Refusal = permitted
    ) -> Answered:
        """Keep the request."""
        return await self._kept(operation)

    async def change_lease(self, action: LeaseAction, name: str) -> Answered:
        """Keep the request."""
        return await self._kept(None)

    def stop(self) -> StopPress:
        """Keep the request."""
        return StopPress(len(self._waiting) + 1, self._kept(None))

    def _kept(self, operation: Operation[Any] | None) -> asyncio.Future[Answered]:
        end: asyncio.Future[Answered] = asyncio.get_running_loop().create_future()
        self._waiting.append((end, operation))
        return end

    def heartbeat(self) -> None:
        """Ignore the heartbeat."""

    def drive(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        """Ignore the speeds."""

    def report(self, status: GatewayStatus) -> None:
        """Ignore the state of the gateway."""

    def deliver(self) -> None:
        """Answer the waiting requests."""
        answer = ANSWERS[self.flags >> 3 & 3]
        for _ in range(len(self._waiting) if answer is not None else 0):
            end, operation = self._waiting.popleft()
            assert answer is not None, "checked above"
            end.set_result(accepted(operation) if answer is ANSWERS[0] else answer)


def accepted(operation: Operation[Any] | None) -> Answered:
    """Return the answer of a robot that accepts."""
    if isinstance(operation, ShowParameters):
        return Answered(LIST)
    return Answered(MISSION_ANSWERS.get(type(operation), Accepted(1)))


LIST: Final = ParameterTable(tuple(parameters_in(json.dumps(described(DEFAULTS)))))


def new_face(
    folder: Path | None = None, guard: SigningGuard | None = None
) -> tuple[Face, AnsweringRobot]:
    """Return a vehicle with two clients."""
    robot = AnsweringRobot()
    vehicle = MavVehicle(1, robot, DEFAULT_ORIGIN, 0)
    robot.work = PlayedWork(vehicle)
    face = face_of(vehicle, folder, guard)
    for client in (1, 2):
        face.join(client)
    return face, robot


MAX_RECORDS: Final = 40
MAX_FRAMES: Final = 256
GUARD: Final = SigningGuard(lambda: 0)
ROUND_NS: Final = 20_000_000
ROUNDS: Final = (0, 1, 5, 60)
"""Rounds of the gateway after a message, by the lowest bits of its flags."""
SOME_ROUNDS: Final = 2
OTHER_CLIENT, AS_SENT = 0x04, 0x80
RECORDING: Final = "20261123T131200Z-r1.tlog"
PATHS: Final = (
    b"",
    b"/",
    b"@PARAM",
    b"@PARAM/param.pck",
    b"@PARAM/param.pck?withdefaults=1&start=3&count=5",
    b"recordings",
    b"/recordings/" + RECORDING.encode(),
    b"@MAV_LOG",
    b"general.json.xz",
)
HEADER_BYTES, CHECKSUM_BYTES, MAX_COMMAND = 10, 2, 0xFFFF
FTP: Final = mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL
"""Requests of files are repeated among the kinds, as they have many forms."""


def kinds() -> tuple[int, ...]:
    """Return the ids of all messages that some protocol takes."""
    face, _ = new_face()
    return tuple(sorted(face.handles)) + (FTP,) * 4


KINDS: Final = kinds()


def framed(number: int, payload: bytes, system: int = 255) -> bytes:
    """Return a frame of MAVLink 2 with a right checksum."""
    head = bytes((len(payload), 0, 0, 0, system, 190)) + number.to_bytes(3, "little")
    extra = bytes((mavlink.mavlink_map[number].crc_extra,))
    checksum = mcrf4xx(head + payload + extra).to_bytes(2, "little")
    return bytes((mavlink.PROTOCOL_MARKER_V2,)) + head + payload + checksum


def raw(data: bytes, _: Path) -> None:
    """Receive bytes, in two parts, as they come from a socket."""
    link = ClientLink(1, "a", 0)
    found = received(link, data[: len(data) // 2], 0) + received(link, data[len(data) // 2 :], 1)
    face, robot = new_face()
    for message in found[:MAX_RECORDS]:
        robot.work.within(face.receive, message, Sender(1, 255, 190), 1)
    robot.work.within(face.due, ROUND_NS)


def received(link: ClientLink, data: bytes, now_ns: int) -> list[MavMessage]:
    """Return the messages in bytes of a client."""
    link.allow(MAX_FRAMES)
    link.feed(data)
    messages = (link.decode(frame) for frame in link.frames(now_ns))
    return [one for one in messages if one is not None]


def payloads(data: bytes, folder: Path) -> None:
    """Receive messages: a byte for the kind, one of flags, then the payload."""
    log = folder / RECORDING
    if not log.exists():
        log.write_bytes(bytes(1000))
    face, robot = new_face(folder)
    link = ClientLink(1, "a", 0)
    at = now_ns = 0
    for _record in range(MAX_RECORDS):
        if at + 2 > len(data):
            break
        number, robot.flags = KINDS[data[at] % len(KINDS)], data[at + 1]
        size = mavlink.mavlink_map[number].unpacker.size
        payload = data[at + 2 : at + 2 + size].ljust(size, b"\0")
        at += 2 + size
        for message in received(link, framed(number, payload), now_ns):
            robot.work.within(receive, face, message, robot.flags, now_ns)
        for _round in range(ROUNDS[robot.flags & 3]):
            now_ns += ROUND_NS
            robot.deliver()
            robot.work.settle()
            robot.work.within(face.due, now_ns)
            send(face)
    for client in (1, 2):
        face.forget(client)


def receive(face: Face, message: MavMessage, flags: int, now_ns: int) -> None:
    """Pass a message to the vehicle. The vehicle is its target unless the flags keep the target."""
    if not flags & AS_SENT and hasattr(message, "target_system"):
        message.target_system = message.target_component = 0
    client = 2 if flags & OTHER_CLIENT else 1
    face.receive(message, Sender(client, 255, 190), now_ns)


def send(face: Face) -> None:
    """Encode all sent messages."""
    link = ClientLink(1, "a", 0)
    for message, *_ in face.vehicle.outbox.take():
        link.encode(1, message, GUARD)


def record(message: MavMessage, flags: int) -> bytes:
    """Return the bytes that `payloads` reads as a message."""
    frame: bytes = message.pack(mavlink.MAVLink(None, 255, 190))
    number = message.get_msgId()
    size = mavlink.mavlink_map[number].unpacker.size
    payload = frame[HEADER_BYTES:-CHECKSUM_BYTES].ljust(size, b"\0")
    return bytes((KINDS.index(number), flags)) + payload


def records() -> Sequence[bytes]:
    """Return messages of each kind, all commands, and requests that belong together."""
    found = []
    for place, number in enumerate(KINDS):
        size = mavlink.mavlink_map[number].unpacker.size
        found += [bytes((place, flags)) + bytes(size) for flags in (1, 3)]
    for command in sorted(mavlink.enums["MAV_CMD"]):
        if command <= MAX_COMMAND:
            numbers = (1.0, 0.0, 0.0, 0.0, 5.0, 6.0, 0.0)
            call = mavlink.MAVLink_command_long_message(1, 1, command, 0, *numbers)
            found += [record(call, flags) for flags in (1, ARMED | 1)]
    return [*found, *file_records(), *parameter_records(), *mission_records()]


def file_records() -> Sequence[bytes]:
    """Return the openings of files, followed by the ways to read them; and downloads of logs."""
    found = []
    for path in PATHS:
        opening = record(file_request(Opcode.OPEN, path), 1)
        reading = [(Opcode.BURST, b"x" * 80), (Opcode.READ, b"x" * 80), (Opcode.CHECKSUM, path)]
        found += [opening + record(file_request(*one), 3) for one in reading]
        found.append(record(file_request(Opcode.LIST, path), 1))
    listing = record(mavlink.MAVLink_log_request_list_message(1, 1, 0, 9), 1)
    whole = record(mavlink.MAVLink_log_request_data_message(1, 1, 1, 0, 1000), 3)
    return [*found, listing + whole, whole + listing]


def file_request(opcode: Opcode, data: bytes) -> MavMessage:
    """Return a request of a file."""
    payload = (FILE_HEADER.pack(1, 1, opcode, len(data), 0, 0, 0) + data).ljust(251, b"\0")
    return mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, list(payload))


def parameter_records() -> Sequence[bytes]:
    """Return requests for single parameters, after the list."""
    listing = record(mavlink.MAVLink_param_request_list_message(1, 1), 1)
    found = []
    for name in (b"D_OBS_M", b"SIDE", b"RCMAP_ROLL", b"NO_SUCH"):
        found.append(listing + record(mavlink.MAVLink_param_set_message(1, 1, name, 1.0, 9), 3))
        found.append(
            listing + record(mavlink.MAVLink_param_request_read_message(1, 1, name, -1), 3)
        )
    return found


def mission_records() -> Sequence[bytes]:
    """Return whole uploads and partial ones, and downloads."""
    found: list[tuple[MavMessage, ...]] = []
    for kind, command in ((0, 16), (1, 5001), (1, 5003)):
        size = 1 if command == 5003 else 4
        items = [mission_item(at, command, size, kind) for at in range(size)]
        listing = mavlink.MAVLink_mission_request_list_message(1, 1, kind)
        reading = mavlink.MAVLink_mission_request_message(1, 1, 1, kind)
        partly = mavlink.MAVLink_mission_write_partial_list_message(1, 1, 0, 1, kind)
        clearing = mavlink.MAVLink_mission_clear_all_message(1, 1, kind)
        counted = MissionCount(1, 1, size, kind)
        found += [
            (counted, *items, items[-1]),
            (partly, *items[:2]),
            (listing, reading, clearing, counted),
        ]
    return [b"".join(record(one, SOME_ROUNDS) for one in messages) for messages in found]


def mission_item(at: int, command: int, size: int, kind: int) -> MavMessage:
    """Return an item near the origin."""
    place = place_of(DEFAULT_ORIGIN.latitude_deg, DEFAULT_ORIGIN.longitude_deg)
    x, y = place.latitude_e7 + 100 * (at // 2), place.longitude_e7 + 100 * (at in (1, 2))
    given = (0.0 if kind == 0 else float(size), 0.0, 0.0, 0.0)
    return mavlink.MAVLink_mission_item_int_message(
        1, 1, at, 3, command, 0, 1, *given, x, y, 0.0, kind
    )


def frames() -> Sequence[bytes]:
    """Return whole frames."""
    return [framed(number, bytes(mavlink.mavlink_map[number].unpacker.size)) for number in KINDS]


TRAFFIC: Final = (*KINDS, mavlink.MAVLINK_MSG_ID_SETUP_SIGNING, mavlink.MAVLINK_MSG_ID_HEARTBEAT)
SECRET, OLDER = b"s" * 32, b"o" * 32
DAY_NS: Final = 86_400 * NS_PER_S
PEER, IN_PIECES, SIGNED, RIGHT_KEY, REMOTE, OTHER_SYSTEM = 0x03, 0x04, 0x08, 0x10, 0x20, 0x40
"""Bits of the way in which a frame is sent."""
WAYS: Final = (0, SIGNED | RIGHT_KEY, SIGNED, REMOTE | 1, SIGNED | RIGHT_KEY | IN_PIECES)


def traffic(data: bytes, folder: Path) -> None:
    """Receive frames of four peers: bytes for kind, flags and way of sending, then the payload."""
    clock, endpoint = ManualClock(), PlayedEndpoint()
    ring = KeyRing(key=tuple(SigningKey(secret=key.hex()) for key in (SECRET, OLDER)))
    unix_ns = EPOCH_S * 10**9 + DAY_NS
    policies = {endpoint.text: list(Policy)[data[0] % len(Policy) if data else 0]}
    guard = SigningGuard(lambda: unix_ns + clock.now_ns(), ring, policies)
    face, robot = new_face(folder, guard)
    with closing(PlayedGateway(endpoint, [face], [robot], clock, guard=guard)) as gateway:
        at, count = 1, 0
        while at + 3 <= len(data) and count < MAX_RECORDS:
            number, robot.flags, way = TRAFFIC[data[at] % len(TRAFFIC)], data[at + 1], data[at + 2]
            size = mavlink.mavlink_map[number].unpacker.size
            payload = data[at + 3 : at + 3 + size].ljust(size, b"\0")
            at, count = at + 3 + size, count + 1
            stamp = DAY_NS // NS_PER_S * PER_S + clock.now_ns() // STAMP_NS + count
            frame = sent_frame(number, payload, way, stamp)
            cut = len(frame) // 2 if way & IN_PIECES else len(frame)
            endpoint.is_loopback = not way & REMOTE
            for piece in (frame[:cut], frame[cut:]):
                endpoint.deliver(str(way & PEER), piece)
            for _round in range(max(1, ROUNDS[robot.flags & 3])):
                gateway.advance(ROUND_NS)
                robot.deliver()
            endpoint.sent.clear()


def sent_frame(number: int, payload: bytes, way: int, stamp: int) -> bytes:
    """Return a frame of one of two systems, in the way that the flags tell."""
    system = 254 if way & OTHER_SYSTEM else 255
    if way & SIGNED:
        key = SECRET if way & RIGHT_KEY else OLDER if way & IN_PIECES else bytes(32)
        return signed(framed(number, payload, system), key, way & PEER, stamp)
    return framed(number, payload, system)


def signed(frame: bytes, key: bytes, link: int, stamp: int) -> bytes:
    """Return a frame with a signature by a key."""
    head, payload = bytearray(frame[1:HEADER_BYTES]), frame[HEADER_BYTES:-CHECKSUM_BYTES]
    head[1] |= mavlink.MAVLINK_IFLAG_SIGNED
    number = int.from_bytes(head[6:9], "little")
    extra = bytes((mavlink.mavlink_map[number].crc_extra,))
    checksum = mcrf4xx(bytes(head) + payload + extra).to_bytes(2, "little")
    whole = frame[:1] + bytes(head) + payload + checksum
    whole += bytes((link,)) + stamp.to_bytes(6, "little")
    return whole + sha256(key + whole).digest()[:6]


def traffic_records() -> Sequence[bytes]:
    """Return each kind of message in some ways, and requests that need each other."""
    found = []
    for place, number in enumerate(TRAFFIC):
        size = mavlink.mavlink_map[number].unpacker.size
        found += [bytes((1, place, 1, way)) + bytes(size) for way in WAYS]
    setup = mavlink.MAVLink_setup_signing_message(1, 1, list(SECRET), 0)
    asking = [
        mavlink.MAVLink_command_long_message(1, 1, REQUEST_OPERATOR_CONTROL, 0, *given)
        for given in ((1, 0, 5, 0, 0, 0, 0), (1, 1, 0, 0, 0, 0, 0), (0, 0, 0, 0, 0, 0, 0))
    ]
    stop = mavlink.MAVLink_command_long_message(1, 1, 185, 0, 1, 0, 0, 0, 0, 0, 0)
    listing = mavlink.MAVLink_log_request_list_message(1, 1, 0, 9)
    whole = mavlink.MAVLink_log_request_data_message(1, 1, 1, 0, 1000)
    for messages in ([setup, *asking], [*asking, stop], [listing, whole, setup], [*asking] * 3):
        for ways in ((0, 1, 2, 3), (SIGNED | RIGHT_KEY, OTHER_SYSTEM | 1, SIGNED, REMOTE)):
            records = (traffic_record(one, ways[at % len(ways)]) for at, one in enumerate(messages))
            found.append(b"\1" + b"".join(records))
    return found


def traffic_record(message: MavMessage, way: int) -> bytes:
    """Return the bytes that `traffic` reads as a message."""
    frame: bytes = message.pack(mavlink.MAVLink(None, 255, 190))
    number = message.get_msgId()
    size = mavlink.mavlink_map[number].unpacker.size
    payload = frame[HEADER_BYTES:-CHECKSUM_BYTES].ljust(size, b"\0")
    return bytes((TRAFFIC.index(number), SOME_ROUNDS, way)) + payload
