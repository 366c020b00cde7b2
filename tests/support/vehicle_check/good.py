"""A vehicle that passes all rows: streams, parameters, files, missions, commands, signing."""

import json
import lzma
from dataclasses import dataclass, field
from math import cos, hypot, isfinite, isnan, sin
from struct import pack
from typing import Any, ClassVar
from urllib.parse import parse_qs
from zlib import crc32

from tests.support.vehicle_check.core import ACCEPTED, FAILED, NOT_IN_CONTROL, Core, Peer, mavlink
from tests.support.vehicle_check.core import DENIED as CORE_DENIED
from tests.support.vehicle_check.core import UNSUPPORTED as CORE_UNSUPPORTED
from vehicle_check import transfers as ftp
from vehicle_check.mavlink_frames import (
    AVAILABLE_MODES,
    COMPONENT_METADATA,
    CONTROL_STATUS,
    CURRENT_MODE,
    MISSION_ACK,
    MISSION_COUNT,
    MISSION_CURRENT,
    NUMBERS,
    REQUEST_OPERATOR_CONTROL,
    TIMESYNC,
    ExtraMessage,
    Signer,
    is_signed_with,
)
from vehicle_check.rows.parameter_rows import COMPATIBILITY

HOLD = 4
MODES = {0: b"Manual", 4: b"Hold", 10: b"Auto", 15: b"Guided"}
LAT, LON = -353_632_621, 1_491_652_374
BEAMS = [120, 130, 300, 210, 205, 90, 95, 301]
SECTORS = {6: (0,), 7: (1, 2), 0: (3, 4), 1: (5, 6), 2: (7,)}
RATES = {
    "HEARTBEAT": 1, "SYS_STATUS": 2, "EKF_STATUS_REPORT": 1, "GLOBAL_POSITION_INT": 5,
    "GPS_RAW_INT": 1, "LOCAL_POSITION_NED": 10, "ATTITUDE": 10, "VFR_HUD": 2,
    "LOCAL_POSITION_NED_COV": 5, "ODOMETRY": 5, "HOME_POSITION": 1, "BATTERY_STATUS": 1,
    "OBSTACLE_DISTANCE": 5, "DISTANCE_SENSOR": 5, "RANGEFINDER": 2, "SYSTEM_TIME": 1,
    "MISSION_CURRENT": 1, "FENCE_STATUS": 1, "CONTROL_STATUS": 1, "RC_CHANNELS": 2,
    "NAV_CONTROLLER_OUTPUT": 2, "POSITION_TARGET_GLOBAL_INT": 2,
}  # fmt: skip
GROUPS = {
    2: ("SYS_STATUS", "GPS_RAW_INT"), 3: ("RC_CHANNELS",), 10: ("ATTITUDE",), 11: ("VFR_HUD",),
    6: ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"), 12: ("SYSTEM_TIME", "BATTERY_STATUS"),
}  # fmt: skip
CAPABILITIES = 64 | 1 | 2 | 4 | 8 | 32 | 128 | 256 | 2048 | 8192 | 16384 | 131072


ON_REQUEST = ("CONTROL_STATUS",)
"""What only those receive who ask for it: it is in no dialect of common clients."""
MODE_BITS = {0: 64, 10: 8, 15: 8}
NAMES = {number: name for name, number in NUMBERS.items()}


