"""A simulated disk: a write survives a power cut only after fsync of file and directory.

`SimulatedPath` and `SimulatedOs` offer what the robot's store uses of pathlib and os.
"""

import os
import stat
from random import Random
from typing import Any, Final

from checks.simulation.hosts.virtual_time import Host, current_host, current_task

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
