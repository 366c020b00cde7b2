"""A gateway for MAVLink on a played loop: the test is its peers, its robots, and moves its time."""

import asyncio
import atexit
from collections.abc import Callable, Sequence
from typing import Any, Final, cast

from checks.harness.loop import PlayedLoop
from gateways.mavlink.bus_port import BusPort
from gateways.mavlink.endpoints import Arrival, Endpoint, Receiver
from gateways.mavlink.gateway import Gateway
from gateways.mavlink.mav_vehicle import Face, MavVehicle, Work
from gateways.mavlink.robot_port import RobotPort
from gateways.mavlink.signing import SigningGuard
from gateways.mavlink.traffic_recorder import TrafficRecorder
from runtime.clock import ManualClock

LOOP: Final = PlayedLoop(ManualClock())
"""Runs the work of all vehicles without a gateway; nothing there waits for a time."""
atexit.register(LOOP.close)
atexit.register(LOOP.advance)  # before: what has just begun need not be waited for


class PlayedWork:
    """Runs the work of a vehicle without a gateway, when it is told to."""

    def __init__(self, vehicle: MavVehicle, loop: PlayedLoop = LOOP) -> None:
        self.loop = loop
        self._tasks: set[asyncio.Task[None]] = set()
        vehicle.go_on = self._go_on

    def within(self, call: Callable[..., object], *arguments: Any) -> None:
        """Call a function in the event loop."""

        async def inside() -> None:
            call(*arguments)

        self.loop.run(inside())

    def _go_on(self, work: Work) -> None:
        task: Any = self.loop.create_task(work)
        task._log_destroy_pending = False  # a test may end while a robot has not answered
        self._tasks.add(task)

    def settle(self) -> None:
        """Run what need not wait any more; raise its errors."""
        self.loop.advance()
        ended = {task for task in self._tasks if task.done()}
        self._tasks -= ended
        for task in ended:
            task.result()


class PlayedEndpoint:
    """An endpoint whose peers are the test; it keeps what is sent to them."""

    text = "test"
    line_bytes_s = None
    is_reliable = False
    is_attached = False

    def __init__(self) -> None:
        self.is_loopback = True
        self.sent: list[tuple[str, bytes]] = []

    async def attach(self, receiver: Receiver) -> None:
        """Begin to receive."""
        self._receiver, self._loop = receiver, asyncio.get_running_loop()
        self.is_attached = True

    def deliver(self, peer: str, data: bytes) -> None:
        """Let bytes of a peer arrive in the next turn of the loop."""
        arrived = [Arrival(peer, data, self.is_loopback)]
        self._loop.call_soon_threadsafe(self._receiver.received, self, arrived)

    def send(self, peer: str, data: bytes, *, is_stream: bool) -> None:
        """Keep a frame."""
        self.sent.append((peer, data))

    def forget(self, peer: str) -> None:
        """Keep nothing of a peer."""

    def close(self) -> None:
        """Close nothing."""


class PlayedGateway:
    """A gateway that serves while the test lets time pass."""

    def __init__(
        self,
        endpoint: Endpoint,
        faces: Sequence[Face],
        ports: Sequence[RobotPort],
        clock: ManualClock,
        recorder: TrafficRecorder | None = None,
        guard: SigningGuard | None = None,
    ) -> None:
        self.clock, self.loop = clock, PlayedLoop(clock)
        on_bus = cast("Sequence[BusPort]", ports)
        self.gateway = Gateway([endpoint], faces, on_bus, cast("Any", clock), recorder, guard)
        self._serving = self.loop.create_task(self.gateway.serve())
        self.advance()

    def advance(self, ns: int = 0) -> None:
        """Let time pass at once, then run what is due; raise what ended the gateway."""
        self.clock.advance(ns)
        self.loop.advance()
        if self._serving.done():
            self._serving.result()

    def close(self) -> None:
        """End the gateway."""
        for task in asyncio.all_tasks(self.loop):
            task.cancel()
        self.gateway.close()
        self.loop.advance()
        self.loop.close()
