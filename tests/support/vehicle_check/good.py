"""A vehicle that passes all rows: commands, control, driving, signing."""

from math import cos, hypot, isnan, sin
from typing import Any

from tests.support.vehicle_check.core import (
    ACCEPTED,
    DENIED,
    FAILED,
    NOT_IN_CONTROL,
    UNSUPPORTED,
    Peer,
    mavlink,
)  # fmt: skip
from tests.support.vehicle_check.plans import Plans
from tests.support.vehicle_check.streams import HOLD, LAT, LON, MODES
from vehicle_check.mavlink_frames import REQUEST_OPERATOR_CONTROL, Signer, is_signed_with

GUIDED, MANUAL, AUTO = 15, 0, 10
STALE_NS = 1_000_000_000
STEP_NS = 10_000_000
OPEN_COMMANDS = {512, 511, 510, 520, 410, 401, 42428}
STRANGERS_MAY = {"HEARTBEAT"}


class GoodVehicle(Plans):
    """Simulates a ground rover of ArduPilot, as far as the rows require."""

    def __init__(self) -> None:
        super().__init__()
        self.goal: tuple[float, float] | None = None
        self.wanted = (0.0, 0.0)
        self.wanted_ns = 0
        self.is_stopped = False
        self.drive_since_ns = 0

    def due(self, now_ns: int) -> None:
        """Drive one step."""
        if self.goal is not None:
            away = self.goal[0] - self.x, self.goal[1] - self.y
            left = hypot(*away)
            self.speed = 0.2 if left > 0.01 and self.is_armed else 0.0
            if self.speed:
                self.x += 0.002 * away[0] / left
                self.y += 0.002 * away[1] / left
        else:
            is_fresh = now_ns - self.wanted_ns < STALE_NS // 2
            self.speed, self.turn = self.wanted if is_fresh and self.is_armed else (0.0, 0.0)
            self.x += self.speed * cos(self.yaw) / 100
            self.y += self.speed * sin(self.yaw) / 100
            self.yaw += self.turn / 100
        super().due(now_ns)

    def set_mode(self, mode: int) -> None:
        """Change the mode, and say so at once."""
        self.mode, self.goal, self.wanted = mode, None, (0.0, 0.0)
        self.state = 6 if self.is_stopped else 3 if mode == HOLD else 4
        if mode == AUTO and len(self.plans[0]) > 1:
            self.goal, self.mission_state = self.local(self.plans[0][1][1]), 3
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
            result = UNSUPPORTED if handler is None else handler(params, peer)
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
            return DENIED
        self.goal = self.local(place)
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
            return DENIED
        self.set_mode(round(params[1]))
        return ACCEPTED

    def command_400(self, params: list[float], peer: Peer) -> int:
        self.is_armed = params[0] == 1
        self.stream("HEARTBEAT", None)
        return ACCEPTED

    def command_300(self, params: list[float], peer: Peer) -> int:
        if params[0] or params[1]:
            return DENIED
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
        return DENIED if self.is_armed else ACCEPTED

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
        self.stream("CONTROL_STATUS", None)
        return ACCEPTED

    def drive(self, mode: int, speed: float, turn: float) -> None:
        """Follow a setpoint in its mode."""
        if self.mode == mode:
            self.goal, self.wanted, self.wanted_ns = None, (speed, turn), self.now_ns

    def on_set_position_target_local_ned(self, message: Any, peer: Peer) -> None:
        if not message.type_mask & 0x40:
            self.text("accelerations are not followed", peer)
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