class Streams(Core):
    """A vehicle that stands at the origin and sends all streams."""

    rates = RATES
    on_request: ClassVar[tuple[str, ...]] = ON_REQUEST

    def __init__(self) -> None:
        super().__init__()
        self.mode, self.state = HOLD, 3
        self.is_armed = False
        self.x = self.y = self.yaw = self.speed = self.turn = 0.0
        self.owner, self.takeover = 0, 1
        self.plan_ids = {0: 11, 1: 12, 2: 0}
        self.current, self.total, self.mission_state = 0, 0, 1
        self.channels = [1500] * 18
        self.metadata_crc = 0

    def due(self, now_ns: int) -> None:
        """Send what is due to each peer."""
        super().due(now_ns)
        for peer in list(self.peers.values()):
            for name, rate in self.rates.items():
                due_ns = peer.due.get(name, now_ns)
                if now_ns < due_ns:
                    continue
                usual = 0 if name in self.on_request else 1_000_000_000 // rate
                interval = peer.intervals.get(name, usual)
                if interval:
                    peer.due[name] = max(due_ns + interval, now_ns)
                    self.stream(name, peer)

    def stream(self, name: str, peer: Peer | None) -> bool:
        """Send the messages of a name; False if there are none."""
        build = getattr(self, f"build_{name.lower()}", None)
        made = None if build is None else build()
        for message in made if isinstance(made, list) else [made] if made is not None else []:
            self.send(message, peer)
        return made is not None

    def build_heartbeat(self) -> Any:
        bits = MODE_BITS.get(self.mode, 0) | (128 if self.is_armed else 0)
        return mavlink.MAVLink_heartbeat_message(10, 3, 1 | bits, self.mode, self.state, 3)

    def build_sys_status(self) -> Any:
        bits = 0x10000000 | 0x100000 | 0x4000000
        return mavlink.MAVLink_sys_status_message(bits, bits, bits, *[0] * 10)

    def build_ekf_status_report(self) -> Any:
        return mavlink.MAVLink_ekf_status_report_message(16 | 512, 0.1, 0.1, 0, 0.1, 0)

    def global_of(self, x: float, y: float) -> tuple[int, int]:
        """Return latitude and longitude of a place."""
        return LAT + round(x / 0.0111319), LON + round(y / 0.0111319 / 0.8155)

    def place(self) -> tuple[int, int]:
        """Latitude and longitude."""
        return self.global_of(self.x, self.y)

    def velocity(self) -> tuple[float, float]:
        """North and east."""
        return self.speed * cos(self.yaw), self.speed * sin(self.yaw)

    def build_global_position_int(self) -> Any:
        return mavlink.MAVLink_global_position_int_message(
            self.boot_ms, *self.place(), 584_000, 0, 0, 0, 0, 0
        )

    def build_gps_raw_int(self) -> Any:
        return mavlink.MAVLink_gps_raw_int_message(0, 3, *self.place(), 0, 0, 0, 0, 0, 10)

    def build_local_position_ned(self) -> Any:
        return mavlink.MAVLink_local_position_ned_message(
            self.boot_ms, self.x, self.y, 0, *self.velocity(), 0
        )

    def build_attitude(self) -> Any:
        return mavlink.MAVLink_attitude_message(self.boot_ms, 0, 0, self.yaw, 0, 0, self.turn)

    def build_vfr_hud(self) -> Any:
        return mavlink.MAVLink_vfr_hud_message(0, self.speed, 0, 0, 0, 0)

    def build_local_position_ned_cov(self) -> Any:
        return mavlink.MAVLink_local_position_ned_cov_message(0, 1, *[0] * 9, [0] * 45)

    def build_odometry(self) -> Any:
        values = [0.0] * 21
        return mavlink.MAVLink_odometry_message(
            0, 1, 8, 0, 0, 0, [1, 0, 0, 0], *[0] * 6, values, values
        )

    def build_home_position(self) -> Any:
        return mavlink.MAVLink_home_position_message(
            LAT, LON, 584_000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0
        )

    def build_battery_status(self) -> Any:
        return mavlink.MAVLink_battery_status_message(0, 0, 0, 0, [12_000] * 10, 0, 0, 0, 80)

    def build_obstacle_distance(self) -> Any:
        return mavlink.MAVLink_obstacle_distance_message(
            0, 1, [*BEAMS, *[65_535] * 64], 22, 2, 300, 22.5, -78.75, 12
        )

    def build_distance_sensor(self) -> Any:
        return [
            mavlink.MAVLink_distance_sensor_message(
                0, 2, 300, min(300, *(BEAMS[one] for one in beams)), 1, at, at, 0, 0.785, 0.1
            )
            for at, beams in SECTORS.items()
        ]

    def build_rangefinder(self) -> Any:
        return mavlink.MAVLink_rangefinder_message(0.9, 0)

    def build_system_time(self) -> Any:
        return mavlink.MAVLink_system_time_message(1, self.boot_ms)

    def build_mission_current(self) -> Any:
        return ExtraMessage(
            MISSION_CURRENT, seq=self.current, total=self.total, mission_state=self.mission_state,
            mission_id=self.plan_ids[0], fence_id=self.plan_ids[1],
        )  # fmt: skip

    def build_fence_status(self) -> Any:
        return mavlink.MAVLink_fence_status_message(0, 0, 0, 0)

    def build_control_status(self) -> Any:
        return ExtraMessage(CONTROL_STATUS, flags=1 | self.takeover << 1, gcs_main=self.owner)

    def build_rc_channels(self) -> Any:
        return mavlink.MAVLink_rc_channels_message(self.boot_ms, 18, *self.channels, 255)

    def build_autopilot_version(self) -> Any:
        return mavlink.MAVLink_autopilot_version_message(
            CAPABILITIES, 4 << 24 | 7 << 16, 0, 0, 0, list(b"abcdef12"), [0] * 8, [0] * 8, 0, 0, 77
        )

    def build_gps_global_origin(self) -> Any:
        return mavlink.MAVLink_gps_global_origin_message(LAT, LON, 584_000, 0)

    def build_wheel_distance(self) -> Any:
        return mavlink.MAVLink_wheel_distance_message(0, 2, [0.0] * 16)

    def build_available_modes(self) -> Any:
        return [
            ExtraMessage(
                AVAILABLE_MODES, number_modes=len(MODES), mode_index=at, custom_mode=mode,
                mode_name=name,
            )
            for at, (mode, name) in enumerate(MODES.items(), start=1)
        ]  # fmt: skip

    def build_current_mode(self) -> Any:
        return ExtraMessage(CURRENT_MODE, custom_mode=self.mode)

    def build_component_metadata(self) -> Any:
        uri = b"mftp:///general.json.xz"
        return ExtraMessage(COMPONENT_METADATA, file_crc=self.metadata_crc, uri=uri)

    def requested(self, number: int, param: float, peer: Peer) -> int:
        """Send a message on request; return the result."""
        names = {435: "AVAILABLE_MODES", 436: "CURRENT_MODE", 397: "COMPONENT_METADATA"}
        known = mavlink.mavlink_map.get(number)
        name = names.get(number) or (known.msgname if known else "")
        if number == 244:
            self.interval_of(round(param), peer)
            return ACCEPTED
        return ACCEPTED if self.stream(name, peer) else CORE_UNSUPPORTED

    def interval_of(self, number: int, peer: Peer) -> None:
        """Send MESSAGE_INTERVAL."""
        name = mavlink.mavlink_map[number].msgname
        interval_us = peer.intervals.get(name, 1_000_000_000 // self.rates.get(name, 1)) // 1000
        self.send(mavlink.MAVLink_message_interval_message(number, interval_us), peer)

    def set_interval(self, number: int, interval_us: float, peer: Peer) -> int:
        """Change the rate of one message."""
        name = NAMES[number]
        if interval_us > 0:
            peer.intervals[name] = round(interval_us * 1000)
        else:
            peer.intervals.pop(name, None)
        peer.due[name] = 0
        return ACCEPTED

    def on_request_data_stream(self, message: Any, peer: Peer) -> None:
        for name in GROUPS.get(message.req_stream_id, ()):
            rate = message.req_message_rate
            peer.intervals[name] = 1_000_000_000 // rate if message.start_stop and rate else 0
            peer.due[name] = 0

    def on_autopilot_version_request(self, message: Any, peer: Peer) -> None:
        self.stream("AUTOPILOT_VERSION", peer)

    def on_set_gps_global_origin(self, message: Any, peer: Peer) -> None:
        self.stream("GPS_GLOBAL_ORIGIN", None)

    def on_timesync(self, message: Any, peer: Peer) -> None:
        if message.tc1 == 0:
            target = {"target_system": peer.system, "target_component": peer.component}
            self.send(ExtraMessage(TIMESYNC, tc1=self.now_ns, ts1=message.ts1, **target), peer)

    def on_ping(self, message: Any, peer: Peer) -> None:
        self.send(
            mavlink.MAVLink_ping_message(
                message.time_usec, message.seq, peer.system, peer.component
            ),
            peer,
        )


INT32, REAL32 = 6, 9
LOGS = {1: bytes(range(256)) * 5, 2: b"log" * 555}


def compatible(name: str) -> float:
    """Return a value that QGroundControl accepts."""
    values = {"MIN": 1000.0, "MAX": 2000.0, "TRIM": 1500.0}
    if name.startswith("INS_"):
        return 0.01
    return values.get(name.partition("_")[2], 0.0) if name.startswith("RC") else 0.0


class Files(Streams):
    """Serves parameters by messages and by FTP, descriptions and logs."""

    own: ClassVar = {"RADIUS_X": 0.5, "WHEELBASE_X": 0.25, "NAVIGATOR_X": 2.0, "GUID_TIMEOUT": 0.8}

    def __init__(self) -> None:
        super().__init__()
        self.values = dict(self.own) | {name: compatible(name) for name in COMPATIBILITY}
        self.kinds = {name: INT32 if name == "NAVIGATOR_X" else REAL32 for name in self.values}
        self.files: dict[str, bytes] = self.described()
        self.sessions: dict[int, bytes] = {}
        self.logs_for: dict[int, list[Any]] = {}

    def described(self) -> dict[str, bytes]:
        """Return the files of the component metadata."""
        rows = [{"name": name, "type": "Float"} for name in self.values]
        inner = lzma.compress(json.dumps({"version": 1, "parameters": rows}).encode())
        link = {"type": 1, "uri": "mftp:///parameters.json.xz", "fileCrc": crc32(inner)}
        general = lzma.compress(json.dumps({"version": 1, "metadataTypes": [link]}).encode())
        self.metadata_crc = crc32(general)
        return {"/general.json.xz": general, "/parameters.json.xz": inner}

    def value(self, name: str) -> Any:
        """Return PARAM_VALUE."""
        names = list(self.values)
        return mavlink.MAVLink_param_value_message(
            name.encode(), self.values[name], self.kinds[name], len(names), names.index(name)
        )

    def on_param_request_list(self, message: Any, peer: Peer) -> None:
        for name in self.values:
            self.send(self.value(name), peer)

    def on_param_request_read(self, message: Any, peer: Peer) -> None:
        names = list(self.values)
        at = message.param_index
        name = message.param_id if at < 0 else names[at] if at < len(names) else ""
        if name in self.values:
            self.send(self.value(name), peer)

    def on_param_set(self, message: Any, peer: Peer) -> None:
        name = message.param_id
        if name in self.values:
            if isfinite(message.param_value) and name not in COMPATIBILITY:
                self.values[name] = message.param_value
            self.send(self.value(name))

    def packed(self, query: str) -> bytes:
        """Return param.pck."""
        options = {key: int(values[0]) for key, values in parse_qs(query).items()}
        start = options.get("start", 0)
        names = list(self.values)[start:][: options.get("count") or None]
        magic = 0x671C if options.get("withdefaults") else 0x671B
        found = pack("<HHH", magic, len(names), len(self.values))
        for name in names:
            head = bytes([4, (len(name) - 1) << 4])
            found += head + name.encode() + pack("<f", self.values[name])
        return found

    def file(self, path: str) -> bytes | None:
        """Return the contents of a file."""
        name, _, query = path.partition("?")
        if name == "@PARAM/param.pck":
            return self.packed(query)
        if name.startswith("@MAV_LOG/"):
            return LOGS.get(int(name[9:-4]))
        return self.files.get(name)

    def on_file_transfer_protocol(self, message: Any, peer: Peer) -> None:
        asked = ftp.reply_of(message.payload)
        answer = self.ftp_answer(asked, peer)
        if answer is not None:
            self.reply(asked, peer, *answer)

    def reply(
        self, asked: ftp.FileReply, peer: Peer, data: bytes | int, offset: int = 0, more: int = 1
    ) -> None:
        """Send an ACK with data, or a NAK with an error."""
        opcode = ftp.NAK if isinstance(data, int) else ftp.ACK
        data = bytes([data]) if isinstance(data, int) else data
        session = asked.session or (1 if asked.opcode == ftp.OPEN else 0)
        head = ftp.HEADER.pack(
            asked.sequence + more & 0xFFFF, session, opcode, len(data), asked.opcode, 0, offset
        )
        payload = list((head + data).ljust(251, b"\0"))
        self.send(
            mavlink.MAVLink_file_transfer_protocol_message(0, peer.system, peer.component, payload),
            peer,
        )

    def ftp_answer(self, asked: ftp.FileReply, peer: Peer) -> tuple[bytes | int, int] | None:
        """Return data or an error, and the offset; None if all is sent."""
        path = asked.data.decode("utf-8", "replace")
        if asked.opcode in (ftp.RESET, ftp.TERMINATE):
            return b"", 0
        if asked.opcode == ftp.LIST:
            return self.listed(path, asked.offset), asked.offset
        if asked.opcode in (ftp.OPEN, ftp.CRC32):
            data = self.file(path)
            if data is None:
                return ftp.FILE_NOT_FOUND, 0
            if asked.opcode == ftp.CRC32:
                return pack("<I", crc32(data)), 0
            self.sessions[1] = data
            return pack("<I", len(data)), 0
        data = self.sessions.get(asked.session)
        if data is None:
            return 4, 0
        if asked.opcode == ftp.READ:
            part = data[asked.offset : asked.offset + asked.size]
            return (part or ftp.END_OF_FILE), asked.offset
        for number, at in enumerate(range(asked.offset, len(data), asked.size), start=1):
            self.reply(asked, peer, data[at : at + asked.size], at, number)
        return None

    def listed(self, path: str, offset: int) -> bytes | int:
        """Return the entries of a folder."""
        folders = {
            "@PARAM": ["Fparam.pck\t100"],
            "@MAV_LOG": [f"F{one}.bin\t{len(data)}" for one, data in LOGS.items()],
        }
        names = folders.get(path, [])[offset:]
        return "\0".join(names).encode() + b"\0" if names else ftp.END_OF_FILE

    def on_log_request_list(self, message: Any, peer: Peer) -> None:
        for number, data in LOGS.items():
            self.send(
                mavlink.MAVLink_log_entry_message(number, len(LOGS), max(LOGS), 0, len(data)), peer
            )

    def on_log_request_data(self, message: Any, peer: Peer) -> None:
        data = b"" if self.is_armed else LOGS.get(message.id, b"")
        end = min(len(data), message.ofs + message.count)
        for at in range(message.ofs, end, 90):
            part = data[at : min(at + 90, end)]
            self.send(
                mavlink.MAVLink_log_data_message(
                    message.id, at, len(part), list(part.ljust(90, b"\0"))
                ),
                peer,
            )


RETRY_NS = 500_000_000
GIVE_UP_NS = 4_000_000_000
OK = 0
UNSUPPORTED_FRAME = 2
UNSUPPORTED = 3
NO_SPACE = 4
INVALID_LAT = 10
DENIED = 14
CANCELLED = 15
KNOWN = {0: {16, 20, 93, 178}, 1: {5001, 5003}, 2: set()}


@dataclass
class Upload:
    """An upload that is going on."""

    peer: Peer
    kind: int
    begin: int
    end: int
    base: list[Any]
    items: dict[int, Any] = field(default_factory=dict)
    asked_ns: int = 0
    heard_ns: int = 0

    @property
    def next(self) -> int:
        """The item to ask for."""
        return self.begin + len(self.items)


class Plans(Files):
    """Takes and gives plans."""

    def __init__(self) -> None:
        super().__init__()
        self.plans: dict[int, list[Any]] = {0: [], 1: [], 2: []}
        self.upload: Upload | None = None
        self.last: tuple[int, int, int] = (-1, -1, OK)

    def due(self, now_ns: int) -> None:
        """Ask again, and give up."""
        super().due(now_ns)
        upload = self.upload
        if upload is None:
            return
        if now_ns - upload.heard_ns >= GIVE_UP_NS:
            self.end_upload(CANCELLED)
        elif now_ns - upload.asked_ns >= RETRY_NS:
            self.ask()

    def ask(self) -> None:
        """Ask for the next item."""
        assert self.upload is not None
        self.upload.asked_ns = self.now_ns
        peer, seq = self.upload.peer, self.upload.next
        self.send(
            mavlink.MAVLink_mission_request_message(
                peer.system, peer.component, seq, self.upload.kind
            ),
            peer,
        )

    def ack(self, peer: Peer, kind: int, result: int) -> None:
        """Send MISSION_ACK."""
        ids = self.plan_ids[kind] if result == OK else 0
        self.send(
            ExtraMessage(
                MISSION_ACK, target_system=peer.system, target_component=peer.component,
                type=result, mission_type=kind, opaque_id=ids,
            ),
            peer,
        )  # fmt: skip

    def end_upload(self, result: int) -> None:
        """End the upload; take the plan if it is whole."""
        upload, self.upload = self.upload, None
        assert upload is not None
        if result == OK:
            plan = upload.base
            plan[upload.begin : upload.end] = [upload.items[one] for one in sorted(upload.items)]
            self.plans[upload.kind] = plan
            self.plan_ids[upload.kind] += 7
            if upload.kind == 0:
                self.current, self.total, self.mission_state = 0, len(plan), 2
        self.last = upload.kind, upload.next - (result == OK), result
        self.ack(upload.peer, upload.kind, result)

    def on_mission_count(self, message: Any, peer: Peer) -> None:
        if self.upload is not None and self.upload.peer is not peer:
            self.ack(peer, message.mission_type, DENIED)
        elif message.count > 100:
            self.text(f"mission of {message.count} items: 100 at most", peer)
            self.ack(peer, message.mission_type, NO_SPACE)
        else:
            now = self.now_ns
            self.upload = Upload(
                peer, message.mission_type, 0, message.count, [], heard_ns=now, asked_ns=now
            )
            self.end_upload(OK) if message.count == 0 else self.ask()

    def on_mission_write_partial_list(self, message: Any, peer: Peer) -> None:
        plan, end = list(self.plans[message.mission_type]), message.end_index + 1
        now = self.now_ns
        self.upload = Upload(
            peer, message.mission_type, message.start_index, end, plan, heard_ns=now
        )
        self.ask()

    def on_mission_item_int(self, message: Any, peer: Peer) -> None:
        self.take(message, peer, message.x, message.y)

    def on_mission_item(self, message: Any, peer: Peer) -> None:
        self.take(message, peer, round(message.x * 1e7), round(message.y * 1e7))

    def take(self, one: Any, peer: Peer, x: int, y: int) -> None:
        """Take an item."""
        upload = self.upload
        if one.current == 2:
            self.guided(one, peer, x, y)
            return
        if upload is None or upload.peer is not peer:
            if (one.mission_type, one.seq) == self.last[:2]:
                self.ack(peer, one.mission_type, self.last[2])
            return
        upload.heard_ns = self.now_ns
        if one.seq != upload.next:
            return
        fault = self.fault(one, x, upload.kind)
        if fault:
            self.text(f"item {one.seq}: refused", peer)
            self.end_upload(fault)
            return
        place = (LAT, LON) if upload.kind == 0 and one.seq == 0 else (x, y)
        values = (one.frame, one.command, 0, 1, one.param1, one.param2, one.param3, one.param4)
        upload.items[one.seq] = (values, place, one.z)
        self.end_upload(OK) if upload.next == upload.end else self.ask()

    def fault(self, one: Any, x: int, kind: int) -> int:
        """Return why an item is refused, 0 for none."""
        if one.command not in KNOWN[kind]:
            return UNSUPPORTED
        if one.frame not in (0, 3, 5, 6):
            return UNSUPPORTED_FRAME
        return INVALID_LAT if abs(x) > 900_000_000 else 0

    def guided(self, one: Any, peer: Peer, x: int, y: int) -> None:
        """Take a guided item; overridden by driving."""

    def on_mission_request_list(self, message: Any, peer: Peer) -> None:
        kind = message.mission_type
        if self.upload is not None:
            self.ack(peer, kind, DENIED)
            return
        self.send(
            ExtraMessage(
                MISSION_COUNT, target_system=peer.system, target_component=peer.component,
                count=len(self.plans[kind]), mission_type=kind, opaque_id=self.plan_ids[kind],
            ),
            peer,
        )  # fmt: skip

    def on_mission_request(self, message: Any, peer: Peer) -> None:
        self.give(message, peer, as_float=True)

    def on_mission_request_int(self, message: Any, peer: Peer) -> None:
        self.give(message, peer, as_float=False)

    def give(self, message: Any, peer: Peer, *, as_float: bool) -> None:
        """Send an item."""
        values, (x, y), z = self.plans[message.mission_type][message.seq]
        head = (peer.system, peer.component, message.seq, *values)
        if as_float:
            item = mavlink.MAVLink_mission_item_message(
                *head, x / 1e7, y / 1e7, z, message.mission_type
            )
        else:
            item = mavlink.MAVLink_mission_item_int_message(*head, x, y, z, message.mission_type)
        self.send(item, peer)

    def on_mission_clear_all(self, message: Any, peer: Peer) -> None:
        self.plans[message.mission_type] = []
        self.ack(peer, message.mission_type, OK)

    def on_mission_set_current(self, message: Any, peer: Peer) -> None:
        self.current = message.seq
        self.stream("MISSION_CURRENT", None)


GUIDED, MANUAL, AUTO = 15, 0, 10
STALE_S = 0.5
SPEED_M_S = 0.2
STEP_NS = 10_000_000
WAYPOINT = 16
POSITION, ACCELERATION = 0b11, 0b1_1100_0000
"""The bits of a type mask that make a rover ignore these."""
OPEN_COMMANDS = {512, 511, 510, 520, 410, 401, 42428}
STRANGERS_MAY = {"HEARTBEAT"}


class GoodVehicle(Plans):
    """Simulates a ground rover of ArduPilot, as far as the rows require."""

    def __init__(self) -> None:
        super().__init__()
        self.goal: tuple[float, float] | None = None
        self.wanted = (0.0, 0.0)
        self.wanted_until_ns = 0
        self.is_stopped = self.has_told = False
        self.drive_since_ns = 0

    def due(self, now_ns: int) -> None:
        """Drive one step."""
        if self.goal is not None:
            away = self.goal[0] - self.x, self.goal[1] - self.y
            left = hypot(*away)
            self.speed = SPEED_M_S if left > 0.01 and self.is_armed else 0.0
            if self.speed:
                self.x += self.speed * away[0] / left / 100
                self.y += self.speed * away[1] / left / 100
            elif self.is_armed:
                self.arrived()
        else:
            is_fresh = now_ns < self.wanted_until_ns
            self.speed, self.turn = self.wanted if is_fresh and self.is_armed else (0.0, 0.0)
            self.x += self.speed * cos(self.yaw) / 100
            self.y += self.speed * sin(self.yaw) / 100
            self.yaw += self.turn / 100
        super().due(now_ns)

    def arrived(self) -> None:
        """Tell it, and go on with the mission."""
        if self.mode == AUTO:
            self.send(mavlink.MAVLink_mission_item_reached_message(self.current))
            self.next_item()
        elif not self.has_told:
            self.has_told = True
            self.send(mavlink.MAVLink_mission_item_reached_message(0))

    def next_item(self) -> None:
        """Drive to the next waypoint; the items between have no effect here."""
        plan = self.plans[0]
        while self.current + 1 < len(plan):
            self.current += 1
            if plan[self.current][0][1] == WAYPOINT:
                self.goal = self.local(plan[self.current][1])
                return
        self.goal = None

    def build_nav_controller_output(self) -> Any:
        if self.goal is None:
            return None
        left = hypot(self.goal[0] - self.x, self.goal[1] - self.y)
        return mavlink.MAVLink_nav_controller_output_message(0, 0, 0, 0, round(left), 0, 0, 0)

    def build_position_target_global_int(self) -> Any:
        if self.goal is None:
            return None
        place = self.global_of(*self.goal)
        return mavlink.MAVLink_position_target_global_int_message(
            self.boot_ms, 0, 0xFFF8, *place, *[0.0] * 9
        )

    def set_mode(self, mode: int) -> None:
        """Change the mode, and say so at once."""
        self.mode, self.goal, self.wanted = mode, None, (0.0, 0.0)
        self.state = 6 if self.is_stopped else 3 if mode == HOLD else 4
        if mode == AUTO and len(self.plans[0]) > 1:
            self.mission_state = 3
            self.current = max(self.current, 1) - 1
            self.next_item()
        self.stream("HEARTBEAT", None)

    def local(self, place: tuple[int, int]) -> tuple[float, float]:
        """Return north and east of a place."""
        return (place[0] - LAT) * 0.0111319, (place[1] - LON) * 0.0111319 * 0.8155

    def on_command_long(self, message: Any, peer: Peer) -> None:
        params = [getattr(message, f"param{one}") for one in range(1, 8)]
        place = (0, 0) if isnan(params[4]) else (round(params[4] * 1e7), round(params[5] * 1e7))
        self.command(message.command, params, place, message.confirmation, peer)

    def on_command_int(self, message: Any, peer: Peer) -> None:
        params = [getattr(message, f"param{one}") for one in range(1, 5)]
        self.command(message.command, params, (message.x, message.y), 0, peer)

    def command(
        self, number: int, params: list[float], place: tuple[int, int], again: int, peer: Peer
    ) -> None:
        """Carry out a command and acknowledge it."""
        is_stop = self.only_stops(number, params)
        is_open = number in OPEN_COMMANDS or number == REQUEST_OPERATOR_CONTROL or is_stop
        if self.owner not in (0, peer.system) and not is_open:
            result = NOT_IN_CONTROL
        elif number == 192:
            result = self.reposition(place)
        else:
            handler = getattr(self, f"command_{number}", None)
            result = CORE_UNSUPPORTED if handler is None else handler(params, peer)
        self.acknowledge(number, result, peer)

    def only_stops(self, number: int, params: list[float]) -> bool:
        """Return whether a command is open to all because it only stops the vehicle."""
        if number in (176, 185):
            return params[1] == HOLD if number == 176 else params[0] > 0.5
        return number in (193, 400) and params[0] == 0.0

    def acknowledge(self, number: int, result: int, peer: Peer) -> None:
        """Send COMMAND_ACK to the sender."""
        self.send(
            mavlink.MAVLink_command_ack_message(number, result, 0, 0, peer.system, peer.component),
            peer,
        )

    def reposition(self, place: tuple[int, int]) -> int:
        """Drive to a place in GUIDED."""
        if self.mode != GUIDED or place == (0, 0):
            return CORE_DENIED
        self.goal, self.has_told = self.local(place), False
        return ACCEPTED

    def guided(self, one: Any, peer: Peer, x: int, y: int) -> None:
        """Take a guided item."""
        self.ack(peer, 0, 0 if self.reposition((x, y)) == ACCEPTED else 1)

    def command_512(self, params: list[float], peer: Peer) -> int:
        return self.requested(round(params[0]), params[1], peer)

    def command_511(self, params: list[float], peer: Peer) -> int:
        return self.set_interval(round(params[0]), params[1], peer)

    def command_510(self, params: list[float], peer: Peer) -> int:
        self.interval_of(round(params[0]), peer)
        return ACCEPTED

    def command_520(self, params: list[float], peer: Peer) -> int:
        self.stream("AUTOPILOT_VERSION", peer)
        return ACCEPTED

    def command_176(self, params: list[float], peer: Peer) -> int:
        if params[1] not in MODES:
            return CORE_DENIED
        self.set_mode(round(params[1]))
        return ACCEPTED

    def command_400(self, params: list[float], peer: Peer) -> int:
        self.is_armed = params[0] == 1
        self.stream("HEARTBEAT", None)
        return ACCEPTED

    def command_300(self, params: list[float], peer: Peer) -> int:
        if params[0] or params[1]:
            return CORE_DENIED
        self.set_mode(AUTO)
        return ACCEPTED

    def command_224(self, params: list[float], peer: Peer) -> int:
        self.current = round(params[0])
        self.stream("MISSION_CURRENT", None)
        return ACCEPTED

    def command_185(self, params: list[float], peer: Peer) -> int:
        self.is_stopped = params[0] > 0.5
        self.is_armed = False
        self.set_mode(HOLD)
        return ACCEPTED

    def command_246(self, params: list[float], peer: Peer) -> int:
        return CORE_DENIED if self.is_armed else ACCEPTED

    def command_42428(self, params: list[float], peer: Peer) -> int:
        self.text("Fake Rover 4.7", peer, 6)
        return ACCEPTED

    def command_410(self, params: list[float], peer: Peer) -> int:
        self.stream("HOME_POSITION", peer)
        return ACCEPTED

    def accept(self, params: list[float], peer: Peer) -> int:
        """Accept what needs no effect here."""
        return ACCEPTED

    command_401 = command_193 = command_178 = command_207 = command_213 = command_194 = accept

    def command_32100(self, params: list[float], peer: Peer) -> int:
        peer.intervals.setdefault("CONTROL_STATUS", 1_000_000_000)
        if params[0] == 0:
            self.owner, self.takeover = 0, 1
        elif self.owner in (0, peer.system) or self.takeover:
            self.owner, self.takeover = peer.system, round(params[1])
        else:
            owner = next(one for one in self.peers.values() if one.system == self.owner)
            self.send(
                mavlink.MAVLink_command_long_message(
                    owner.system, owner.component, 32100, 0, 1, 0, 10, peer.system, 0, 0, 0
                ),
                owner,
            )
            return FAILED
        for one in self.peers.values():
            if "CONTROL_STATUS" in one.intervals:
                self.stream("CONTROL_STATUS", one)
        return ACCEPTED

    def drive(self, mode: int, speed: float, turn: float) -> None:
        """Follow a setpoint in its mode."""
        if self.mode == mode:
            timeout_s = self.values.get("GUID_TIMEOUT", STALE_S) if mode == GUIDED else STALE_S
            self.goal, self.wanted = None, (speed, turn)
            self.wanted_until_ns = self.now_ns + round(timeout_s * 1e9)

    def on_set_position_target_local_ned(self, message: Any, peer: Peer) -> None:
        if not message.type_mask & ACCELERATION:
            self.text("accelerations are not followed", peer)
        elif not message.type_mask & POSITION and self.mode == GUIDED:
            self.goal, self.has_told = (message.x, message.y), False
        elif message.coordinate_frame in (1, 7, 8, 9):
            self.drive(GUIDED, message.vx, 0.0)

    def on_set_attitude_target(self, message: Any, peer: Peer) -> None:
        self.drive(GUIDED, message.thrust, message.body_yaw_rate)

    def on_manual_control(self, message: Any, peer: Peer) -> None:
        self.drive(MANUAL, message.z / 2000, message.y / 1000)

    def on_rc_channels_override(self, message: Any, peer: Peer) -> None:
        for at, value in ((0, message.chan1_raw), (2, message.chan3_raw)):
            self.channels[at] = {0: 1500, 65_535: self.channels[at]}.get(value, value)
        self.stream("RC_CHANNELS", None)
        self.drive(MANUAL, (self.channels[2] - 1500) / 1000, (self.channels[0] - 1500) / 500)


class SigningVehicle(GoodVehicle):
    """Signs its frames, and carries out only what is signed with its key."""

    key: bytes | None = b"k" * 32

    def may(self, name: str, message: Any, peer: Peer, raw: bytes) -> bool:
        """Check the signature, then the time stamp."""
        if name in STRANGERS_MAY:
            return True
        is_begin = self.signer is None and name == "SETUP_SIGNING"
        if is_begin:
            return True
        if self.signer is None or not raw[2] & 1 or not is_signed_with(raw, self.signer.key):
            if name == "SETUP_SIGNING":
                self.text("signing: refused to a stranger", peer, 3)
            return False
        stamp, link = int.from_bytes(raw[-12:-6], "little"), (peer.number, raw[-13])
        is_new = stamp > self.stamps.get(link, 0)
        self.stamps[link] = max(stamp, self.stamps.get(link, 0))
        return is_new

    def on_setup_signing(self, message: Any, peer: Peer) -> None:
        key = bytes(message.secret_key)
        if self.is_armed:
            self.text("signing: not while armed", peer, 3)
            return
        self.signer = Signer(key, 0, 1_000) if any(key) else None
        self.stream("HEARTBEAT", None)
