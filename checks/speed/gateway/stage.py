"""A robot and its plant, observed on their bus, and a gateway that clients reach on loopback.

The client is a ground station on pymavlink, over UDP or a serial line, with times of its traffic.
"""

import os
import select
import socket
import termios
import threading
import tty
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from itertools import cycle
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event
from time import monotonic, monotonic_ns, time_ns
from typing import Any, Final, NamedTuple, Protocol, Self

from checks.harness.figures import Figure
from checks.harness.observer import Observer, is_still, keeper, observed
from checks.harness.processes import free_port, sidestep
from checks.harness.relays import LARGEST
from checks.harness.until import until
from gateways.mavlink.mavlink_dialect import REQUEST_OPERATOR_CONTROL, MavMessage, mavlink
from gateways.mavlink.signing import EPOCH_S, STAMP_NS
from protocol.topics import CYCLE
from protocol.wire.enums import Mode, Vehicle
from protocol.wire.messages import CycleReport
from runtime.units import NS_PER_S, PERIOD_S

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

    def __init__(self, line: Line, *, key: bytes | None = None) -> None:
        self.line = line
        self.newest: dict[str, Any] = {}
        self.arrivals: list[FrameArrival] = []
        self.texts: list[str] = []
        self.sent: list[bytes] | None = None
        self.takes: Callable[[MavMessage], object] = lambda _: None
        self._mav: Any = mavlink.MAVLink(self, srcSystem=GROUND_STATION, srcComponent=190)
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


WORLD: Final = "open"
FORCED: Final = 21196.0
NEAR_M: Final = 0.5
FAST_M_S: Final = 0.2
GOTO_MASK: Final = 0b1101_1111_1000
"""A SET_POSITION_TARGET with a position only."""

Figures = tuple[list[Figure], list[str]]


@dataclass
class Air:
    """A robot with its gateway: where clients connect, and the process id of the gateway."""

    observer: Observer
    pid: int
    port: int
    cycles: deque[tuple[CycleReport, int]] = field(default_factory=lambda: deque(maxlen=1))

    def line(self) -> Line:
        """Return a new socket at the gateway."""
        return UdpLine(self.port)

    def await_standing(self) -> None:
        """Wait until the robot neither drives nor turns."""
        until(lambda: is_still(self.observer.truths[-1][0]), "the robot at rest")

    @property
    def missed(self) -> int:
        """The control periods that the robot has missed since its start."""
        return self.cycles[-1][0].missed

    @property
    def ticks(self) -> int:
        """The control periods since the start of the robot."""
        return self.cycles[-1][0].tick


@contextmanager
def on_air(*words: str, endpoints: Sequence[str] = ()) -> Iterator[Air]:
    """Run a robot with its plant, and a gateway with these words.

    Without `endpoints` it listens to a UDP port. A policy or a serial line needs them; `{port}` in
    them is the UDP port.
    """
    port = free_port(socket.SOCK_DGRAM)
    places = [text.format(port=port) for text in endpoints or ("udpin:127.0.0.1:{port}",)]
    with ExitStack() as scope:
        observer = scope.enter_context(observed(WORLD))
        folder = Path(scope.enter_context(TemporaryDirectory(prefix="sidestep-gateway-")))
        names = ("XDG_STATE_HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME")
        gateway = scope.enter_context(
            sidestep(
                *("run", "gateway", *places, "--connect", observer.endpoint, *words),
                ready="is MAVLink system",
                environment=dict.fromkeys(names, str(folder)),
            )
        )
        air = Air(observer, gateway.pid, port)
        observer.bus.stream(CYCLE, keeper(CYCLE, air.cycles), observer.robot)
        until(lambda: air.cycles, "a cycle report")
        yield air


class Driver:
    """A client that keeps the robot driving to and fro in GUIDED, between start and goal."""

    def __init__(self, client: MavlinkClient, air: Air) -> None:
        self._client, self._air = client, air
        start, goal = air.observer.world.start, air.observer.world.goal
        self._places = cycle([(goal.x_m, goal.y_m), (start.x_m, start.y_m)])
        self._place = next(self._places)
        self._pause = Event()

    def take(self) -> None:
        """Keep control from others, choose GUIDED, arm, and set off."""
        self._client.await_vehicle()
        self._client.command(REQUEST_OPERATOR_CONTROL, 1.0, 0.0)
        self._client.set_mode(Mode.GUIDED)
        self._client.arm()
        self.go_on()

    def go_on(self) -> None:
        """Send the place again; the other one if the robot is near it or has failed on its way."""
        truth, status = self._air.observer.truths[-1][0], self._air.observer.status
        x_m, y_m = self._place
        is_near = abs(truth.x_m - x_m) + abs(truth.y_m - y_m) < NEAR_M
        if is_near or status.vehicle == Vehicle.FAILSAFE:
            self._place = next(self._places)
        if status.vehicle == Vehicle.FAILSAFE:
            self._client.arm()
        if is_near or not self._air.observer.on_its_way:
            self._client.send(position_target(*self._place))

    def drive(self, seconds: float) -> None:
        """Keep the robot driving for a time."""
        for _ in range(round(seconds / PERIOD_S / 4)):
            self.go_on()
            self._pause.wait(4 * PERIOD_S)

    def set_off(self) -> None:
        """Clear the emergency stop and drive until the robot is fast."""
        self._client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0, FORCED)
        self._client.set_mode(Mode.GUIDED)
        observer = self._air.observer
        for _ in range(200):
            if observer.on_its_way and observer.speed_m_s > FAST_M_S:
                return
            self.drive(4 * PERIOD_S)
        raise RuntimeError(
            f"the robot does not drive: {observer.status}, {self._client.texts[-3:]}"
        )


def position_target(x_m: float, y_m: float) -> object:
    """Return a SET_POSITION_TARGET_LOCAL_NED for a place in the robot's world."""
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, mavlink.MAV_FRAME_LOCAL_NED, GOTO_MASK, y_m, x_m, 0.0,
        *(0.0,) * 8,
    )  # fmt: skip
