"""Vehicles with faults, one that sends garbage, and one that does as a real ArduPilot Rover."""

import random
from math import hypot, isfinite, nan
from typing import Any, ClassVar

from tests.support.vehicle_check.core import (
    ACCEPTED,
    FAILED,
    NOT_IN_CONTROL,
    UNSUPPORTED,
    Core,
    Peer,
    mavlink,
)
from tests.support.vehicle_check.good import (
    CAPABILITIES,
    GROUPS,
    KNOWN,
    RATES,
    GoodVehicle,
    Streams,
)
from vehicle_check.mavlink_frames import COMPONENT_METADATA, ExtraMessage


class MuteVehicle(Core):
    """Sends the heartbeat of a copter from component 2, to one client, and answers nothing."""

    def due(self, now_ns: int) -> None:
        """Send heartbeats, every 2 s."""
        super().due(now_ns)
        if now_ns % 2_000_000_000 < 20_000_000:
            for peer in list(self.peers.values())[:1]:
                self.send(mavlink.MAVLink_heartbeat_message(2, 12, 0, 5, 3, 3), peer)


class CarelessVehicle(GoodVehicle):
    """Sends answers to all clients, skips sequence numbers, and ignores targets."""

    own: ClassVar = {"WP_RADIUS": 0.5, "CRUISE_SPEED": 1.0, "A_NAME_THAT_IS_LONG": 1.0}

    def next_sequence(self, sequence: int) -> int:
        """Return a number with a gap now and then."""
        return (sequence + 1 + (sequence % 50 == 0)) % 256

    def dispatch(self, name: str, message: Any, peer: Peer, raw: bytes) -> None:
        """Take everything for its own, and forward it."""
        for one in list(self.peers.values()):
            if one is not peer and name != "HEARTBEAT":
                self.sends.append((one.number, raw))
        handler = getattr(self, f"on_{name.lower()}", None)
        if handler is not None:
            handler(message, peer)

    def build_heartbeat(self) -> Any:
        """Return a heartbeat that is always ACTIVE."""
        self.state = 4
        return super().build_heartbeat()

    def stream(self, name: str, peer: Peer | None) -> bool:
        """Send a heartbeat of a gimbal with an unknown mode, too."""
        if name == "HEARTBEAT":
            encoder = mavlink.MAVLink(None, self.system, 154)
            gimbal = mavlink.MAVLink_heartbeat_message(26, 8, 0, 99, 4, 3).pack(encoder)
            self.sends += [(one, gimbal) for one in self.peers]
        return super().stream(name, peer)


class YesVehicle(Streams):
    """Accepts every command and does nothing; its values are wrong."""

    def build_heartbeat(self) -> Any:
        """Return a heartbeat without its mode's flag."""
        return mavlink.MAVLink_heartbeat_message(10, 3, 0, self.mode, 4, 3)

    def place(self) -> tuple[int, int]:
        """Report the position 0/0."""
        return 0, 0

    def build_component_metadata(self) -> Any:
        """Link to nothing."""
        return ExtraMessage(COMPONENT_METADATA, uri=b"http://example.org/x")

    def on_command_long(self, message: Any, peer: Peer) -> None:
        self.send(mavlink.MAVLink_command_ack_message(message.command, ACCEPTED))
        self.send(mavlink.MAVLink_command_ack_message(message.command, ACCEPTED))


COPY_NS = 150_000_000
CACHED_NS = 10_000_000_000
REPEATED_NS = 1_500_000_000
LOCKED_NS = 5_000_000_000
FORCE_BIT = 0b10_0000_0000


