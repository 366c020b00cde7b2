"""A name that does not resolve is the cause of a failed connection."""

import socket

import pytest

from protocol.bus.network import Network
from protocol.bus.session import unconnected, unknown_host


@pytest.fixture(autouse=True)
def names(monkeypatch: pytest.MonkeyPatch) -> None:
    def look_up(host: str, port: object, *_: object) -> list[object]:
        if host != "::1" and not host[0].isdigit():
            raise socket.gaierror(-2, "Name or service not known")
        return []

    monkeypatch.setattr(socket, "getaddrinfo", look_up)


@pytest.mark.parametrize(
    ("endpoints", "host"),
    [
        (("tcp/nohost:7447",), "nohost"),
        (("tls/nohost.lan:7447#x=1",), "nohost.lan"),
        (("tcp/127.0.0.1:7447",), ""),
        (("tcp/[::1]:7447",), ""),
        (("tcp/nohost:7447", "tcp/127.0.0.1:7447"), ""),
        (("unixsock-stream/tmp/nohost",), ""),
        ((), ""),
    ],
)
def test_the_host_that_does_not_resolve(endpoints: tuple[str, ...], host: str) -> None:
    assert unknown_host(endpoints) == host


def test_the_error_names_the_host_and_the_endpoint() -> None:
    network = Network(mode="client", connect=("tcp/nohost:7447",))
    assert str(unconnected("tcp/nohost:7447", network)) == (
        "the name nohost of tcp/nohost:7447 does not resolve: correct the endpoint"
    )
