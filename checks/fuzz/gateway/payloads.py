"""Any bytes as frames, and any payloads in complete frames."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from fastcrc.crc16 import mcrf4xx

from checks.fuzz.gateway.robot import ARMED, new_face
from gateways.mavlink.clients import ClientLink
from gateways.mavlink.coordinates import DEFAULT_ORIGIN, place_of
from gateways.mavlink.ftp_messages import HEADER as FILE_HEADER
from gateways.mavlink.ftp_messages import Opcode
from gateways.mavlink.mav_service import Sender
from gateways.mavlink.mav_vehicle import Face
from gateways.mavlink.mavlink_dialect import (
    MavMessage,
    MissionCount,
    mavlink,
)
from gateways.mavlink.signing import SigningGuard

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
    face, _robot = new_face()
    for message in found[:MAX_RECORDS]:
        face.receive(message, Sender(1, 255, 190), 1)
    face.due(ROUND_NS)


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
            receive(face, message, robot.flags, now_ns)
        for _round in range(ROUNDS[robot.flags & 3]):
            now_ns += ROUND_NS
            robot.deliver()
            face.due(now_ns)
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
    for message, _ in face.vehicle.outbox.take():
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
