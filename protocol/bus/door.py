"""A door in front of Zenoh's TLS acceptor: connections that fail do not delay the others.

Zenoh 1.10 sleeps 100 ms after each failed handshake, one after the other, and accepts nothing
meanwhile. Ten connections a second that send no TLS would keep everybody out. The door has two
programs (classic BPF) that the kernel runs before there is a connection; no frame is copied.

- A second socket listens on the same port, and accepts nothing: whoever gets there dials again. A
  program chooses between it and Zenoh's: only a share of the connections from an address reaches
  Zenoh if too many of that address have become no link.
- A filter on Zenoh's socket completes a connection only by a segment that begins like a TLS record.
  A silent connection, a port scan or an HTTP request ends in the kernel. Since 2026, Linux permits
  this filter only to processes with CAP_NET_ADMIN. Without it, silent connections end in the kernel
  all the same (TCP_DEFER_ACCEPT), but others fail in Zenoh.

Accepted sockets inherit the filter. A thread removes it from them within milliseconds; until then
it may drop a segment of theirs, which TCP sends again. Works on Linux.
"""

import os
import select
import socket
import sys
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from ipaddress import ip_address
from threading import Lock, Thread
from typing import Final

from protocol.bus.bus import Bus
from protocol.bus.sockets import (
    SO_ATTACH_FILTER,
    SO_ATTACH_REUSEPORT_CBPF,
    SO_DETACH_FILTER,
    STREAMS,
    Address,
    attach,
    choice_steps,
    end_in,
    socket_of,
    sockets,
    tls_steps,
)

FAILURES_PER_S: Final = 4.0
"""Of all limited addresses together: the acceptor then sleeps 40 % of the time."""

BURST: Final = 10
"""Connections of an address that may be open before they have become links."""

LEAST_SHARE: Final = 2.0**-12
DOUBLES_S: Final = 1.0
"""Period after which a share doubles if the address stayed within its budget."""

MAX_KNOWN: Final = 1000
MAX_LIMITED: Final = 64
QUIET_S: Final = 60.0
FIRST_LOOK_S: Final = 0.001
LAST_LOOK_S: Final = 1.0
BACKLOG: Final = 4096
SILENT_S: Final = 30_000
"""A silent connection is kept from Zenoh as long as the system permits, about this long."""

TCP_SAVE_SYN: Final = 27
TCP_SAVED_SYN: Final = 28
HEADER_BYTES: Final = 256
UNAVAILABLE: Final = (
    "this system has no packet filter for sockets: connections that fail, such as those of a port "
    "scan, can keep new links out as long as they come"
)
UNPRIVILEGED: Final = (
    "connections without TLS, such as those of a port scan, can keep new links out as long as they "
    "come: this system lets only a process with CAP_NET_ADMIN filter them"
)


@contextmanager
def guarded_door(bus: Bus, report: Callable[[str], None]) -> Iterator[None]:
    """Guard the listening sockets of a locked bus while the block runs."""
    if bus.network.tls is None or not bus.network.listen:
        yield
        return
    ports = {end_in(one).port for one in (bus.locator(), *bus.network.listen)}
    door = Door(ports - {0}, report)
    bus.on_caller(door.linked)
    try:
        yield
    finally:
        door.close()


class Account:
    """What an address may still open, and the share of its connections that is let in."""

    __slots__ = ("changed_s", "filled_s", "level", "share")

    def __init__(self, now_s: float) -> None:
        self.level = float(BURST)
        self.share = 1.0
        self.filled_s = self.changed_s = now_s