class HastyVehicle(GoodVehicle):
    """Passes rows 1 to 60 but a few, and has the defects that further clients found in one."""

    own: ClassVar = {"RADIUS_X": 0.5, "SPEED_X": 0.4, "NAVIGATOR_X": 2.0}
    on_request = ()

    def __init__(self) -> None:
        super().__init__()
        self.copies: list[tuple[int, Any, Peer]] = []
        self.cached: dict[str, tuple[int, Any]] = {}
        self.port, self.port_ns = -1, 0

    def due(self, now_ns: int) -> None:
        """Send the copies of acknowledgements."""
        super().due(now_ns)
        for at_ns, message, peer in self.copies:
            if at_ns <= now_ns:
                self.send(message, peer)
        self.copies = [one for one in self.copies if one[0] > now_ns]

    def acknowledge(self, number: int, result: int, peer: Peer) -> None:
        """Acknowledge, and send a copy a little later."""
        super().acknowledge(number, result, peer)
        ack = mavlink.MAVLink_command_ack_message(number, result, 0, 0, peer.system, peer.component)
        self.copies.append((self.now_ns + COPY_NS, ack, peer))

    def command(
        self, number: int, params: list[float], place: tuple[int, int], again: int, peer: Peer
    ) -> None:
        """Serve one port of a system only."""
        if number == 176 and params[1] != 4:
            is_locked = self.now_ns - self.port_ns < LOCKED_NS
            if self.port not in (-1, peer.number) and peer.system == 255 and is_locked:
                self.text("another operator commands the robot: MAVLink 255", peer)
                self.acknowledge(number, NOT_IN_CONTROL, peer)
                return
        self.port, self.port_ns = peer.number, self.now_ns
        super().command(number, params, place, again, peer)

    def command_178(self, params: list[float], peer: Peer) -> int:
        """Keep the speed as a parameter."""
        if params[1] > 0:
            self.values["SPEED_X"] = params[1]
        return ACCEPTED

    def on_param_request_read(self, message: Any, peer: Peer) -> None:
        """Give what was read before for ten seconds."""
        name = message.param_id
        at_ns, answer = self.cached.get(name, (-CACHED_NS, None))
        if message.param_index >= 0 or name not in self.values:
            super().on_param_request_read(message, peer)
            return
        if self.now_ns - at_ns >= CACHED_NS:
            at_ns, answer = self.cached[name] = self.now_ns, self.value(name)
        self.send(answer, peer)

    def fault(self, one: Any, x: int, kind: int) -> int:
        """Know waypoints only."""
        return super().fault(one, x, kind) or (3 if one.command in (20, 93, 178) else 0)

    def give(self, message: Any, peer: Peer, *, as_float: bool) -> None:
        """Give items without their altitude."""
        plan = self.plans[message.mission_type]
        values, place, _ = plan[message.seq]
        plan[message.seq] = ((*values[:5], 0.05, values[6], nan), place, 0.0)
        super().give(message, peer, as_float=as_float)

    def on_set_position_target_local_ned(self, message: Any, peer: Peer) -> None:
        """Refuse a force, although it is only a flag."""
        if message.type_mask & FORCE_BIT:
            self.text("set the bits of type_mask that ignore the acceleration", peer)
        else:
            super().on_set_position_target_local_ned(message, peer)

    def build_heartbeat(self) -> Any:
        """Show no mode in base_mode."""
        message = super().build_heartbeat()
        message.base_mode &= ~72
        return message

    def build_nav_controller_output(self) -> Any:
        """Say nothing of the goal."""
        return None

    build_position_target_global_int = build_nav_controller_output


class StaleVehicle(GoodVehicle):
    """Gives an answer again for a while, although its state may have ended."""

    def __init__(self) -> None:
        super().__init__()
        self.answered: dict[tuple[int, int, tuple[float, ...]], int] = {}

    def command(
        self, number: int, params: list[float], place: tuple[int, int], again: int, peer: Peer
    ) -> None:
        """Accept again what was accepted."""
        key = peer.number, number, tuple(params)
        if number == 400 and self.now_ns - self.answered.get(key, -REPEATED_NS) < REPEATED_NS:
            self.acknowledge(number, ACCEPTED, peer)
            return
        self.answered[key] = self.now_ns
        super().command(number, params, place, again, peer)


class GarbageVehicle(GoodVehicle):
    """Sends random and cut frames among those of a good vehicle."""

    def __init__(self) -> None:
        super().__init__()
        self.chance = random.Random(7)

    def send(self, message: Any, peer: Peer | None = None) -> None:
        """Spoil some frames."""
        before = len(self.sends)
        super().send(message, peer)
        for at in range(before, len(self.sends)):
            number, frame = self.sends[at]
            kind = self.chance.randrange(8)
            if kind == 0:
                frame = frame[: self.chance.randrange(len(frame))]
            elif kind == 1:
                frame = self.chance.randbytes(self.chance.randrange(280))
            elif kind == 2:
                spoiled = bytearray(frame)
                spoiled[self.chance.randrange(len(spoiled))] ^= 1 << self.chance.randrange(8)
                frame = bytes(spoiled)
            self.sends[at] = number, frame


BY_ITSELF = ("HEARTBEAT", "MISSION_CURRENT", "FENCE_STATUS")
WP_RADIUS_M = 2.0
INT8, INT16 = 2, 4
RALLY, CALIBRATION = 262_144, 4096
ABSENT = (
    *("CONTROL_STATUS", "OBSTACLE_DISTANCE", "DISTANCE_SENSOR", "RANGEFINDER"),
    *("LOCAL_POSITION_NED_COV", "ODOMETRY", "COMPONENT_METADATA"),
)
UNKNOWN_NUMBERS = (64, 331, 397)
"""Messages that ArduPilot does not have: those of the last row."""


