"""Puts the simulated session, threads and clocks in the place of the real ones.

Only modules are touched whose code would otherwise block, start a thread, read a real clock or
draw a random number. All other product code runs as it is.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any, Final

from protocol.bus.network import Hub
from protocol.bus.publisher import Publisher
from protocol.wire.message import Message
from runtime.arrivals import Pulse
from verification.simulation.hosts.disk import SimulatedOs
from verification.simulation.hosts.scheduler import current_host
from verification.simulation.hosts.threads import (
    SimulatedClock,
    SimulatedQueue,
    SimulatedThread,
    SimulatedThreading,
    SimulatedTime,
    SimulatedWakeUp,
)

THREADING: Final = SimulatedThreading()
TIME: Final = SimulatedTime()


class Drawn:
    """As the module `secrets`: numbers that follow from the seed of the simulation."""

    draw: Callable[[int], int] = staticmethod(lambda bits: 0)

    @staticmethod
    def randbits(bits: int) -> int:
        return Drawn.draw(bits)

    @staticmethod
    def token_bytes(size: int) -> bytes:
        return Drawn.draw(8 * size).to_bytes(size, "little")


class Opened:
    """As protocol.bus.session.open_session; the simulation says what it opens."""

    open: Callable[[Any], Any] = staticmethod(lambda network: None)

    @staticmethod
    def open_session(network: Any) -> Any:
        return Opened.open(network)


def simulated_pulse() -> Pulse:
    return Pulse(current_host().now_ns)


def no_rehearsal(pulse: Any, _rehearsal: Any, _patience_ns: int) -> Any:
    """A rehearsal acts on a state of its own: it costs time and shows nothing."""
    return pulse


def no_signal(_stop: Callable[[], None]) -> None:
    """A simulated process is stopped by a call of its `stop`."""


def sparing_put(self: Any, message: Message) -> bytes:
    """Publish; of what nobody looks at every eighth frame only is made, to find what cannot be."""
    if self._matching.quiet:
        self.unheard = getattr(self, "unheard", 0) + 1
        if self.unheard % 8:
            return b""
    frame: bytes = self.frame(message)
    self.put_frame(frame)
    return frame


class PlainPublisher:
    """As Zenoh's advanced publisher; the simulation keeps no history."""

    def __init__(self, session: Any, key: str, _newest: int, **service: Any) -> None:
        self._publisher = session.declare_publisher(key, **service)

    def put(self, payload: bytes, **options: Any) -> None:
        self._publisher.put(payload, **options)


def plain_subscriber(session: Any, key: str, _newest: int, take: Any) -> Any:
    return session.declare_subscriber(key, take)


BLOCKING: Final[tuple[tuple[str, dict[str, object]], ...]] = (
    ("threading", {"threading": THREADING}),
    ("time", {"time": TIME, "monotonic": TIME.monotonic, "monotonic_ns": TIME.monotonic_ns}),
    ("queue", {"SimpleQueue": SimulatedQueue, "Thread": SimulatedThread}),
    ("secrets", {"secrets": Drawn}),
    ("protocol.pulse", {"WakeUp": SimulatedWakeUp}),
)
BLOCKS: Final = (
    "protocol.bus.bus",
    "protocol.bus.service",
    "protocol.bus.late_join",
    "protocol.bus.publisher",
    "protocol.bus.robot_clock",
    "runtime.arrivals",
    "ground.client.emergency_stop",
    "ground.client.requests",
    "ground.station.robot.background_requests",
    "ground.station.station",
    "ground.station.reader",
    "robot.process",
    "robot.storage.writer",
    "plant.process.requests",
    "plant.process.loop",
)
"""Modules in which every name that blocks is replaced, where they have it."""

SPECIAL: Final[tuple[tuple[str, str, object], ...]] = (
    ("protocol.bus.bus", "open_session", Opened.open_session),
    ("protocol.bus.bus", "called", lambda _endpoint: Hub.UNREACHABLE),
    ("protocol.bus.bus", "following", plain_subscriber),
    ("protocol.bus.publisher", "keeping", PlainPublisher),
    ("robot.run", "WallClock", SimulatedClock),
    ("robot.run", "Pulse", simulated_pulse),
    ("robot.run", "time", TIME.time),
    ("robot.run", "RehearsingPulse", no_rehearsal),
    ("robot.run", "Rehearsal", lambda _params: None),
    ("robot.run", "on_signal", no_signal),
    ("ground.client.link", "Pulse", simulated_pulse),
    ("runtime.atomic_file", "os", SimulatedOs),
    ("runtime.atomic_file", "Path", lambda path: path),
)


def replacements() -> Iterator[tuple[Any, str, object]]:
    """Module, name and what takes its place."""
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
            raise LookupError(f"{module_name} has no {name} any more: adapt the simulation")
        yield module, name, stand_in


@contextmanager
def substituted() -> Iterator[None]:
    """Simulate what is opened within; not to be nested."""
    before: list[tuple[Any, str, object]] = []
    try:
        for module, name, stand_in in replacements():
            before.append((module, name, vars(module)[name]))
            setattr(module, name, stand_in)
        yield
    finally:
        for module, name, original in reversed(before):
            setattr(module, name, original)
