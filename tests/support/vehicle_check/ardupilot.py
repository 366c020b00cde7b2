"""A vehicle that does what a real ArduPilot Rover does otherwise than Sidestep.

As read in the sources of ArduPilot 4.7: Rover/GCS_MAVLink_Rover.cpp, libraries/GCS_MAVLink.
"""

from math import hypot, isfinite
from typing import Any

from tests.support.vehicle_check.core import ACCEPTED, FAILED, UNSUPPORTED, Peer, mavlink
from tests.support.vehicle_check.good import GoodVehicle
from tests.support.vehicle_check.plans import KNOWN
from tests.support.vehicle_check.streams import CAPABILITIES, GROUPS, RATES

BY_ITSELF = ("HEARTBEAT", "MISSION_CURRENT", "FENCE_STATUS")
WP_RADIUS_M = 2.0
INT8, INT16 = 2, 4
RALLY, CALIBRATION = 262_144, 4096
ABSENT = ("CONTROL_STATUS", "OBSTACLE_DISTANCE", "DISTANCE_SENSOR", "RANGEFINDER")


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
            for name in (
                "HOME_POSITION",
                "EKF_STATUS_REPORT",
                "LOCAL_POSITION_NED_COV",
                "ODOMETRY",
            ):
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

    def build_component_metadata(self) -> Any:
        """Serve no descriptions."""
        return None

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
