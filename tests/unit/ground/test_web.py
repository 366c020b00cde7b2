"""The app in a browser: tokens, foreign pages, addresses, and its command line."""

import asyncio
import socket
from asyncio.subprocess import Process
from collections.abc import Awaitable, Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from aiohttp import CookieJar, web
from aiohttp.test_utils import TestClient, TestServer
from hypothesis import given
from hypothesis import strategies as st

from checks.harness.until import PATIENCE_S
from ground.cli.main import parse
from ground.web import Address, address_of, refuse_taken, token_of, words_of
from ground.web_server import (
    MAX_BROWSERS,
    MAX_SESSIONS,
    REFUSAL,
    WebAccess,
    WebServer,
    is_same_origin,
)
from runtime.errors import UserError
from tests.support.each import each

TOKEN = "0123456789abcdefgh"

Client = TestClient[web.Request, web.Application]


def with_client(
    story: Callable[[Client, WebServer], Awaitable[None]], command: str = "true"
) -> None:
    """Run the story with a server in this process."""

    async def run() -> None:
        server = WebServer(command, "127.0.0.1", 8770, TOKEN, lambda: None)
        server.initialize_logging()
        app = await server._make_app()
        jar = CookieJar(unsafe=True)  # accept cookies from numeric addresses
        async with TestClient(TestServer(app), cookie_jar=jar) as client:
            await story(client, server)

    asyncio.run(run())


@each("path", ["/", "/ws", "/static/js/textual.js", "/download/x", "/nowhere"])
@each("query", ["", "?token=", "?token=wrong", "?token=0123456789abcdefgh1"])
def test_requests_without_the_token_are_refused(path: str, query: str) -> None:
    async def story(client: Client, server: WebServer) -> None:
        answer = await client.get(path + query)
        assert answer.status == 403
        assert await answer.text() == REFUSAL

    with_client(story)


def test_token_opens_the_page_and_leaves_the_address() -> None:
    async def story(client: Client, server: WebServer) -> None:
        first = await client.get(f"/?token={TOKEN}", allow_redirects=False)
        assert (first.status, first.headers["Location"]) == (303, "/")
        cookie = first.cookies[server.access.cookie]
        assert (cookie["httponly"], cookie["samesite"]) == (True, "Strict")
        assert TOKEN not in cookie.value
        assert len(cookie.value) >= 32
        page = await client.get("/")
        assert page.status == 200
        text = await page.text()
        assert TOKEN not in text
        assert "<title>Sidestep</title>" in text
        assert "googleapis" not in text
        assert "<svg" not in text
        assert f"ws://{client.host}:{client.port}/ws" in text
        assert "default-src 'self'" in page.headers["Content-Security-Policy"]
        assert page.headers["Cache-Control"] == "no-store"
        script = await client.get("/static/js/textual.js")
        assert script.status == 200

    with_client(story)


def test_each_browser_has_its_session_and_the_oldest_ends() -> None:
    """Browsers send the cookie to every service on this host, so it must not be the token."""

    async def story(client: Client, server: WebServer) -> None:
        sessions = []
        for _ in range(MAX_SESSIONS + 1):
            answer = await client.get(f"/?token={TOKEN}", allow_redirects=False)
            sessions.append(answer.cookies[server.access.cookie].value)
        assert len(set(sessions)) == len(sessions)
        allowed = [server.access.is_session(one) for one in sessions]
        assert allowed == [False] + [True] * MAX_SESSIONS
        client.session.cookie_jar.clear()
        assert (await client.get("/", headers=cookie(server, TOKEN))).status == 403
        assert (await client.get("/", headers=cookie(server, sessions[-1]))).status == 200

    with_client(story)


def cookie(server: WebServer, value: str) -> dict[str, str]:
    return {"Cookie": f"{server.access.cookie}={value}"}


@each("sent", [b"\xe4\xff", b"\xc3\xa4", b"\x80" * 40, b'"\xff'])
@each("place", ["cookie", "token"])
def test_undecodable_bytes_are_refused_without_an_error(sent: bytes, place: str) -> None:
    """Such bytes must not cause an internal error (status 500)."""

    async def story(client: Client, server: WebServer) -> None:
        reader, writer = await asyncio.open_connection(client.host, client.port)
        query = b"?token=" + sent if place == "token" else b""
        cookie = f"{server.access.cookie}=".encode() + sent if place == "cookie" else b"a=b"
        head = b"GET /%b HTTP/1.1\r\nHost: here\r\nCookie: %b\r\nConnection: close\r\n\r\n"
        writer.write(head % (query, cookie))
        status = await reader.readline()
        assert status.split()[1] in (b"400", b"403")
        writer.close()
        await writer.wait_closed()

    with_client(story)


def test_page_of_another_site_cannot_open_a_web_socket() -> None:
    async def story(client: Client, server: WebServer) -> None:
        await client.get(f"/?token={TOKEN}")
        answer = await client.get("/ws", headers={"Origin": "http://evil.example"})
        assert answer.status == 403
        assert "another site" in await answer.text()
        assert not server.sessions

    with_client(story)


def test_number_of_browsers_is_limited() -> None:
    async def story(client: Client, server: WebServer) -> None:
        await client.get(f"/?token={TOKEN}")
        others = {asyncio.create_task(asyncio.sleep(60.0)) for _ in range(MAX_BROWSERS)}
        server.sessions |= others
        answer = await client.get("/ws")
        assert answer.status == 503
        for other in others:
            other.cancel()

    with_client(story)


