"""Addresses of sockets: resolve them, and explain errors."""

import errno
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from ipaddress import ip_address

from runtime.errors import UserError

Address = tuple[str, int]
ADVICE = {
    errno.EADDRINUSE: "another process uses this port: end it, or give another port",
    errno.EACCES: "ports below 1024 need rights of root: give a higher port",
    errno.EADDRNOTAVAIL: "this machine does not have the address: give 127.0.0.1 or 0.0.0.0",
}


@contextmanager
def explained(text: str) -> Iterator[None]:
    """Turn an OSError into a UserError with the endpoint and what to do."""
    try:
        yield
    except socket.gaierror as error:
        raise UserError(f"{text}: unknown host: check the name, or give an address") from error
    except OSError as error:
        why = ADVICE.get(error.errno or 0, error.strerror or str(error))
        raise UserError(f"{text}: {why}") from error


def resolved(host: str, port: int) -> Address:
    """Return the IPv4 address of a host."""
    return socket.gethostbyname(host), port


def name_of(address: Address) -> str:
    """Return an address as text."""
    return f"{address[0]}:{address[1]}"


def is_loopback(address: Address) -> bool:
    """Return whether an address is of this machine only."""
    return ip_address(address[0]).is_loopback
