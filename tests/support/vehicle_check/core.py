"""The core of a fake vehicle, and a network of the judge in simulated time."""

from typing import Any, Protocol

from pymavlink.dialects.v20 import ardupilotmega

from vehicle_check.mavlink_frames import EXTRA, Signer, number_of
from vehicle_check.networks import Heard

mavlink: Any = ardupilotmega
GONE_NS = 10_000_000_000
ACCEPTED, DENIED, UNSUPPORTED, FAILED, NOT_IN_CONTROL = 0, 2, 3, 4, 10


class Peer:
    """One ground station as the vehicle sees it."""

    def __init__(self, number: int, system: int, now_ns: int) -> None:
        self.number = number
        self.system = system
        self.component = 190
        self.heard_ns = now_ns
        self.parser = mavlink.MAVLink(None)
        self.parser.robust_parsing = True
        self.encoder = mavlink.MAVLink(None)
        self.due: dict[str, int] = {}
        self.intervals: dict[str, int] = {}


class Core:
    """Peers and frames. Messages go to the method `on_NAME`, with the peer."""

    system = 1
    key: bytes | None = None

    def __init__(self) -> None:
        self.sends: list[tuple[int, bytes]] = []
        self.peers: dict[int, Peer] = {}
        self.now_ns = 0
        self.signer = None if self.key is None else Signer(self.key, 0, 1_000)
        self.stamps: dict[tuple[int, int], int] = {}

    def receive(self, peer: int, data: bytes, now_ns: int) -> None:
        """Decode and dispatch."""
        self.now_ns = now_ns
        known = self.peers.setdefault(peer, Peer(peer, 255, now_ns))
        known.heard_ns = now_ns
        for message in known.parser.parse_buffer(data) or ():
            raw = bytes(message.get_msgbuf() or b"")
            if message.get_msgId() < 0 or len(raw) < 12:
                continue
            known.system, known.component = message.get_srcSystem(), message.get_srcComponent()
            layout = EXTRA.get(number_of(raw))
            fields = message if layout is None else layout.decode(raw)
            if fields is not None:
                self.dispatch(message.get_type(), fields, known, raw)

    def dispatch(self, name: str, message: Any, peer: Peer, raw: bytes) -> None:
        """Call the handler if the message is for this vehicle."""
        if getattr(message, "target_system", getattr(message, "target", 0)) not in (0, self.system):
            return
        handler = getattr(self, f"on_{name.lower()}", None)
        if handler is not None and self.may(name, message, peer, raw):
            handler(message, peer)

    def may(self, name: str, message: Any, peer: Peer, raw: bytes) -> bool:
        """Return True if a frame may be executed; overridden by signing."""
        return True

    def due(self, now_ns: int) -> None:
        """Forget silent peers."""
        self.now_ns = now_ns
        for peer in list(self.peers.values()):
            if now_ns - peer.heard_ns >= GONE_NS:
                del self.peers[peer.number]

    def send(self, message: Any, peer: Peer | None = None) -> None:
        """Send to one peer, or to all."""
        for one in [peer] if peer is not None else list(self.peers.values()):
            encoder = one.encoder
            encoder.srcSystem, encoder.srcComponent = self.system, 1
            frame = message.pack(encoder)
            encoder.seq = self.next_sequence(encoder.seq)
            if self.signer is not None:
                frame = self.signer.signed(frame)
            self.sends.append((one.number, frame))

    def next_sequence(self, sequence: int) -> int:
        """Return the sequence number after another one."""
        return (sequence + 1) % 256

    def text(self, words: str, peer: Peer | None = None, severity: int = 4) -> None:
        """Send a STATUSTEXT."""
        self.send(mavlink.MAVLink_statustext_message(severity, words.encode()[:50]), peer)

    @property
    def boot_ms(self) -> int:
        """The time of messages."""
        return self.now_ns // 1_000_000 & 0xFFFFFFFF


STEP_NS = 10_000_000


class InProcessVehicle(Protocol):
    """A vehicle whose frames for each peer are taken from `sends`."""

    sends: list[tuple[int, bytes]]

    def receive(self, peer: int, data: bytes, now_ns: int) -> None:
        """Process bytes of one peer."""

    def due(self, now_ns: int) -> None:
        """Let time pass."""


class MemoryNetwork:
    """Connections to vehicles in this process; the time advances only while the judge waits."""

    is_stream = False
    is_shared = False
    is_loopback = False
    held_up_ns = 0

    def __init__(self, *vehicles: InProcessVehicle) -> None:
        self._vehicles = vehicles
        self._now_ns = 1_000_000_000
        self._due_ns = 0
        self._peers = 0
        self.is_closed = False

    def now_ns(self) -> int:
        """Return the simulated time."""
        return self._now_ns

    def open(self) -> int:
        """Open one more connection."""
        self._peers += 1
        return self._peers - 1

    def send(self, peer: int, data: bytes) -> None:
        """Give bytes to all vehicles, which share one port."""
        for vehicle in self._vehicles:
            vehicle.receive(peer, data, self._now_ns)

    def receive(self, until_ns: int) -> list[Heard]:
        """Advance the time until something arrives."""
        while True:
            found = self._taken()
            if found or self._now_ns >= until_ns:
                return found
            self._now_ns = min(self._now_ns + STEP_NS, until_ns)
            if self._now_ns >= self._due_ns:
                self._due_ns = self._now_ns + STEP_NS
                for vehicle in self._vehicles:
                    vehicle.due(self._now_ns)

    def close(self) -> None:
        """Note it."""
        self.is_closed = True

    def _taken(self) -> list[Heard]:
        found = []
        for vehicle in self._vehicles:
            sends, vehicle.sends = vehicle.sends, []
            found += [Heard(peer, data, self._now_ns) for peer, data in sends]
        return found
