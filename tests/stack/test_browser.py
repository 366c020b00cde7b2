"""The ground station in a browser, and web pages that would drive the robot."""

import asyncio
import os
import re
import signal
import subprocess
import sys
from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from math import hypot
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from checks.harness.crew import Crew, Witness, alive, children_of, free_endpoint
from checks.harness.processes import Running
from checks.harness.until import PATIENCE_S, until
from gateways.mavlink.endpoints import Arrival, opened
from tests.support.gateway.fake_port import CommandedPort, WholeGateway, everything
from tests.support.screens import SEEN_S, Page, browsing, chromium, keep, sees
from tests.unit.gateways.mavlink.test_trouble import ARM, CLEAR, HEARTBEAT, STOP, frame_of


@contextmanager
def served(crew: Crew) -> Iterator[tuple[Running, str]]:
    """Start the ground station for browsers; return it with the address that it prints."""
    port = free_endpoint().rpartition(":")[2]
    ground = crew.dialling("ground", "--web", port)
    ground.says("open http", 20.0)
    found = re.search(r"open (http://\S+)", ground.said)
    assert found is not None
    yield ground, found[1]


def in_browser(url: str, story: Callable[[Page], Awaitable[None]]) -> None:
    async def tell() -> None:
        async with browsing(url) as page:
            await story(page)

    asyncio.run(tell())


@pytest.mark.stack
@pytest.mark.skipif(chromium() is None, reason="no Chromium on this machine")
def test_the_map_draws_and_a_goal_that_is_typed_there_moves_the_robot() -> None:
    with Crew(lockstep=True) as crew:
        crew.robot()
        crew.plant()
        with served(crew) as (_, url), Witness(crew.endpoint) as witness:
            witness.ready()
            start = witness.truth

            async def story(page: Page) -> None:
                keep(await sees(page), "browser-standing.png")
                assert "token" not in await page.value("location.href")
                await page.click(600, 5)
                async with asyncio.timeout(SEEN_S):
                    while witness.truth.speed_m_s < 0.25:  # refused until all has been read
                        await page.type(":goal 2.6 2.0\n")
                        await asyncio.sleep(1.0)
                keep(await sees(page), "browser-driving.png")

            in_browser(url, story)
            assert hypot(witness.truth.x_m - start.x_m, witness.truth.y_m - start.y_m) > 0.1
            # The browser is gone and with it the operator: the robot does not go on.
            until(witness.standing, what="standing without an operator")


@pytest.mark.stack
@pytest.mark.skipif(chromium() is None, reason="no Chromium on this machine")
def test_without_the_token_a_browser_sees_a_refusal_and_nothing_is_started() -> None:
    with Crew() as crew, served(crew) as (_, url):

        async def story(page: Page) -> None:
            async with asyncio.timeout(SEEN_S):
                while "requires a token" not in (await page.value("document.body.innerText") or ""):
                    await asyncio.sleep(0.1)

        in_browser(url.partition("?")[0], story)


@pytest.mark.stack
@pytest.mark.skipif(chromium() is None, reason="no Chromium on this machine")
def test_ctrl_c_ends_the_server_and_the_apps_of_its_browsers() -> None:
    with Crew() as crew:
        crew.robot()
        crew.plant()
        with served(crew) as (ground, url):

            async def story(page: Page) -> None:
                await sees(page)
                children = children_of(ground.process.pid)
                assert len(children) == 1
                ground.send(signal.SIGINT)
                assert await asyncio.to_thread(ground.ends) in (0, 128 + signal.SIGINT)
                await asyncio.to_thread(until, lambda: not alive(children[0]))

            in_browser(url, story)
            assert "Traceback" not in ground.said


