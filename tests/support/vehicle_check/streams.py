"""Streams and requests of messages of a fake vehicle."""

from math import cos, sin
from typing import Any

from tests.support.vehicle_check.core import ACCEPTED, UNSUPPORTED, Core, Peer, mavlink
from vehicle_check.mavlink_frames import (
    AVAILABLE_MODES,
    COMPONENT_METADATA,
    CONTROL_STATUS,
    CURRENT_MODE,
    MISSION_CURRENT,
    TIMESYNC,
    ExtraMessage,
)  # fmt: skip

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
}  # fmt: skip
GROUPS = {
    2: ("SYS_STATUS", "GPS_RAW_INT"), 3: ("RC_CHANNELS",), 10: ("ATTITUDE",), 11: ("VFR_HUD",),
    6: ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"), 12: ("SYSTEM_TIME", "BATTERY_STATUS"),
}  # fmt: skip
CAPABILITIES = 1 | 2 | 4 | 8 | 32 | 128 | 256 | 2048 | 8192 | 16384 | 131072


class Streams(Core):
    """A vehicle that stands at the origin and sends all streams."""

    rates = RATES

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
                interval = peer.intervals.get(name, 1_000_000_000 // rate)
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
        armed = 128 if self.is_armed else 0
        return mavlink.MAVLink_heartbeat_message(10, 3, 1 | armed, self.mode, self.state, 3)

    def build_sys_status(self) -> Any:
        bits = 0x10000000 | 0x100000 | 0x4000000
        return mavlink.MAVLink_sys_status_message(bits, bits, bits, *[0] * 10)

    def build_ekf_status_report(self) -> Any:
        return mavlink.MAVLink_ekf_status_report_message(16 | 512, 0.1, 0.1, 0, 0.1, 0)

    def place(self) -> tuple[int, int]:
        """Latitude and longitude."""
        return LAT + round(self.x / 0.0111319), LON + round(self.y / 0.0111319 / 0.8155)

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
        return ACCEPTED if self.stream(name, peer) else UNSUPPORTED

    def interval_of(self, number: int, peer: Peer) -> None:
        """Send MESSAGE_INTERVAL."""
        name = mavlink.mavlink_map[number].msgname
        interval_us = peer.intervals.get(name, 1_000_000_000 // self.rates.get(name, 1)) // 1000
        self.send(mavlink.MAVLink_message_interval_message(number, interval_us), peer)

    def set_interval(self, number: int, interval_us: float, peer: Peer) -> int:
        """Change the rate of one message."""
        name = mavlink.mavlink_map[number].msgname
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
