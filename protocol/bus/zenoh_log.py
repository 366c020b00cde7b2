"""Zenoh's own log, caught on its way: it can only write to standard output.

It is caught in memory, never in a pipe: a full one would stall what arrives on the bus.
"""

import os
import sys
from collections.abc import Mapping
from types import MappingProxyType, TracebackType
from typing import Final, Self

import zenoh

DOORS: Final = "zenoh::net::routing::interceptor::access_control=trace,zenoh_link_tls=debug"
ENVIRONMENT: Final[Mapping[str, str | None]] = MappingProxyType({"RUST_LOG": None, "NO_COLOR": "1"})
"""What Zenoh's log would heed, and what it is to find."""

STDOUT: Final = 1


class ZenohLog:
    """From now on until it is closed. Python's own standard output goes on as before."""

    def __init__(self, wanted: str = DOORS) -> None:
        sys.stdout.flush()
        self._spoken = sys.stdout
        self._stdout = os.dup(STDOUT)
        sys.stdout = os.fdopen(os.dup(STDOUT), "w", buffering=1)
        self._full, self._filling = caught(), caught()
        os.dup2(self._filling, STDOUT)
        initialise(wanted)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def take(self) -> bytes:
        """What was written up to the call before this one: whoever was writing then has ended."""
        read, self._full, self._filling = self._full, self._filling, caught()
        os.dup2(self._filling, STDOUT)
        with os.fdopen(read, "rb") as file:
            file.seek(0)
            return file.read()

    def close(self) -> None:
        """Give standard output back; what Zenoh writes from now on goes there, too."""
        os.dup2(self._stdout, STDOUT)
        sys.stdout.close()
        sys.stdout = self._spoken
        for number in (self._stdout, self._full, self._filling):
            os.close(number)


def caught() -> int:
    """A file in memory."""
    return os.memfd_create("zenoh-log")


def initialise(wanted: str) -> None:
    """Once for each process, whatever the environment says."""
    before = {name: os.environ.get(name) for name in ENVIRONMENT}
    set_all(ENVIRONMENT)
    try:
        zenoh.init_log_from_env_or(wanted)
    finally:
        set_all(before)


def set_all(values: Mapping[str, str | None]) -> None:
    for name, value in values.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
