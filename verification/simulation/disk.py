"""A simulated disk: what is written survives a power cut only after fsync of file and directory.

`SimulatedPath` and `SimulatedOs` have what the robot's store uses of pathlib and os.
"""

from io import StringIO
from random import Random
from typing import Any, Final

from verification.simulation.scheduler import Host, current_host, current_task

NO_SPACE: Final = 28
IO_ERROR: Final = 5


class Inode:
    """The content of a file: as programs see it, and as it is on the medium."""

    __slots__ = ("live", "synced")

    def __init__(self) -> None:
        self.live = ""
        self.synced = ""


class Disk:
    """One directory. `slow_ns` is how long an fsync takes; `failing` makes writes fail."""

    def __init__(self) -> None:
        self.slow_ns = 0
        self.failing = False
        self.syncs = 0
        self.files: dict[str, Inode] = {}
        self.on_medium: dict[str, Inode] = {}
        self._open: dict[int, Inode | None] = {}

    def open(self, inode: Inode | None) -> int:
        """A file descriptor; None stands for the directory."""
        number = 100 + len(self._open)
        self._open[number] = inode
        return number

    def fsync(self, number: int) -> None:
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
        if self.failing:
            raise OSError(NO_SPACE, "No space left on device")

    def cut_power(self, salt: int) -> None:
        """Lose what is not on the medium; each change of a name that is not may be, or not."""
        random = Random(salt)
        for name in sorted({*self.files, *self.on_medium}):
            live, medium = self.files.get(name), self.on_medium.get(name)
            if live is not medium and random.random() < 0.5:
                if live is None:
                    self.on_medium.pop(name, None)
                else:
                    self.on_medium[name] = live
        for inode in self.on_medium.values():
            inode.live = inode.synced
        self.files = dict(self.on_medium)


class Draft(StringIO):
    """A file that is open for writing."""

    def __init__(self, disk: Disk, inode: Inode) -> None:
        super().__init__()
        self._disk = disk
        self._inode = inode

    def write(self, text: str) -> int:
        self._disk.check_writable()
        written = super().write(text)
        self._inode.live = self.getvalue()
        return written

    def fileno(self) -> int:
        return self._disk.open(self._inode)


class SimulatedPath:
    """As pathlib.Path; all files are in one directory."""

    def __init__(self, disk: Disk, name: str = "") -> None:
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
        return SimulatedPath(self.disk)

    def with_name(self, name: str) -> "SimulatedPath":
        return SimulatedPath(self.disk, name)

    def mkdir(self, **_: object) -> None:
        """The directory is there."""

    def exists(self) -> bool:
        return self.name in self.disk.files

    def read_text(self, encoding: str = "utf-8") -> str:
        inode = self.disk.files.get(self.name)
        if inode is None:
            raise FileNotFoundError(2, "No such file or directory", str(self))
        return inode.live

    def open(self, mode: str = "r", encoding: str = "utf-8") -> StringIO:
        if "w" not in mode:
            return StringIO(self.read_text())
        self.disk.check_writable()
        inode = self.disk.files[self.name] = Inode()
        return Draft(self.disk, inode)

    def replace(self, target: "SimulatedPath") -> None:
        self.disk.files[target.name] = self.disk.files.pop(self.name)

    def unlink(self, missing_ok: bool = False) -> None:
        if self.disk.files.pop(self.name, None) is None and not missing_ok:
            raise FileNotFoundError(2, "No such file or directory", str(self))


class SimulatedOs:
    """As the module `os`, for files of the simulated disk."""

    O_RDONLY = 0
    O_DIRECTORY = 0

    class path:
        @staticmethod
        def realpath(path: Any) -> Any:
            return path

    @staticmethod
    def fsync(number: int) -> None:
        disk_of(current_host()).fsync(number)

    fdatasync = fsync

    @staticmethod
    def open(path: Any, _flags: int = 0, **_: object) -> int:
        disk: Disk = path.disk
        return disk.open(disk.files.get(path.name) if path.name else None)

    @staticmethod
    def close(_number: int) -> None:
        """Descriptors of the simulation are not counted."""


DISKS: Final[dict[str, Disk]] = {}
"""The disk of each host, by its name."""


def disk_of(host: Host) -> Disk:
    return DISKS[host.name]
