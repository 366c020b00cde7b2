"""The interface of every endpoint: receive bytes of peers, send bytes to one, never block."""

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
        """Capacity of the line in bytes per second; None if it has no limit."""

    @property
    def is_reliable(self) -> bool:
        """True if no frame is lost on the way, as with TCP."""

    def filenos(self) -> list[int]:
        """Return the descriptors to wait for."""

    def lasting(self) -> Collection[str]:
        """Return the peers that stay present while they are silent: connections and lines."""

    def gone(self) -> list[str]:
        """Return the peers whose connection has ended since the last call."""

    def receive(self) -> list[Received]:
        """Return the bytes that have arrived, at most as many as one round can process."""

    def send(self, peer: str, data: bytes, *, is_stream: bool) -> None:
        """Send a frame; if the line is slow, drop telemetry first, then all frames."""

    def flush(self, now_ns: int) -> None:
        """Send the waiting frames; open a lost line again."""

    def forget(self, peer: str) -> None:
        """Drop the state of a client that has disconnected."""

    def close(self) -> None:
        """Close it."""
