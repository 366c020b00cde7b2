"""What every endpoint has: bytes of named peers in, bytes to one of them out, nothing blocks."""

from typing import NamedTuple, Protocol


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

    def filenos(self) -> list[int]:
        """Return the descriptors to wait for."""

    def receive(self) -> list[Received]:
        """Return all that has arrived."""

    def send(self, peer: str, data: bytes) -> None:
        """Send bytes to a peer; drop them if they cannot be sent now."""

    def close(self) -> None:
        """Close it."""