class AddressShares:
    """Shares of the addresses whose connections become no links. Does no I/O.

    A connection beyond the budget halves the share of its address, a link doubles it, and so does
    time. No address is shut out.
    """

    def __init__(self) -> None:
        self._accounts: dict[Address, Account] = {}

    def arrived(self, address: Address, now_s: float) -> None:
        """Count a connection."""
        one = self._accounts.setdefault(address, Account(now_s))
        one.level -= 1.0
        if one.level < 0.0:
            one.level, one.share = 0.0, max(LEAST_SHARE, one.share / 2)
            one.changed_s = now_s
        if len(self._accounts) > MAX_KNOWN:
            del self._accounts[next(iter(self._accounts))]

    def linked(self, address: Address) -> None:
        """Take a connection off the account: it has become a link."""
        if one := self._accounts.get(address):
            one.level = min(float(BURST), one.level + 1.0)
            one.share = min(1.0, one.share * 2)

    def shares(self, now_s: float) -> dict[Address, float]:
        """Return the shares below 1, the least first, as of now."""
        limited = [account for account in self._accounts.values() if account.share < 1.0]
        rate_hz = FAILURES_PER_S / max(1, len(limited))
        for address, one in tuple(self._accounts.items()):
            one.level = min(float(BURST), one.level + rate_hz * (now_s - one.filled_s))
            one.filled_s = now_s
            if now_s - one.changed_s >= DOUBLES_S:
                one.share, one.changed_s = min(1.0, one.share * 2), now_s
            if one.level >= BURST and one.share >= 1.0:
                del self._accounts[address]
        found = ((address, one.share) for address, one in self._accounts.items() if one.share < 1.0)
        return dict(sorted(found, key=lambda pair: pair[1])[:MAX_LIMITED])


class Door:
    """Filters in front of the listening sockets of some ports, until `close`."""

    def __init__(self, ports: Collection[int], report: Callable[[str], None]) -> None:
        self._ports = frozenset(ports)
        self._report = report
        self._known: set[int] = set()
        self._addresses, self._lock = AddressShares(), Lock()
        self._shares: dict[Address, float] = {}
        self._reported_s = -QUIET_S
        self._end, self._ended = socket.socketpair()
        self._thread: Thread | None = None
        self._aside: list[socket.socket] = []
        self._listeners = listening_sockets(self._ports)
        try:
            for one in self._listeners:
                one.listen(BACKLOG)
                one.setsockopt(socket.IPPROTO_TCP, socket.TCP_DEFER_ACCEPT, SILENT_S)
                one.setsockopt(socket.IPPROTO_TCP, TCP_SAVE_SYN, 1)
                self._aside.append(socket_beside(one))
                attach(one, choice_steps({}), SO_ATTACH_REUSEPORT_CBPF)
        except OSError:
            self._open_wide()
        if not self._listeners:
            report(UNAVAILABLE)
            return
        try:
            for one in self._listeners:
                attach(one, tls_steps(), SO_ATTACH_FILTER)
        except OSError:
            report(UNPRIVILEGED)
        self._thread = Thread(target=self._run, name="door", daemon=True)
        self._thread.start()

    def linked(self, _zid: str, _name: str | None, address: str) -> None:
        """Note that a connection has become a link. May be called from any thread."""
        with suppress(ValueError), self._lock:
            self._addresses.linked(ip_of(end_in(address.rpartition("/")[2]).host))

    def close(self) -> None:
        """Remove the filter. The port is free only after this."""
        self._ended.close()
        if self._thread is not None:
            self._thread.join()
        self._open_wide()
        self._end.close()

    def _run(self) -> None:
        """Look for accepted sockets often after each event, and seldom without one.

        The event comes with a new connection, but Zenoh may accept it later.
        """
        poll, pause_s = select.epoll(), LAST_LOOK_S
        poll.register(self._end, select.EPOLLIN | select.EPOLLHUP)
        for one in self._listeners:
            poll.register(one, select.EPOLLIN | select.EPOLLET)
        try:
            while True:
                events = poll.poll(pause_s)
                if any(descriptor == self._end.fileno() for descriptor, _ in events):
                    return
                pause_s = FIRST_LOOK_S if events else min(LAST_LOOK_S, 2 * pause_s)
                with suppress(OSError):  # no descriptor is left to list the others: look again
                    self._look(time.monotonic())
        finally:
            poll.close()
            self._open_wide()

    def _look(self, now_s: float) -> None:
        """Remove the filter from new sockets, count their addresses and renew the shares."""
        open_now = dict(own_sockets())
        arrived = [
            self._admitted(one) for inode, one in open_now.items() if inode not in self._known
        ]
        self._known = set(open_now)
        with self._lock:
            for address in arrived:
                if address is not None:
                    self._addresses.arrived(address, now_s)
            shares = self._addresses.shares(now_s)
        if shares != self._shares:
            self._shares = shares
            for one in self._listeners:
                attach(one, choice_steps(shares), SO_ATTACH_REUSEPORT_CBPF)
            self._tell(now_s)

    def _admitted(self, descriptor: int) -> Address | None:
        """Remove the filter from an accepted socket, and return the address of its other end.

        Uses the descriptor itself, because there may be none left for a copy.
        """
        with suppress(OSError, ValueError):
            one = socket.socket(fileno=descriptor)
            try:
                if local_port(one) in self._ports and not is_listening(one):
                    with suppress(OSError):  # it has none
                        one.setsockopt(socket.SOL_SOCKET, SO_DETACH_FILTER, 0)
                    return source_of(one)
            finally:
                one.detach()
        return None

    def _tell(self, now_s: float) -> None:
        if self._shares and now_s - self._reported_s >= QUIET_S:
            self._reported_s = now_s
            address, share = next(iter(self._shares.items()))
            more = f" and {len(self._shares) - 1} other addresses" if len(self._shares) > 1 else ""
            self._report(
                f"connections from {address}{more} come faster than they become links: one in "
                f"{round(1 / share)} is let in; find out which program there dials this port"
            )

    def _open_wide(self) -> None:
        for one in self._aside:
            one.close()
        for one in self._listeners:
            with suppress(OSError):
                one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 0)
                one.setsockopt(socket.IPPROTO_TCP, socket.TCP_DEFER_ACCEPT, 0)
                one.setsockopt(socket.SOL_SOCKET, SO_DETACH_FILTER, 0)
            one.close()
        self._aside, self._listeners = [], []


