"""Replace session, threads, clocks and disk of the product by simulated ones.

Only modules whose code would block, start a thread, read a real clock or draw a random number are
changed. All other product code runs unmodified.

On the disk a write survives a power cut only after fsync of file and directory.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path
from random import Random
from typing import Any, Final

from checks.harness.reordering_disk import DiskFile, ReorderingDisk, apply
from checks.simulation.hosts.virtual_time import (
    SimulatedClock,
    SimulatedPool,
    SimulatedQueue,
    SimulatedThread,
    SimulatedThreading,
    SimulatedTime,
    SimulatedWakeUp,
    current_host,
    current_task,
)
from ground.client.emergency_stop import NO_WAYS
from protocol.bus.network import Hub
from protocol.bus.publisher import Publisher
from protocol.wire.message import Message
from runtime.clock import Pulse
from runtime.watchdog import Patience

NO_SPACE: Final = 28
IO_ERROR: Final = 5
STATE: Final = Path("/state")
"""The directory of the disk."""


class SimulatedDisk(ReorderingDisk):
    """A disk with one directory; fsync takes `slow_ns`, and `failing` makes writes fail."""

    def __init__(self) -> None:
        self.slow_ns = 0
        self.failing = False
        super().__init__(str(STATE))

    def open(self, path: Path, flags: int, mode: int = 0o777) -> int:
        """Open a file or the directory."""
        if flags & self.O_TRUNC:
            self._check_writable()
        return super().open(path, flags, mode)

    def write(self, handle: int, data: bytes) -> int:
        """Append to a file."""
        self._check_writable()
        return super().write(handle, data)

    def replace(self, old: Path, new: Path) -> None:
        """Rename a file."""
        self._check_writable()
        super().replace(old, new)

    def unlink(self, path: Path) -> None:
        """Remove a file."""
        self._check_writable()
        super().unlink(path)

    def fsync(self, handle: int) -> None:
        """Save a file or the directory; changes made during the wait are saved too."""
        if self.slow_ns:
            current_task().wait_until(current_host().scheduler.now_ns + self.slow_ns)
        if self.failing:
            raise OSError(IO_ERROR, "Input/output error")
        super().fsync(handle)

    def _check_writable(self) -> None:
        """Raise OSError if writes fail."""
        if self.failing:
            raise OSError(NO_SPACE, "No space left on device")

    def _done(self) -> None:
        """Keep no states: a power cut draws one."""

    def damage(self, name: str) -> bool:
        """Truncate a file on the medium; return False if there is no such file."""
        number = self._folder(STATE).names.get(name)
        file = None if number is None else self._file(number)
        if file is None or not file.content:
            return False
        file.content = file.synced = file.content[: len(file.content) // 2]
        return True

    def cut_power(self, salt: int) -> None:
        """Lose unsaved changes: each unsaved name is changed or not, at random.

        An unsaved file keeps its old content, or is cut off anywhere.
        """
        random, folder = Random(salt), self._folder(STATE)
        kept = dict(folder.durable)
        for name in sorted({*folder.names, *kept}):
            number = folder.names.get(name)
            if number != kept.get(name) and random.random() < 0.5:
                apply(kept, (name, None if number is None else name, number or 0))
        for name in sorted(kept):
            file = self._file(kept[name])
            if file.synced != file.content and random.random() < 0.5:
                file.synced = file.content[: random.randint(0, len(file.content))]
            file.content = file.synced
        folder.durable, folder.names = kept, dict(kept)

    def _file(self, number: int) -> DiskFile:
        file = self._nodes[number]
        assert isinstance(file, DiskFile)
        return file


class HostsDisk:
    """Replaces the module `os` by the disk of the current host."""

    def __getattr__(self, name: str) -> Any:
        return getattr(DISKS[current_host().name], name)


DISKS: Final[dict[str, SimulatedDisk]] = {}
"""The disk of each host, by its name."""


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
    ("ground.client.stop_ways", "ways_of", lambda _bus, _robot: NO_WAYS),
    ("plant.process.loop", "Patience", PATIENCE),
    ("protocol.bus.bus", "Patience", PATIENCE),
    ("runtime.files", "os", HostsDisk()),
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
