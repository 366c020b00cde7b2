"""Replace session, threads and clocks by simulated ones.

Only modules whose code would block, start a thread, read a real clock or draw a random number are
changed. All other product code runs unmodified.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from typing import Any, Final

from checks.simulation.hosts.disk import SimulatedOs
from checks.simulation.hosts.virtual_time import (
    SimulatedClock,
    SimulatedPool,
    SimulatedQueue,
    SimulatedSelectors,
    SimulatedThread,
    SimulatedThreading,
    SimulatedTime,
    SimulatedWakeUp,
    current_host,
)
from ground.client.emergency_stop import NO_WAYS
from protocol.bus.network import Hub
from protocol.bus.publisher import Publisher
from protocol.wire.message import Message
from runtime.clock import Pulse
from runtime.watchdog import Patience

THREADING: Final = SimulatedThreading()
TIME: Final = SimulatedTime()


class SeededSecrets:
    """Replaces the module `secrets` by numbers that follow from the seed."""

    draw: Callable[[int], int] = staticmethod(lambda bits: 0)

    @staticmethod
    def randbits(bits: int) -> int:
        """Draw an integer."""
        return SeededSecrets.draw(bits)

    @staticmethod
    def token_bytes(size: int) -> bytes:
        """Draw bytes."""
        return SeededSecrets.draw(8 * size).to_bytes(size, "little")


class SessionOpener:
    """Replaces the functions of protocol.bus.session; the simulation sets what they call."""

    open: Callable[[Any], Any] = staticmethod(lambda network: None)

    again: Callable[[], Any] = staticmethod(lambda: None)
    accepts: Callable[[], bool] = staticmethod(lambda: False)

    @staticmethod
    def open_session(network: Any) -> Any:
        """Open a simulated session."""
        return SessionOpener.open(network)

    @staticmethod
    def redialled(_network: Any) -> Any:
        """Open a fresh session, with a single attempt."""
        return SessionOpener.again()

    @staticmethod
    def probed(_endpoint: str) -> Hub:
        """Return whether the robot accepts a connection of this host."""
        return Hub.HANGS if SessionOpener.accepts() else Hub.UNREACHABLE


def idle() -> float:
    """Return that the machine is idle: its load is none of the simulation's."""
    return 1.0


PATIENCE: Final = partial(Patience, now_ns=TIME.monotonic_ns, slowdown=idle)


def simulated_pulse() -> Pulse:
    """Return a pulse with the clock of the current host."""
    return Pulse(current_host().now_ns)


def no_rehearsal(pulse: Any, _rehearsal: Any, _patience_ns: int) -> Any:
    """Return the pulse without rehearsals, which only cost time here."""
    return pulse


def no_signal(_stop: Callable[[], None]) -> None:
    """Install no handler: a simulated process is stopped by a call of its `stop`."""


def sparing_put(self: Any, message: Message) -> bytes:
    """Publish, but encode only every eighth frame that nothing observes.

    Those frames are encoded to find values that cannot be encoded.
    """
    if self._matching.now.quiet:
        self.unobserved = getattr(self, "unobserved", 0) + 1
        if self.unobserved % 8:
            return b""
    frame: bytes = self.frame(message)
    self.put_frame(frame)
    return frame


class PlainPublisher:
    """Replaces Zenoh's advanced publisher; the simulation keeps no history."""

    def __init__(self, session: Any, key: str, _newest: int, **service: Any) -> None:
        self._publisher = session.declare_publisher(key, **service)

    def put(self, payload: bytes, **options: Any) -> None:
        """Publish a payload."""
        self._publisher.put(payload, **options)


def plain_subscriber(session: Any, key: str, _newest: int, take: Any) -> Any:
    """Subscribe without history."""
    return session.declare(lambda one: one.declare_subscriber(key, take))


BLOCKING: Final[tuple[tuple[str, dict[str, object]], ...]] = (
    ("threading", {"threading": THREADING}),
    ("time", {"time": TIME, "monotonic": TIME.monotonic, "monotonic_ns": TIME.monotonic_ns}),
    ("queue", {"SimpleQueue": SimulatedQueue, "Thread": SimulatedThread}),
    ("secrets", {"secrets": SeededSecrets}),
    ("protocol.pulse", {"WakeUp": SimulatedWakeUp}),
)
BLOCKS: Final = (
    "protocol.bus.bus",
    "protocol.bus.session",
    "protocol.bus.services",
    "protocol.bus.publisher",
    "protocol.bus.publisher",
    "protocol.bus.robot_clock",
    "runtime.clock",
    "ground.client.emergency_stop",
    "ground.client.requests",
    "gateways.mavlink.bus_port",
    "gateways.mavlink.gateway",
    "ground.station.robot.background_requests",
    "ground.station.station",
    "ground.station.reader",
    "robot.process",
    "robot.file_writer",
    "plant.process.loop",
    "plant.process.loop",
    "runtime.lockstep",
)
"""Modules in which each blocking name that they have is replaced."""

SPECIAL: Final[tuple[tuple[str, str, object], ...]] = (
    ("protocol.bus.bus", "open_session", SessionOpener.open_session),
    ("protocol.bus.bus", "probed", SessionOpener.probed),
    ("protocol.bus.bus", "redialled", SessionOpener.redialled),
    ("protocol.bus.bus", "fetching_subscriber", plain_subscriber),
    ("protocol.bus.publisher", "caching_publisher", PlainPublisher),
    ("protocol.bus.session", "slowdown", idle),
    ("robot.run", "WallClock", SimulatedClock),
    ("robot.run", "Pulse", simulated_pulse),
    ("robot.run", "time", TIME.time),
    ("robot.run", "RehearsingPulse", no_rehearsal),
    ("robot.run", "Rehearsal", lambda _params: None),
    ("robot.run", "on_signal", no_signal),
    ("ground.client.link", "Pulse", simulated_pulse),
    ("gateways.mavlink.bus_port", "ThreadPoolExecutor", SimulatedPool),
    ("gateways.mavlink.gateway", "selectors", SimulatedSelectors),
    ("ground.client.stop_ways", "ways_of", lambda _bus, _robot: NO_WAYS),
    ("plant.process.loop", "Patience", PATIENCE),
    ("protocol.bus.publisher", "Patience", PATIENCE),
    ("runtime.files", "os", SimulatedOs),
    ("runtime.files", "os", SimulatedOs),
    ("runtime.files", "Path", lambda path: path),
)


def replacements() -> Iterator[tuple[Any, str, object]]:
    """Yield modules, names and their substitutes."""
    for module_name in BLOCKS:
        module = import_module(module_name)
        for _, names in BLOCKING:
            for name, stand_in in names.items():
                if name in vars(module):
                    yield module, name, stand_in
    yield Publisher, "put", sparing_put
    for module_name, name, stand_in in SPECIAL:
        module = import_module(module_name)
        if name not in vars(module):
            raise LookupError(
                f"{module_name} has no {name}: adapt the simulation's list of substitutes"
            )
        yield module, name, stand_in


@contextmanager
def substituted() -> Iterator[None]:
    """Simulate everything that is opened within; cannot be nested."""
    before: list[tuple[Any, str, object]] = []
    try:
        for module, name, stand_in in replacements():
            before.append((module, name, vars(module)[name]))
            setattr(module, name, stand_in)
        yield
    finally:
        for module, name, original in reversed(before):
            setattr(module, name, original)
