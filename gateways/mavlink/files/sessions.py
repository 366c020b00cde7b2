"""The open files of clients: a limited number; unused files are closed after some time."""

from dataclasses import dataclass, field
from typing import Final

from gateways.mavlink.files.sources import Source
from gateways.mavlink.files.wire import FileRequest, Key
from runtime.units import NS_PER_S

MAX_OF_CLIENT: Final = 8
MAX_OPEN: Final = 64
IDLE_NS: Final = 3 * NS_PER_S
"""A session that is idle for this long may be closed to make room for another client."""
GONE_NS: Final = 20 * NS_PER_S
MAX_BURST: Final = 2000
"""Replies to one request; then the client must send a new request."""


@dataclass(slots=True)
class Burst:
    """A file that is being sent: the request, the next offset, and how much has been sent."""

    request: FileRequest
    offset: int
    block: int
    sent: int = 0


@dataclass(slots=True)
class FileSession:
    """An open file."""

    source: Source
    used_ns: int
    burst: Burst | None = field(default=None)


class Sessions:
    """The sessions of all clients, the least recently used first."""

    def __init__(self) -> None:
        self.open: dict[Key, FileSession] = {}

    def add(self, key: Key, source: Source, now_ns: int) -> bool:
        """Keep an open file; close another one if there are too many, False if none may be."""
        self.close(key)
        own = [other for other in self.open if other.client == key.client]
        if len(own) >= MAX_OF_CLIENT:
            self.close(own[0])
        elif len(self.open) >= MAX_OPEN:
            oldest = next(iter(self.open))
            if now_ns - self.open[oldest].used_ns < IDLE_NS:
                return False
            self.close(oldest)
        self.open[key] = FileSession(source, now_ns)
        return True

    def use(self, key: Key, now_ns: int) -> FileSession | None:
        """Return a session, and note its use."""
        found = self.open.pop(key, None)
        if found is not None:
            found.used_ns = now_ns
            self.open[key] = found
        return found

    def close(self, key: Key) -> None:
        """Close a session, if it is open."""
        found = self.open.pop(key, None)
        if found is not None:
            found.source.close()

    def close_program(self, key: Key) -> None:
        """Close all sessions of the program that a key names."""
        self._close_all([other for other in self.open if other[:3] == key[:3]])

    def close_client(self, client: int) -> None:
        """Close all sessions of a client that has disconnected."""
        self._close_all([key for key in self.open if key.client == client])

    def close_unused(self, now_ns: int) -> None:
        """Close sessions that have been idle for too long."""
        unused = [key for key, one in self.open.items() if now_ns - one.used_ns >= GONE_NS]
        self._close_all(unused)

    def _close_all(self, keys: list[Key]) -> None:
        for key in keys:
            self.close(key)
