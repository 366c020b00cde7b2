"""Addresses of failed connections, from Linux's tables; Zenoh does not report them."""

import sys
from collections.abc import Iterable, Iterator
from contextlib import suppress
from ipaddress import IPv4Address, IPv6Address
from pathlib import Path
from typing import Final, NamedTuple

TABLES: Final = (Path("/proc/net/tcp"), Path("/proc/net/tcp6"))
ESTABLISHED: Final = "01"
CONNECTING: Final = ("02", "03")
LISTENING: Final = "0A"


class ConnectionEnd(NamedTuple):
    """One end of a connection."""

    host: str
    port: int


class ClosingConnections:
    """Find connections to our ports that are being closed in the system's tables."""

    def __init__(self, ports: Iterable[int], tables: Iterable[Path] = TABLES) -> None:
        self._ports = frozenset(ports)
        self._tables = tuple(tables)
        self._seen: frozenset[ConnectionEnd] = frozenset()

    def new(self, known: Iterable[ConnectionEnd]) -> list[str]:
        """Return the hosts that are new since the last call and are not known."""
        closing = frozenset(self._closing())
        found = closing - self._seen - frozenset(known)
        self._seen = closing
        return sorted({end.host for end in found})

    def _closing(self) -> Iterator[ConnectionEnd]:
        for table in self._tables:
            try:
                lines = table.read_text().splitlines()[1:]
            except OSError:
                continue
            yield from self._of(lines)

    def _of(self, lines: Iterable[str]) -> Iterator[ConnectionEnd]:
        for line in lines:
            _, local, remote, state, *_ = line.split()
            if state in (ESTABLISHED, LISTENING, *CONNECTING):
                continue
            here, there = end_of(local), end_of(remote)
            if here.port in self._ports:
                yield there
            elif there.port in self._ports:  # the client end, on this machine
                yield here


def end_of(text: str) -> ConnectionEnd:
    """Parse `0100007F:4427`, words in the machine's byte order, as 127.0.0.1 and port 17447."""
    address, _, port = text.partition(":")
    raw = bytes.fromhex(address)
    if sys.byteorder == "little":
        raw = b"".join(raw[at : at + 4][::-1] for at in range(0, len(raw), 4))
    if len(raw) == 4:
        return ConnectionEnd(str(IPv4Address(raw)), int(port, 16))
    return ConnectionEnd(plain_host(str(IPv6Address(raw))), int(port, 16))


def end_in(address: str) -> ConnectionEnd:
    """Parse `10.0.0.7:50000` or `[::1]:50000`."""
    host, _, port = address.rpartition(":")
    return ConnectionEnd(plain_host(host), int(port) if port.isdecimal() else 0)


def plain_host(host: str) -> str:
    """Return a host without brackets and zone; an IPv4 address in IPv6 becomes a plain one."""
    host = host.strip("[]").partition("%")[0]
    with suppress(ValueError):
        return str(IPv6Address(host).ipv4_mapped or IPv6Address(host))
    return host
