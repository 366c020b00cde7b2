"""A web server for the ground station in browsers: textual-serve behind a check of each request.

textual-serve has no authentication, so the token of each request is checked before. The browser
sends the token once, in the address, and gets a cookie with a random session id. So the address
bar, a referrer and other services on this host, to which browsers send the cookie, never see the
token. A web socket is opened only from a page of this server.

This module needs the extra `web`.
"""

import asyncio
import logging
import re
from collections import deque
from collections.abc import Awaitable, Callable
from hmac import compare_digest
from secrets import token_urlsafe
from typing import Any, Final
from urllib.parse import urlsplit

from aiohttp import web
from aiohttp.typedefs import Handler, Middleware
from textual_serve.server import Server

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


MAX_BROWSERS: Final = 8
FULL: Final = (
    f"{MAX_BROWSERS} browsers, the maximum, have this ground station open:"
    " close one of them and reload this page.\n"
)


HEAD: Final = "<head><title>Sidestep</title>"
OTHERS: Final = re.compile(r"<link[^>]*?//fonts\.[^>]*?>|<svg.*?</svg>", re.DOTALL)
"""What the page of textual-serve has beside its own files: a font of another site, a logo."""


class WebServer(Server):
    """Serves the app that `command` starts, in one process for each admitted browser.

    `ready` is called when the server listens.
    """

    def __init__(
        self, command: str, host: str, port: int, token: str, ready: Callable[[], None]
    ) -> None:
        super().__init__(command, host=host, port=port, title="Sidestep")
        self.access = WebAccess(token, port)
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
        answer = await page(request)
        if isinstance(answer, web.Response) and answer.text is not None:
            answer.text = OTHERS.sub("", answer.text).replace("<head>", HEAD, 1)
        return answer

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