def test_browser_that_leaves_frees_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    apps: list[Process] = []
    begin = asyncio.create_subprocess_shell

    async def begun(*words: Any, **more: Any) -> Process:
        apps.append(await begin(*words, **more))
        return apps[-1]

    monkeypatch.setattr(asyncio, "create_subprocess_shell", begun)

    async def story(client: Client, server: WebServer) -> None:
        await client.get(f"/?token={TOKEN}")
        async with client.ws_connect("/ws?width=80&height=24") as socket:
            assert len(server.sessions) == 1
            await socket.close()
        async with asyncio.timeout(PATIENCE_S):
            while server.sessions:
                await asyncio.sleep(0.01)
        for app in apps:  # ignores its input; must not outlive the loop
            app.kill()
            await app.communicate()

    with_client(story, command="exec cat")


def test_tokens_are_compared_in_full() -> None:
    access: Any = WebAccess(TOKEN, 1)
    assert access.is_token(TOKEN)
    assert not access.is_token(None)
    assert not access.is_token("")
    assert not access.is_token(TOKEN[:-1])
    assert not access.is_token("\u00e4" * 20)
    assert not access.is_token("\udce4" * 20)
    assert not access.is_session(None)
    assert not access.is_session(TOKEN)


@each(
    ("origin", "host", "fits"),
    [
        (None, "127.0.0.1:80", True),
        ("http://127.0.0.1:80", "127.0.0.1:80", True),
        ("http://127.0.0.1:81", "127.0.0.1:80", False),
        ("null", "127.0.0.1:80", False),
        ("", "127.0.0.1:80", False),
    ],
)
def test_origin_of_a_request(origin: str | None, host: str, fits: bool) -> None:
    assert is_same_origin(origin, host) is fits


@each(
    ("text", "found"),
    [
        ("", Address("127.0.0.1", 8770)),
        ("9000", Address("127.0.0.1", 9000)),
        (":9000", Address("127.0.0.1", 9000)),
        ("0.0.0.0", Address("0.0.0.0", 8770)),
        ("0.0.0.0:80", Address("0.0.0.0", 80)),
        ("ground.local:9000", Address("ground.local", 9000)),
        ("[::1]:9000", Address("::1", 9000)),
    ],
)
def test_address_is_completed_with_defaults(text: str, found: Address) -> None:
    assert address_of(text) == found


@each("text", ["127.0.0.1:0", "1:99999", "0", "a b:80", "http://x:80", "x:/80"])
def test_malformed_address_is_refused(text: str) -> None:
    with pytest.raises(UserError, match="--web"):
        address_of(text)


@given(st.text(max_size=40))
def test_any_text_is_an_address_or_refused(text: str) -> None:
    try:
        found = address_of(text)
    except UserError:
        return
    assert found.host
    assert 0 < found.port < 65536


def test_url_carries_the_token() -> None:
    assert Address("127.0.0.1", 80).url("abc") == "http://127.0.0.1:80/?token=abc"
    assert Address("::1", 80).url("abc") == "http://[::1]:80/?token=abc"


def test_only_loopback_is_local() -> None:
    assert Address("127.0.0.1", 1).local
    assert Address("localhost", 1).local
    assert not Address("0.0.0.0", 1).local


def test_each_start_has_a_new_token() -> None:
    tokens = {token_of(None) for _ in range(20)}
    assert len(tokens) == 20
    assert min(map(len, tokens)) >= 24


def test_token_is_read_from_a_file(tmp_path: Path) -> None:
    file = tmp_path / "token"
    file.write_text("0123456789abcdef-_\n")
    assert token_of(str(file)) == "0123456789abcdef-_"


@pytest.mark.parametrize(
    "content", [b"", b"short", b"0123456789abcde;", "0123456789abcdef\u00e4".encode()]
)
def test_short_or_untypable_token_is_refused(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "token"
    file.write_bytes(content)
    with pytest.raises(UserError, match="--token-file"):
        token_of(str(file))


def test_missing_token_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="nowhere: No such file"):
        token_of(str(tmp_path / "nowhere"))


@each(
    "words",
    [
        [],
        ["--id", "r2", "--connect", "tcp/127.0.0.1:7000"],
        ["--theme", "light", "--hz", "5.0", "--ascii"],
        ["--record", "logs", "--keys", "keys.toml", "--config", "all.toml"],
        ["--no-record"],
    ],
)
def test_browsers_get_the_options_of_the_command_line(words: list[str]) -> None:
    wanted = parse(["ground", *words])
    given = parse(words_of(parse(["ground", "--web", "9000", "--token-file", "t", *words])))
    assert vars(given) == vars(wanted)
    assert given.web is None


def test_every_other_option_is_passed_on() -> None:
    own = {"verb", "web", "token_file", "json", "plain"}
    words = ["--connect", "c", "--id", "i", "--config", "f", "--record", "d", "--theme", "dark"]
    full = parse(["ground", "--web", "1", *words, "--hz", "2", "--keys", "k", "--ascii"])
    again = parse(words_of(full))
    assert {name for name in vars(full) if vars(full)[name] != vars(again)[name]} <= own
    assert again.keys == Path("k")


def test_address_in_use_is_refused() -> None:
    with closing(socket.socket()) as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(UserError, match=f"{port}.*choose another port"):
            refuse_taken(Address("127.0.0.1", port))
    refuse_taken(Address("127.0.0.1", port))