def socket_beside(listener: socket.socket) -> socket.socket:
    """Return another socket that listens at the same address. Raises OSError."""
    one = socket.socket(listener.family, socket.SOCK_STREAM)
    try:
        for each in (listener, one):
            each.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if one.family == socket.AF_INET6:
            is_only = listener.getsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY)
            one.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, is_only)
        one.bind(listener.getsockname())
        one.listen(0)
    except OSError:
        one.close()
        raise
    return one


def listening_sockets(ports: frozenset[int]) -> list[socket.socket]:
    """Return duplicates of the listening TCP sockets of this process on some ports."""
    found = []
    for descriptor in sockets() if sys.platform == "linux" else ():
        with suppress(OSError):
            one = socket_of(os.dup(descriptor))
            if local_port(one) in ports and is_listening(one):
                found.append(one)
            else:
                one.close()
    return found


def source_of(one: socket.socket) -> Address:
    """Return the address of the other end of an accepted socket, even after a reset.

    Raises OSError, or ValueError.
    """
    header = one.getsockopt(socket.IPPROTO_TCP, TCP_SAVED_SYN, HEADER_BYTES)
    if not header:  # the system had no memory for it
        return ip_of(one.getpeername()[0])
    return ip_address(header[12:16] if header[0] >> 4 == 4 else header[8:24])


def local_port(one: socket.socket) -> int:
    """Return the port of a TCP socket, 0 for another. Raises OSError."""
    is_stream = one.family in STREAMS and one.type == socket.SOCK_STREAM
    return int(one.getsockname()[1]) if is_stream else 0


def is_listening(one: socket.socket) -> bool:
    """Return whether a socket accepts connections."""
    return bool(one.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN))


def own_sockets() -> Iterator[tuple[int, int]]:
    """Yield the inode and descriptor of each socket of this process."""
    for descriptor in sockets():
        with suppress(OSError):
            yield os.fstat(descriptor).st_ino, descriptor


def ip_of(host: str) -> Address:
    """Return the address of a host in numbers. Raises ValueError."""
    found = ip_address(host.partition("%")[0])
    return getattr(found, "ipv4_mapped", None) or found