class ArduPilotLike(GoodVehicle):
    """Sends little before it is asked; has no sonars, wheel encoders or operator control."""

    def __init__(self) -> None:
        super().__init__()
        self.rates = {name: rate for name, rate in RATES.items() if name not in ABSENT}
        more = {"WP_RADIUS": WP_RADIUS_M, "FRAME_CLASS": 1.0, "COMPASS_DEV_ID": 97_539.0}
        self.values |= more | {"COMPASS_OFS_X": 12.0, "COMPASS_USE": 1.0}
        self.kinds |= dict.fromkeys(more, INT16) | {"FRAME_CLASS": INT8, "WP_RADIUS": 9}

    def receive(self, peer: int, data: bytes, now_ns: int) -> None:
        """Stream only the heartbeat to a new peer."""
        is_new = peer not in self.peers
        super().receive(peer, data, now_ns)
        if is_new:
            silent = [name for name in self.rates if name not in BY_ITSELF]
            self.peers[peer].intervals = dict.fromkeys(silent, 0) | self.peers[peer].intervals

    def on_request_data_stream(self, message: Any, peer: Peer) -> None:
        """Give all messages of a group the same rate."""
        super().on_request_data_stream(message, peer)
        if message.start_stop and message.req_stream_id in GROUPS:
            for name in ("HOME_POSITION", "EKF_STATUS_REPORT"):
                peer.intervals[name] = 1_000_000_000 // 3

    def build_sys_status(self) -> Any:
        """Show no range finder."""
        bits = mavlink.MAV_SYS_STATUS_PREARM_CHECK | mavlink.MAV_SYS_STATUS_GEOFENCE
        return mavlink.MAVLink_sys_status_message(bits, bits, bits, *[0] * 10)

    def build_global_position_int(self) -> Any:
        """Be some metres off by the barometer."""
        message = super().build_global_position_int()
        message.relative_alt = -1_700
        return message

    def build_autopilot_version(self) -> Any:
        """Be an official release."""
        message = super().build_autopilot_version()
        message.flight_sw_version |= 255
        message.capabilities = CAPABILITIES | RALLY | CALIBRATION
        return message

    def build_wheel_distance(self) -> Any:
        """Have no wheel encoders; the request is accepted all the same."""
        return []

    def command_511(self, params: list[float], peer: Peer) -> int:
        """Know no rate of a message that is not there."""
        return FAILED if params[0] in UNKNOWN_NUMBERS else super().command_511(params, peer)

    def command_512(self, params: list[float], peer: Peer) -> int:
        """Know no message that is not there."""
        return FAILED if params[0] in UNKNOWN_NUMBERS else super().command_512(params, peer)

    def on_param_request_read(self, message: Any, peer: Peer) -> None:
        """Give no index to a parameter that is read by its name."""
        if message.param_index >= 0:
            super().on_param_request_read(message, peer)
        elif message.param_id in self.values:
            answer = self.value(message.param_id)
            answer.param_index = 0xFFFF
            self.send(answer, peer)

    def on_param_set(self, message: Any, peer: Peer) -> None:
        """Ignore what is no number; change anything else."""
        if isfinite(message.param_value) and message.param_id in self.values:
            self.values[message.param_id] = message.param_value
            super().on_param_set(message, peer)

    def take(self, one: Any, peer: Peer, x: int, y: int) -> None:
        """Take exclusion fences, too."""
        KNOWN[1] |= {5002, 5004}
        try:
            super().take(one, peer, x, y)
        finally:
            KNOWN[1] -= {5002, 5004}

    def reposition(self, place: tuple[int, int]) -> int:
        """Count a place as reached within WP_RADIUS."""
        result = super().reposition(place)
        if self.goal is not None and hypot(self.goal[0] - self.x, self.goal[1] - self.y) < 2:
            self.goal = None
        return result

    def command_178(self, params: list[float], peer: Peer) -> int:
        """Refuse a speed in HOLD."""
        return FAILED

    def command_246(self, params: list[float], peer: Peer) -> int:
        """Refuse a restart with FAILED."""
        return FAILED if self.is_armed else ACCEPTED

    def command_42426(self, params: list[float], peer: Peer) -> int:
        """Cancel a calibration of the compasses that is not under way."""
        return ACCEPTED

    def command_32100(self, params: list[float], peer: Peer) -> int:
        """Know nothing of operator control."""
        return UNSUPPORTED


class OneConnection(GoodVehicle):
    """Serves the first ground station only, as a serial line or SITL's TCP port does."""

    def receive(self, peer: int, data: bytes, now_ns: int) -> None:
        """Ignore all others."""
        if not self.peers or peer in self.peers:
            super().receive(peer, data, now_ns)
