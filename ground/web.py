"""Serve the ground station to browsers (`sidestep ground --web`) until SIGINT or SIGTERM.

textual-serve has no authentication, so the token of each request is checked before. The browser
sends the token once, in the address, and gets a cookie with a random session id. So the address
bar, a referrer and other services on this host, to which browsers send the cookie, never see the
token. A web socket is opened only from a page of this server.
"""

import argparse
import asyncio
import logging
import os
import secrets
import shlex
import socket
from collections import deque
from collections.abc import Awaitable, Callable
from contextlib import closing
from hmac import compare_digest
from pathlib import Path
from secrets import token_urlsafe
from typing import Any, Final, NamedTuple, Protocol
from urllib.parse import urlsplit

from aiohttp import web
from aiohttp.typedefs import Handler, Middleware
from textual_serve.server import Server

from ground.launch.child_command import command
from ground.text.output import Output
from runtime.errors import UserError
from runtime.files import bytes_in

REFUSAL: Final = (
    "This ground station requires a token: open the address that `sidestep ground --web` printed.\n"
)
FOREIGN: Final = "Refused: this request comes from a page of another site.\n"
HEADERS: Final = {
    "Content-Security-Policy": (
        "default-src 'self'; script-src 'self' 'unsafe-inline'; style-src 'self' 'unsafe-inline';"
        " img-src 'self' data:; connect-src 'self' ws: wss:; frame-ancestors 'none'"
    ),
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}


SESSION_BYTES: Final = 24
MAX_SESSIONS: Final = 64
"""The number of browsers that are admitted by cookie; a new session replaces the oldest."""


class WebAccess:
    """Admits browsers that have the token.

    The name of the `cookie` includes the port, because cookies are not separated by port.
    """

    def __init__(self, token: str, port: int) -> None:
        self._token = token
        self.sessions: deque[str] = deque(maxlen=MAX_SESSIONS)
        self.cookie = f"sidestep_{port}"

    def is_token(self, token: str | None) -> bool:
        """Return whether the text is the token."""
        return token is not None and is_same(token, self._token)

    def is_session(self, session: str | None) -> bool:
        """Return whether the text is the session id of an admitted browser."""
        return session is not None and any(is_same(session, one) for one in self.sessions)

    def middleware(self) -> Middleware:
        """Return a middleware that answers 403 to requests without token or session."""

        @web.middleware
        async def check(request: web.Request, handler: Handler) -> web.StreamResponse:
            if self.is_token(request.query.get("token")):
                return self._admit(request)
            if not self.is_session(request.cookies.get(self.cookie)):
                return web.Response(status=403, text=REFUSAL, headers=HEADERS)
            if not is_same_origin(request.headers.get("Origin"), request.host):
                return web.Response(status=403, text=FOREIGN, headers=HEADERS)
            response = await handler(request)
            if not response.prepared:
                response.headers.update(HEADERS)
            return response

        return check

    def _admit(self, request: web.Request) -> web.StreamResponse:
        """Redirect to the address without the token, and set a cookie for a new session."""
        response = web.Response(status=303, headers={"Location": request.path, **HEADERS})
        session = token_urlsafe(SESSION_BYTES)
        self.sessions.append(session)
        response.set_cookie(self.cookie, session, httponly=True, samesite="Strict", path="/")
        return response


def is_same(given: str, secret: str) -> bool:
    """Compare in constant time.

    The given text may hold lone surrogates, which UTF-8 cannot encode.
    """
    return compare_digest(given.encode(errors="surrogatepass"), secret.encode())


def is_same_origin(origin: str | None, host: str) -> bool:
    """Return whether a request has no origin, or comes from a page of this host."""
    try:
        return origin is None or urlsplit(origin).netloc == host
    except ValueError:  # the origin is not an address
        return False


DEFAULT_HOST: Final = "127.0.0.1"
DEFAULT_PORT: Final = 8770
TOKEN_BYTES: Final = 18
MIN_TOKEN_LENGTH: Final = 16
MAX_BYTES: Final = 4096
LOOPBACK: Final = frozenset({"127.0.0.1", "::1", "localhost"})


