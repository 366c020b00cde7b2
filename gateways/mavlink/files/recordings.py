"""The recordings of one robot that clients may list and download."""

from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

from gateways.mavlink.files.sources import LARGEST
from ground.recording.catalogue import began
from ground.recording.parts import NAMED
from runtime.units import NS_PER_S

SUFFIX: Final = ".tlog"
MAX_LISTED: Final = 1000
"""The number of newest recordings that are listed; a log number has 16 bits."""
FRESH_NS: Final = NS_PER_S
ARMED: Final = "disarm before you download logs"
"""Why neither LOG nor FTP reads a recording of an armed robot: a slow disk would hold up commands
and the operator's heartbeat, which share a thread with it."""


class Recording(NamedTuple):
    """A file; `began_s` is when its run began, in seconds since 1970 in UTC."""

    path: Path
    began_s: int
    size: int

    @property
    def name(self) -> str:
        """The name of the file."""
        return self.path.name


class Recordings:
    """The `.tlog` files of a robot in a folder; without a folder there are none."""

    def __init__(
        self, folder: Path | None, robot: str, is_armed: Callable[[], bool] = lambda: False
    ) -> None:
        self._is_armed = is_armed
        self._folder = folder
        self._robot = robot
        self._found: tuple[Recording, ...] = ()
        self._looked_ns: int | None = None

    def listed(self, now_ns: int) -> tuple[Recording, ...]:
        """Return the recordings, the oldest first; the list is at most a second old.

        While the robot is armed, it is that of the last look at the disk.
        """
        is_old = self._looked_ns is None or now_ns - self._looked_ns >= FRESH_NS
        if is_old and not self._is_armed():
            self._looked_ns = now_ns
            self._found = self._look()
        return self._found

    def find(self, name: str, now_ns: int) -> Recording | None:
        """Return the recording with a name."""
        return next((one for one in self.listed(now_ns) if one.name == name), None)

    def _look(self) -> tuple[Recording, ...]:
        if self._folder is None:
            return ()
        try:
            paths = [path for path in self._folder.iterdir() if self._is_ours(path)]
            found = [Recording(path, int(began(path).timestamp()), _size(path)) for path in paths]
        except OSError:
            return ()
        return tuple(sorted(found, key=lambda one: (one.began_s, one.name))[-MAX_LISTED:])

    def _is_ours(self, path: Path) -> bool:
        named = NAMED.match(path.stem)
        is_robots = named is not None and named["robot"] == self._robot
        return is_robots and path.suffix == SUFFIX and path.is_file() and not path.is_symlink()


def _size(path: Path) -> int:
    return min(path.stat().st_size, LARGEST)
