"""What every endpoint has: bytes of named peers in, bytes to one of them out, nothing blocks."""

from collections.abc import Collection
from typing import Final, NamedTuple, Protocol

MAX_PEERS: Final = 16
"""Clients of one endpoint at a time; more are not served."""


class Received(NamedTuple):
    """Bytes from one peer; `peer` is unique within the endpoint."""

    peer: str
    data: bytes
    is_loopback: bool


class Endpoint(Protocol):
    """An open socket or serial line."""

    @property
    def text(self) -> str:
        """The endpoint as it was given, such as `udpin:127.0.0.1:14550`."""

    @property
    def line_bytes_s(self) -> int | None:
        """What the line carries at most, in bytes per second; None if that is no limit."""

    def filenos(self) -> list[int]:
        """Return the descriptors to wait for."""

    def lasting(self) -> Collection[str]:
        """Return the peers that are there although they are silent: connections and lines."""

    def gone(self) -> list[str]:
        """Return the peers whose connection has ended since the last call."""

    def receive(self) -> list[Received]:
        """Return what has arrived, at most as much as one round can process."""

    def send(self, peer: str, data: bytes, *, is_stream: bool) -> None:
        """Send a frame; if the line is slow, drop streams first, then everything."""

    def flush(self, now_ns: int) -> None:
        """Send what waits; open a lost line again."""

    def forget(self, peer: str) -> None:
        """Drop what is kept for a client that has gone."""

    def close(self) -> None:
        """Close it."""
