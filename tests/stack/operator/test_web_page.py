"""A web page in a real browser sends all that it can to the gateway, and the robot does nothing.

It sends by HTTP, web sockets, TLS, WebRTC (to a TURN server) and WebTransport.
"""

import asyncio
from collections.abc import Callable
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import Any

import pytest

from gateways.mavlink.endpoints import ReceivedBytes, opened
from tests.support.gateway.telemetry import everything
from tests.support.gateway.whole import CommandedPort, WholeGateway
from tests.support.stack.browser import SEEN_S, browsing, chromium
from tests.unit.gateways.mavlink.test_trouble import ARM, CLEAR, HEARTBEAT, STOP, frame_of

pytestmark = [
    pytest.mark.stack,
    pytest.mark.skipif(chromium() is None, reason="no Chromium on this machine"),
]

BYTES = b"".join(frame_of(message) for message in (HEARTBEAT, ARM, CLEAR, STOP) * 40)
ATTACK = """
const frames = new Uint8Array(%s), tcp = '127.0.0.1:%d', udp = '127.0.0.1:%d';
const text = String.fromCharCode(...frames);
fetch(`http://${tcp}/`, {method: 'POST', mode: 'no-cors', body: frames});
fetch(`https://${tcp}/`, {method: 'POST', mode: 'no-cors', body: frames});
new WebSocket(`ws://${tcp}/`);
const turn = {username: text.slice(0, 99), credential: text};
const servers = [`turn:${tcp}?transport=tcp`, `turn:${udp}?transport=udp`];
const peer = new RTCPeerConnection({iceServers: servers.map((urls) => ({urls, ...turn}))});
peer.createDataChannel(text.slice(0, 99));
peer.createOffer().then((offer) => peer.setLocalDescription(offer));
const options = {serverCertificateHashes: [{algorithm: 'sha-256', value: frames.slice(0, 32)}]};
new WebTransport(`https://${udp}/`, options).ready.catch(() => {});
'sent'
"""
TCP_SEEN: dict[str, Callable[[bytes], bool]] = {
    "HTTP": lambda data: data.startswith(b"POST / HTTP"),
    "web socket": lambda data: data.startswith(b"GET / HTTP"),
    "TLS": lambda data: data.startswith(b"\x16\x03"),
    "TURN": lambda data: data.startswith(b"\0\3"),
}
UDP_SEEN: dict[str, Callable[[bytes], bool]] = {
    "STUN": lambda data: data.startswith(b"\0\1"),
    "TURN": lambda data: data.startswith(b"\0\3"),
    "QUIC": lambda data: data[0] & 0xC0 == 0xC0,
}


class Site(BaseHTTPRequestHandler):
    """A page without content."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()

    def log_message(self, *_: object) -> None:
        """Say nothing."""


class Attacked:
    """A gateway with one real endpoint, and what arrives there."""

    def __init__(
        self, patch: pytest.MonkeyPatch, kind: str, seen: dict[str, Callable[[bytes], bool]]
    ) -> None:
        self.endpoint: Any = opened(f"{kind}:127.0.0.1:0")
        receive = partial(self._receive, self.endpoint.receive)
        patch.setattr(self.endpoint, "receive", receive)
        self.missing = dict(seen)
        self.whole = WholeGateway(CommandedPort(), real=self.endpoint)
        self.whole.port.telemetry |= everything()

    def _receive(self, receive: Callable[[], list[ReceivedBytes]]) -> list[ReceivedBytes]:
        found = receive()
        for one in found:
            for kind in [kind for kind, is_seen in self.missing.items() if is_seen(one.data)]:
                del self.missing[kind]
        return found

    def check(self) -> None:
        """Assert that nothing of it was obeyed, not even a stop."""
        port = self.whole.port
        assert (port.performed, port.leases, port.stops, port.driven) == ([], [], [], [])
        assert list(self.whole.gateway.clients) == []


async def attack(page_url: str, attacked: tuple[Attacked, Attacked]) -> None:
    async with browsing(page_url) as page, asyncio.timeout(SEEN_S):
        ports = [one.endpoint.port for one in attacked]
        assert await page.value(ATTACK % (list(BYTES), *ports)) == "sent"
        while any(one.missing for one in attacked):
            for one in attacked:
                one.whole.run(0.02)
            await asyncio.sleep(0.01)


def test_web_page_commands_nothing_by_any_protocol_of_a_browser(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    attacked = (
        Attacked(monkeypatch, "tcpin", TCP_SEEN),
        Attacked(monkeypatch, "udpin", UDP_SEEN),
    )
    site = ThreadingHTTPServer(("127.0.0.1", 0), Site)
    Thread(target=site.serve_forever, daemon=True).start()
    try:
        asyncio.run(attack(f"http://127.0.0.1:{site.server_port}/", attacked))
        for one in attacked:
            one.whole.run(1.0)
            one.check()
    except TimeoutError:
        pytest.fail(f"not sent: {[list(one.missing) for one in attacked]}")
    finally:
        site.shutdown()
        site.server_close()
        for one in attacked:
            one.whole.close()