class Address(NamedTuple):
    """Host and port on which the server listens."""

    host: str
    port: int

    @property
    def local(self) -> bool:
        """True when only this machine can reach the address."""
        return self.host in LOOPBACK

    def url(self, token: str) -> str:
        """Return the address to open, with the token; the first response removes the token."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{self.port}/?token={token}"


def address_of(text: str) -> Address:
    """Read HOST:PORT, PORT or HOST, completed with the defaults.

    Raise UserError when the text is none of these.
    """
    host, _, port = text.strip().rpartition(":") if ":" in text else ("", "", text.strip())
    if port and not (port.isascii() and port.isdigit()):
        host, port = text.strip(), ""
    number = int(port[:6]) if port else DEFAULT_PORT
    if not 0 < number < 65536:
        raise UserError(f"--web {text}: the port must be a number from 1 to 65535")
    host = host.strip("[]") or DEFAULT_HOST
    if any(letter.isspace() or letter in "/?#@" for letter in host):
        raise UserError(f"--web {text}: not HOST:PORT, such as {DEFAULT_HOST}:{DEFAULT_PORT}")
    return Address(host, number)


def token_of(file: str | None) -> str:
    """Return the token from a file, or a new random one.

    Raise UserError when the file cannot be read or the token is too short.
    """
    if file is None:
        return secrets.token_urlsafe(TOKEN_BYTES)
    try:
        token = bytes_in(Path(file), MAX_BYTES).decode("ascii").strip()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not plain ASCII"
        raise UserError(f"--token-file {file}: {reason}: write a token into a file") from error
    if len(token) < MIN_TOKEN_LENGTH or not all(one.isalnum() or one in "-_" for one in token):
        raise UserError(
            f"--token-file {file}: a token must have at least {MIN_TOKEN_LENGTH} characters,"
            " each a letter, a digit, - or _"
        )
    return token


MAX_BROWSERS: Final = 8
FULL: Final = (
    f"{MAX_BROWSERS} browsers, the maximum, have this ground station open:"
    " close one of them and reload this page.\n"
)


class WebServer(Server):
    """Serves the app that `command` starts, in one process for each admitted browser.

    `ready` is called when the server listens.
    """

    def __init__(
        self, command: str, address: Address, token: str, ready: Callable[[], None]
    ) -> None:
        super().__init__(command, host=address.host, port=address.port, title="Sidestep")
        self.access = WebAccess(token, address.port)
        self.sessions: set[asyncio.Task[object]] = set()
        self._ready = ready

    def initialize_logging(self) -> None:
        """Silence the loggers of textual-serve and aiohttp."""
        logging.getLogger("textual-serve").setLevel(logging.CRITICAL)
        logging.getLogger("aiohttp").setLevel(logging.CRITICAL)

    async def _make_app(self) -> web.Application:
        app = await super()._make_app()
        app.middlewares.append(self.access.middleware())
        return app

    async def on_startup(self, app: web.Application) -> None:
        """Call `ready`."""
        self._ready()

    async def handle_index(self, request: web.Request) -> Any:
        """Serve the page, with links to the host that the browser used in its request."""
        self.public_url = f"{request.scheme}://{request.host}"
        page: Callable[[web.Request], Awaitable[web.StreamResponse]] = super().handle_index
        return await page(request)

    async def handle_websocket(self, request: web.Request) -> Any:
        """Run an app for a browser; answer 503 when there are too many."""
        task = asyncio.current_task()
        if task is None or len(self.sessions) >= MAX_BROWSERS:
            return web.Response(status=503, text=FULL)
        self.sessions.add(task)
        try:
            return await super().handle_websocket(request)
        finally:
            self.sessions.discard(task)

    async def on_shutdown(self, app: web.Application) -> None:
        """End the apps, because open browsers would delay the end by a minute."""
        for session in self.sessions:
            session.cancel()
        await asyncio.gather(*self.sessions, return_exceptions=True)


PASSED_ON: Final = ("connect", "run", "context", "id", "config", "record", "theme", "hz", "keys")
SWITCHES: Final = ("no_record", "ascii", "quiet_bell")
LACKING: Final = "--web needs the extra `web`: pip install 'sidestep[web]'"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of a ground station that is served to browsers."""
    parser.add_argument(
        "--web",
        nargs="?",
        const="",
        metavar="HOST:PORT",
        help=f"serve browsers instead of this terminal (default {DEFAULT_HOST}:{DEFAULT_PORT})",
    )
    parser.add_argument(
        "--shown",
        metavar="HOST:PORT",
        help="the address that browsers use when it differs, as with the port of a container",
    )
    parser.add_argument(
        "--token-file", metavar="FILE", help="read the token from a file (default a new random one)"
    )


class WebOptions(Protocol):
    """The options of a ground station that is served to browsers."""

    web: str
    shown: str | None
    token_file: str | None
    connect: str | None
    run: str | None
    context: str | None
    id: str | None
    config: str | None
    record: str | None
    no_record: bool
    theme: str | None
    ascii: bool
    quiet_bell: bool
    hz: float | None
    keys: Path | None


def serve(options: WebOptions, output: Output) -> int:
    """Serve until SIGINT or SIGTERM; each browser gets an app with the same options.

    Raise UserError when the address is in use or the extra `web` is not installed.
    """
    address, token = address_of(options.web), token_of(options.token_file)
    shown = address if options.shown is None else address_of(options.shown)
    try:
        pass
    except ImportError as error:
        raise UserError(LACKING) from error
    refuse_taken(address)

    def ready() -> None:
        output.note(f"open {shown.url(token)}")
        if not shown.local:
            output.note(
                "every client that reaches this address with the token can drive the robot, and"
                " plain HTTP shows the token to the network: put a TLS proxy in front"
            )

    # exec replaces the shell that textual-serve starts, so that signals reach the app.
    line = "exec " + shlex.join(command(words_of(options), os.getpid()))
    WebServer(line, address, token, ready).serve()
    output.note("ground station ends")
    return 0


def words_of(options: WebOptions) -> list[str]:
    """Return the command line with which the app of each browser is started."""
    words = ["ground"]
    for name in PASSED_ON:
        value = getattr(options, name)
        if value is not None:
            words += [f"--{name}", str(value)]
    return words + [f"--{name.replace('_', '-')}" for name in SWITCHES if getattr(options, name)]


def refuse_taken(address: Address) -> None:
    """Raise UserError when no server can listen at the address."""
    try:
        found = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_STREAM)
        family, kind, protocol, _, place = found[0]
        with closing(socket.socket(family, kind, protocol)) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(place)
    except OSError as error:
        raise UserError(
            f"--web {address.host}:{address.port}: {error.strerror}; choose another port"
        ) from error