@pytest.mark.stack
@pytest.mark.skipif(chromium() is None, reason="no Chromium on this machine")
def test_a_port_that_is_taken_and_a_place_that_is_none_are_refused() -> None:
    with Crew() as crew, served(crew) as (_, url):
        port = url.partition("?")[0].strip("/").rpartition(":")[2]
        code, said = crew.run("ground", "--web", port)
        assert (code, "choose another port" in said) == (2, True), said
        code, said = crew.run("ground", "--web", "127.0.0.1:99999")
        assert (code, "1 to 65535" in said) == (2, True), said


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
        self.missing = dict(seen)
        self.whole = WholeGateway(CommandedPort(), real=self.endpoint)
        self.whole.port.telemetry |= everything()
        gateway = self.whole.gateway
        patch.setattr(gateway, "received", partial(self._received, gateway.received))

    def _received(
        self, receive: Callable[..., None], endpoint: object, arrivals: Sequence[Arrival]
    ) -> None:
        for arrival in arrivals:
            for kind in [kind for kind, is_seen in self.missing.items() if is_seen(arrival.data)]:
                del self.missing[kind]
        receive(endpoint, arrivals)

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


@pytest.mark.stack
@pytest.mark.skipif(chromium() is None, reason="no Chromium on this machine")
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


DRIVER = "textual.drivers.web_driver:WebDriver"
READY = b"__GANGLION__\n"
LEAVE = "\x11"
HOSTILE = (
    "\x1b[200~\x1b[48;;;;t\x1b[201~",
    "\x1b[99999999999u",
    "\x1b[200~ D D a",
)


def packet(text: str) -> bytes:
    data = text.encode()
    return b"D" + len(data).to_bytes(4, "big") + data


@pytest.mark.stack
@pytest.mark.parametrize("text", HOSTILE)
def test_after_any_paste_keys_still_count(tmp_path: Path, text: str) -> None:
    with Crew() as crew:
        crew.robot()
        words = [
            sys.executable,
            "-m",
            "sidestep",
            "ground",
            "--connect",
            crew.endpoint,
            "--no-record",
        ]
        environment = {**os.environ, "TEXTUAL_DRIVER": DRIVER, "XDG_STATE_HOME": str(tmp_path)}
        drawn = tmp_path / "drawn"
        with (
            drawn.open("wb") as output,
            subprocess.Popen(
                words, env=environment, stdin=subprocess.PIPE, stdout=output, cwd=tmp_path
            ) as app,
        ):
            try:
                until(lambda: READY in drawn.read_bytes(), what="the app")
                send(app, text)
                assert leaves(app) == 0
            finally:
                app.kill()


def send(app: "subprocess.Popen[bytes]", text: str) -> None:
    assert app.stdin is not None
    app.stdin.write(packet(text))
    app.stdin.flush()


def leaves(app: "subprocess.Popen[bytes]") -> int:
    """Press the key that leaves, until it does."""
    for _ in range(round(PATIENCE_S / 0.5)):
        try:
            with suppress(BrokenPipeError):  # it has just left
                send(app, LEAVE)
            return app.wait(0.5)
        except subprocess.TimeoutExpired:
            continue
    raise AssertionError("no key counts any more")


WORKER = """\
addEventListener("message", async (event) => {
  await importScripts("suffix.js");
  postMessage(event.data + suffix);
});
"""
ASKING = """\
<script src="iframe-worker.js"></script><body><script>
const worker = new Worker("worker.js");
worker.addEventListener("message", (event) => { window.answer = event.data });
worker.postMessage("sonar");
</script>
"""


@pytest.mark.stack
@pytest.mark.skipif(chromium() is None, reason="no Chromium on this machine")
def test_site_opened_as_files_has_a_worker_for_its_search(tmp_path: Path) -> None:
    shim = Path(__file__).parents[2] / "docs" / "assets" / "iframe-worker.js"
    files = {"iframe-worker.js": shim.read_text(), "worker.js": WORKER, "page.html": ASKING}
    for name, text in {**files, "suffix.js": "var suffix = 's';"}.items():
        (tmp_path / name).write_text(text)

    async def story(page: Page) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while await page.value("window.answer") != "sonars":
                await asyncio.sleep(0.05)

    in_browser((tmp_path / "page.html").as_uri(), story)
