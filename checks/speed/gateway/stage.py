"""A robot and its plant, observed on their bus, and a gateway that clients reach on loopback."""

import socket
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event
from typing import Final

from checks.harness.figures import Figure
from checks.harness.mavlink_client import Line, MavlinkClient, UdpLine
from checks.harness.observer import Observer, is_still, observed
from checks.harness.processes import free_port, sidestep
from checks.harness.until import until
from gateways.mavlink.mavlink_dialect import REQUEST_OPERATOR_CONTROL, mavlink
from protocol.wire.enums import Mode, Vehicle
from runtime.units import PERIOD_S

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

    def line(self) -> Line:
        """Return a new socket at the gateway."""
        return UdpLine(self.port)

    def await_standing(self) -> None:
        """Wait until the robot neither drives nor turns."""
        until(lambda: is_still(self.observer.truths[-1][0]), "the robot at rest")

    @property
    def missed(self) -> int:
        """The control periods that the robot has missed since its start."""
        return self.observer.cycles[-1][0].missed

    @property
    def ticks(self) -> int:
        """The control periods since the start of the robot."""
        return self.observer.cycles[-1][0].tick


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
        until(lambda: observer.cycles, "a cycle report")
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
