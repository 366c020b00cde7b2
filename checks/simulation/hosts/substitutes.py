"""Replace session, threads, clocks and disk of the product by simulated ones.

Only modules whose code would block, start a thread, read a real clock or draw a random number are
changed. All other product code runs unmodified.

On the disk a write survives a power cut only after fsync of file and directory.
"""

import gc
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path
from random import Random
from typing import Any, Final
from unittest.mock import patch

from checks.harness.reordering_disk import DiskFile, ReorderingDisk, apply
from checks.simulation.hosts.virtual_time import (
    SimulatedClock,
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


IDLE: Final = partial(float, 1.0)
"""The load of the machine is none of the simulation's."""

PATIENCE: Final = partial(Patience, now_ns=TIME.monotonic_ns, slowdown=IDLE)


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


class AskedMatching:
    """Replaces Matching: asks the simulated publisher each time, which costs little."""

    def __init__(self, publisher: Any) -> None:
        self._publisher = publisher

    @property
    def status(self) -> tuple[bool]:
        """Whether the publisher has a subscriber."""
        return (self._publisher.matched,)

    @property
    def quiet(self) -> bool:
        """Whether nothing observes its key."""
        quiet: bool = self._publisher.quiet
        return quiet


class PlainPublisher:
    """Replaces Zenoh's advanced publisher; the simulation keeps no history."""

    def __init__(self, session: Any, key: str, _newest: int, **service: Any) -> None:
        self._publisher = session.declare_publisher(key, **service)

    def put(self, payload: bytes, **options: Any) -> None:
        """Publish a payload."""
        self._publisher.put(payload, **options)


BLOCKING: Final[dict[str, object]] = {
    "threading": THREADING,
    "time": TIME,
    "monotonic": TIME.monotonic,
    "monotonic_ns": TIME.monotonic_ns,
    "SimpleQueue": SimulatedQueue,
    "Thread": SimulatedThread,
    "secrets": SeededSecrets,
    "WakeUp": SimulatedWakeUp,
}
BLOCKS: Final = (
    *("protocol.bus.bus", "protocol.bus.publisher", "protocol.bus.robot_clock"),
    *("protocol.bus.services", "protocol.bus.session", "runtime.clock", "runtime.lockstep"),
    "robot.process",
    *("robot.file_writer", "ground.client.emergency_stop", "ground.client.requests"),
    *("ground.client.robot_link", "ground.station.robot.robot_stop"),
    "ground.station.station",
    *("ground.station.reader", "gateways.mavlink.bus_port", "gateways.mavlink.gateway"),
    "plant.process",
)
"""Modules in which each blocking name that they have is replaced."""

SPECIAL: Final[dict[str, object]] = {
    "protocol.bus.bus.open_session": SessionOpener.open_session,
    "protocol.bus.bus.probed": SessionOpener.probed,
    "protocol.bus.publisher.Matching": AskedMatching,
    "protocol.bus.bus.redialled": SessionOpener.redialled,
    # No history.
    "protocol.bus.bus.fetching_subscriber": lambda session, key, _newest, take: session.declare(
        lambda one: one.declare_subscriber(key, take)
    ),
    "protocol.bus.publisher.Publisher.put": sparing_put,
    "protocol.bus.publisher.caching_publisher": PlainPublisher,
    "protocol.bus.bus.Patience": PATIENCE,
    "protocol.bus.session.slowdown": IDLE,
    "robot.run.WallClock": SimulatedClock,
    "robot.run.Pulse": lambda: Pulse(current_host().now_ns),
    "robot.run.time": TIME.time,
    # Rehearsals only cost time here.
    "robot.run.RehearsingPulse": lambda pulse, _rehearsal, _patience_ns: pulse,
    "robot.run.Rehearsal": lambda _params: None,
    # A simulated process is stopped by a call of its `stop`.
    "robot.run.on_signal": lambda _stop: None,
    "ground.client.stop_ways.ways_of": lambda _bus, _robot: NO_WAYS,
    "plant.process.Patience": PATIENCE,
    "runtime.files.os": HostsDisk(),
}


def substitutes() -> dict[str, object]:
    """Return all substitutes by their import paths."""
    blocking = {
        f"{module}.{name}": stand_in
        for module in BLOCKS
        for name, stand_in in BLOCKING.items()
        if name in vars(import_module(module))
    }
    return blocking | SPECIAL


@contextmanager
def simulated(*more: Callable[[], Mapping[str, object]]) -> Iterator[None]:
    """Simulate everything that is opened within, with more replacements by their import paths.

    Each of `more` is called when those before are in force. Cannot be nested.
    """
    collects = gc.isenabled()
    gc.disable()
    with ExitStack() as stack:
        if collects:
            stack.callback(gc.enable)
        for make in (substitutes, *more):
            for place, stand_in in make().items():
                stack.enter_context(patch(place, stand_in))
        yield
