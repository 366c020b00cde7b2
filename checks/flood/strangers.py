"""Strangers without a certificate: connections that become no link, and forged stop datagrams."""

import socket
import ssl
import threading
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from time import monotonic
from types import MappingProxyType
from typing import Final, Self

from checks.harness.tcp_proxy import address_of
from protocol.stop_datagram import Press, sealed_press

TURN_S: Final = 0.005
MAX_SILENT: Final = 500
DATAGRAMS: Final = "datagrams"


def tls_hello() -> bytes:
    """Return the first bytes of a TLS client."""
    client = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    client.check_hostname, client.verify_mode = False, ssl.CERT_NONE
    out = ssl.MemoryBIO()
    with suppress(ssl.SSLWantReadError):
        client.wrap_bio(ssl.MemoryBIO(), out).do_handshake()
    return out.read()


GREETINGS: Final[Mapping[str, bytes]] = MappingProxyType(
    {
        "garbage": b"this is no TLS 123",
        "http": b"GET / HTTP/1.1\r\nHost: robot\r\n\r\n",
        "hello": tls_hello(),
        "silent": b"",
        DATAGRAMS: sealed_press(b"guessed", "r1", Press("anna", 0, 1)),
    }
)
"""What a stranger sends first. All close at once but the silent ones, which stay."""


RATES_HZ: Final[Mapping[str, float]] = MappingProxyType(
    {"garbage": 100.0, "http": 100.0, "silent": 100.0, DATAGRAMS: 1000.0}
)
"""The strangers of `bench flood`, with how often they call."""

SOURCE: Final = "127.0.0.2"


class Strangers:
    """Dials an endpoint at a rate from an address, until the block ends; `called` counts."""

    def __init__(self, endpoint: str, way: str, rate_hz: float, source: str) -> None:
        self.called = 0
        self._place, self._source = address_of(endpoint), source
        self._greeting, self._rate_hz = GREETINGS[way], rate_hz
        self._type = socket.SOCK_DGRAM if way == DATAGRAMS else socket.SOCK_STREAM
        self._kept: deque[socket.socket] = deque(maxlen=MAX_SILENT)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        for one in self._kept:
            one.close()

    def _run(self) -> None:
        begun_s = monotonic()
        while not self._over.wait(TURN_S):
            for _ in range(int((monotonic() - begun_s) * self._rate_hz) - self.called):
                self._call()
                self.called += 1

    def _call(self) -> None:
        one = socket.socket(type=self._type)
        one.setblocking(False)  # an unanswered connection must not delay the next
        with suppress(OSError):
            one.bind((self._source, 0))
            one.connect_ex(self._place)
            if self._greeting:
                one.send(self._greeting)
            else:
                self._kept.append(one)
                return
        one.close()
