"""Replace session, threads, clocks and disk of the product by simulated ones.

Only modules whose code would block, start a thread, read a real clock or draw a random number are
changed. All other product code runs unmodified.

On the disk a write survives a power cut only after fsync of file and directory. `SimulatedPath` and
`SimulatedOs` offer what the robot's store uses of pathlib and os.
"""

import os
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from random import Random
from typing import Any, Final

from checks.simulation.hosts.virtual_time import (
    Host,
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


class Inode:
    """The content of a file, as programs see it and as it is on the medium."""

    __slots__ = ("live", "synced")

    def __init__(self) -> None:
        self.live = b""
        self.synced = b""


class SimulatedDisk:
    """A disk with one directory; fsync takes `slow_ns`, and `failing` makes writes fail."""

    def __init__(self) -> None:
        self.slow_ns = 0
        self.failing = False
        self.syncs = 0
        self.files: dict[str, Inode] = {}
        self.on_medium: dict[str, Inode] = {}
        self._open: dict[int, Inode | None] = {}
        self._read: dict[int, int] = {}
        """How much has been read of an open file."""

    def open(self, inode: Inode | None) -> int:
        """Return a file descriptor; `inode` None is the directory."""
        number = 100 + len(self._open)
        self._open[number] = inode
        return number

    def create(self, name: str) -> Inode:
        """Create a file or empty it."""
        self.check_writable()
        inode = self.files.setdefault(name, Inode())
        inode.live = b""
        return inode

    def read(self, number: int, size: int) -> bytes:
        """Return the next bytes of a file; it does not change while it is read."""
        inode = self._open[number]
        assert inode is not None, "a directory is not read"
        at = self._read.get(number, 0)
        found = inode.live[at : at + size]
        self._read[number] = at + len(found)
        return found

    def write(self, number: int, data: bytes) -> int:
        """Append to a file."""
        self.check_writable()
        inode = self._open[number]
        assert inode is not None, "a directory is not written to"
        inode.live += data
        return len(data)

    def fsync(self, number: int) -> None:
        """Save a file or the directory; changes made during the wait are saved too."""
        self.syncs += 1
        host = current_host()
        if self.slow_ns:
            current_task().wait_until(host.scheduler.now_ns + self.slow_ns)
        if self.failing:
            raise OSError(IO_ERROR, "Input/output error")
        inode = self._open[number]
        if inode is None:
            self.on_medium = dict(self.files)
        else:
            inode.synced = inode.live

    def check_writable(self) -> None:
        """Raise OSError if writes fail."""
        if self.failing:
            raise OSError(NO_SPACE, "No space left on device")

    def remove(self, name: str) -> None:
        """Remove a file."""
        self.check_writable()
        if self.files.pop(name, None) is None:
            raise FileNotFoundError(2, "No such file or directory", name)

    def damage(self, name: str) -> bool:
        """Truncate a file on the medium; return False if there is no such file."""
        inode = self.files.get(name)
        if inode is None or not inode.live:
            return False
        inode.live = inode.synced = inode.live[: len(inode.live) // 2]
        return True

    def cut_power(self, salt: int) -> None:
        """Lose unsaved changes: each unsaved name is changed or not, at random.

        An unsaved file keeps its old content, or is cut off anywhere.
        """
        random = Random(salt)
        for name in sorted({*self.files, *self.on_medium}):
            live, medium = self.files.get(name), self.on_medium.get(name)
            if live is not medium and random.random() < 0.5:
                if live is None:
                    self.on_medium.pop(name, None)
                else:
                    self.on_medium[name] = live
        for name in sorted(self.on_medium):
            inode = self.on_medium[name]
            if inode.synced != inode.live and random.random() < 0.5:
                inode.synced = inode.live[: random.randint(0, len(inode.live))]
            inode.live = inode.synced
        self.files = dict(self.on_medium)


class SimulatedPath:
    """Replaces pathlib.Path; all files are in one directory."""

    def __init__(self, disk: SimulatedDisk, name: str = "") -> None:
        self.disk = disk
        self.name = name

    def __truediv__(self, name: str) -> "SimulatedPath":
        return SimulatedPath(self.disk, str(name))

    def __str__(self) -> str:
        return f"state/{self.name}"

    def __fspath__(self) -> str:
        return str(self)

    @property
    def parent(self) -> "SimulatedPath":
        """The directory."""
        return SimulatedPath(self.disk)

    def with_name(self, name: str) -> "SimulatedPath":
        """Return the path of another file."""
        return SimulatedPath(self.disk, name)

    def mkdir(self, **_: object) -> None:
        """Do nothing: the directory exists."""

    def exists(self) -> bool:
        """Return whether the file exists."""
        return self.name in self.disk.files

    def read_text(self, encoding: str = "utf-8") -> str:
        """Return the content as text."""
        return self.read_bytes().decode(encoding)

    def read_bytes(self) -> bytes:
        """Return the content."""
        inode = self.disk.files.get(self.name)
        if inode is None:
            raise FileNotFoundError(2, "No such file or directory", str(self))
        return inode.live

    def unlink(self, missing_ok: bool = False) -> None:
        """Remove the file."""
        try:
            self.disk.remove(self.name)
        except FileNotFoundError:
            if not missing_ok:
                raise


class SimulatedOs:
    """Replaces the module `os` for files of the simulated disk."""

    O_RDONLY = os.O_RDONLY
    O_WRONLY = os.O_WRONLY
    O_NONBLOCK = os.O_NONBLOCK
    O_CREAT = os.O_CREAT
    O_TRUNC = os.O_TRUNC
    O_CLOEXEC = os.O_CLOEXEC
    O_DIRECTORY = os.O_DIRECTORY

    class path:  # noqa: N801 - as in os
        """Replaces os.path."""

        @staticmethod
        def realpath(path: Any) -> Any:
            """Return the path itself."""
            return path

        @staticmethod
        def isdir(path: Any) -> bool:
            """Return whether a path is the directory."""
            return not path.name

    @staticmethod
    def fsync(number: int) -> None:
        """Save a file or the directory."""
        disk_of(current_host()).fsync(number)

    fdatasync = fsync

    @staticmethod
    def open(path: Any, flags: int = 0, _mode: int = 0, **_: object) -> int:
        """Open a file or the directory."""
        disk: SimulatedDisk = path.disk
        if not path.name:
            return disk.open(None)
        if flags & os.O_TRUNC:
            return disk.open(disk.create(path.name))
        inode = disk.files.get(path.name)
        if inode is None:
            raise FileNotFoundError(2, "No such file or directory", str(path))
        return disk.open(inode)

    @staticmethod
    def fstat(_number: int) -> os.stat_result:
        """Return that it is a regular file."""
        return os.stat_result((stat.S_IFREG, *(0,) * 9))

    @staticmethod
    def lstat(path: Any) -> None:
        """Raise FileNotFoundError if there is no such file."""
        if path.name not in path.disk.files:
            raise FileNotFoundError(2, "No such file or directory", str(path))

    @staticmethod
    def read(number: int, size: int) -> bytes:
        """Return the rest of a file."""
        return disk_of(current_host()).read(number, size)

    @staticmethod
    def write(number: int, data: bytes) -> int:
        """Append to a file."""
        return disk_of(current_host()).write(number, data)

    @staticmethod
    def close(_number: int) -> None:
        """Do nothing: descriptors are not counted."""

    @staticmethod
    def replace(source: Any, target: Any) -> None:
        """Rename a file."""
        disk: SimulatedDisk = source.disk
        disk.check_writable()
        disk.files[target.name] = disk.files.pop(source.name)

    @staticmethod
    def unlink(path: Any) -> None:
        """Remove a file."""
        disk: SimulatedDisk = path.disk
        disk.remove(path.name)

    @staticmethod
    def mkdir(_path: Any) -> None:
        """Do nothing: the directory exists."""


DISKS: Final[dict[str, SimulatedDisk]] = {}
"""The disk of each host, by its name."""


def disk_of(host: Host) -> SimulatedDisk:
    """Return the disk of a host."""
    return DISKS[host.name]


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
