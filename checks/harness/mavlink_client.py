"""The MAVLink client of checks and tests: a ground station on a UDP socket or a serial line.

It receives in a thread, and notes the times of its traffic.
"""

import os
import select
import socket
import termios
import threading
import tty
from collections.abc import Callable
from contextlib import suppress
from time import monotonic, monotonic_ns, time_ns
from typing import Any, Final, NamedTuple, Protocol, Self

from checks.harness.relays import LARGEST
from checks.harness.until import until
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from gateways.mavlink.signing import EPOCH_S, STAMP_NS
from protocol.wire.enums import Mode
from runtime.units import NS_PER_S

BEAT_S: Final = 1.0
AGAIN_S: Final = 0.5
"""A command without an acknowledgement is sent again after this time."""
ANSWER_S: Final = 10.0
GROUND_STATION: Final = 255
SYSTEM: Final = 1
COMPONENT: Final = 1


class Line(Protocol):
    """A way to the gateway. `receive` returns nothing if nothing arrives in time."""

    def send(self, data: bytes) -> None:
        """Send bytes."""

    def receive(self, within_s: float) -> bytes:
        """Return the next bytes."""

    def close(self) -> None:
        """Close the line."""


class UdpLine:
    """A socket of its own at a loopback port of the gateway."""

    def __init__(self, port: int) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", port))
        self._socket.setblocking(False)

    def send(self, data: bytes) -> None:
        """Send a datagram. It is lost if the gateway does not read its socket."""
        with suppress(OSError):
            self._socket.send(data)

    def receive(self, within_s: float) -> bytes:
        """Return the next datagram."""
        return received(self._socket.fileno(), within_s)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class PseudoLine:
    """A pseudo-terminal: `device` is the end for the gateway, as a serial line."""

    def __init__(self) -> None:
        self._own, self._other = os.openpty()
        tty.setraw(self._other, termios.TCSANOW)
        self.device = os.ttyname(self._other)

    def send(self, data: bytes) -> None:
        """Send bytes."""
        os.write(self._own, data)

    def receive(self, within_s: float) -> bytes:
        """Return the bytes that have arrived."""
        return received(self._own, within_s)

    def close(self) -> None:
        """Close both ends."""
        os.close(self._own)
        os.close(self._other)


def received(descriptor: int, within_s: float) -> bytes:
    """Return what a descriptor has; nothing if nothing arrives in time."""
    if not select.select([descriptor], [], [], within_s)[0]:
        return b""
    try:
        return os.read(descriptor, LARGEST)
    except OSError:  # the port is not open, or the peer has closed the connection
        return b""


class FrameArrival(NamedTuple):
    """When a message arrived, its id, and the size of its frame."""

    at_ns: int
    number: int
    size: int


class MavlinkClient:
    """Receives in a thread, and sends a heartbeat each second there.

    `newest` holds the newest message of each type, `arrivals` the times of all, `texts` those of
    the vehicle. `sent` collects the frames that were sent while it is a list. With a `key` all
    frames are signed. `takes` is called with each message.
    """

    def __init__(
        self, line: Line, *, key: bytes | None = None, system: int = GROUND_STATION
    ) -> None:
        self.line = line
        self.newest: dict[str, Any] = {}
        self.arrivals: list[FrameArrival] = []
        self.texts: list[str] = []
        self.sent: list[bytes] | None = None
        self.takes: Callable[[MavMessage], object] = lambda _: None
        self._mav: Any = mavlink.MAVLink(self, srcSystem=system, srcComponent=190)
        self._mav.robust_parsing = True
        if key is not None:
            self._mav.signing.secret_key = key
            self._mav.signing.sign_outgoing = True
        self._lock = threading.Lock()
        self._over = False
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over = True
        self._thread.join()
        self.line.close()

    def write(self, data: bytes) -> None:
        """Send a frame; pymavlink calls this."""
        if self.sent is not None:
            self.sent.append(bytes(data))
        self.line.send(bytes(data))

    def send(self, message: MavMessage) -> int:
        """Send a message; return the time before."""
        with self._lock:
            self._mav.signing.timestamp = stamp_now()
            at_ns = monotonic_ns()
            self._mav.send(message)
        return at_ns

    def command(self, number: int, *params: float) -> int:
        """Send a COMMAND_LONG until it is accepted; return the time of the first."""
        values = (*params, *(0.0,) * (7 - len(params)))
        results: list[int] = []
        deadline_s, tries, first_ns = monotonic() + ANSWER_S, 0, 0
        self.newest.pop("COMMAND_ACK", None)
        while not results:
            if monotonic() > deadline_s:
                raise RuntimeError(f"no answer to command {number}")
            message = mavlink.MAVLink_command_long_message(
                SYSTEM, COMPONENT, number, min(tries, 255), *values
            )
            at_ns = self.send(message)
            first_ns = first_ns or at_ns
            tries += 1
            with suppress(RuntimeError):
                until(lambda: self._answers(number, results), "an answer", AGAIN_S)
        if results[0] != mavlink.MAV_RESULT_ACCEPTED:
            raise RuntimeError(f"command {number}: result {results[0]}, {self.texts[-3:]}")
        return first_ns

    def set_mode(self, mode: Mode) -> None:
        """Choose a mode."""
        self.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, float(mode))

    def arm(self) -> None:
        """Arm the robot, also after a failsafe."""
        self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)

    def await_vehicle(self) -> None:
        """Wait for the heartbeat of the vehicle."""
        until(lambda: "HEARTBEAT" in self.newest, "a heartbeat of the gateway")

    def next(
        self,
        kind: str,
        accepts: Callable[[Any], object] = lambda _: True,
    ) -> Any:
        """Wait for a message of this kind that is accepted, and arrives from now on."""
        self.newest.pop(kind, None)
        until(lambda: kind in self.newest and accepts(self.newest[kind]), kind)
        return self.newest[kind]

    def _answers(self, number: int, results: list[int]) -> bool:
        found = self.newest.get("COMMAND_ACK")
        if found is None or found.command != number:
            return False
        results.append(int(found.result))
        return True

    def _run(self) -> None:
        beat = mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3
        )
        due_s = monotonic()
        while not self._over:
            if monotonic() >= due_s:
                due_s = monotonic() + BEAT_S
                self.send(beat)
            data = self.line.receive(min(0.05, max(0.0, due_s - monotonic())))
            at_ns = monotonic_ns()
            for message in self._mav.parse_buffer(data) or () if data else ():
                self._take(message, at_ns)

    def _take(self, message: MavMessage, at_ns: int) -> None:
        kind = message.get_type()
        self.arrivals.append(FrameArrival(at_ns, message.get_msgId(), len(message.get_msgbuf())))
        self.newest[kind] = message
        if kind == "STATUSTEXT":
            self.texts.append(message.text)
        self.takes(message)


def stamp_now() -> int:
    """Return the present time as the stamp of a signature."""
    return (time_ns() - EPOCH_S * NS_PER_S) // STAMP_NS
