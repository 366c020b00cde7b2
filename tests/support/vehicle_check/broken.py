"""Three vehicles with many faults each, and one that sends garbage."""

import random
from typing import Any, ClassVar

from tests.support.vehicle_check.core import ACCEPTED, Core, Peer, mavlink
from tests.support.vehicle_check.good import GoodVehicle
from tests.support.vehicle_check.streams import Streams
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
