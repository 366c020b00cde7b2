"""Check the token of each request before textual-serve, which has no authentication, handles it.

The browser sends the token once, in the address, and gets a cookie with a random session id. So the
address bar, a referrer and other services on this host, to which browsers send the cookie, never
see the token. A web socket is opened only from a page of this server.
"""

from collections import deque
from hmac import compare_digest
from secrets import token_urlsafe
from typing import Final
from urllib.parse import urlsplit

from aiohttp import web
from aiohttp.typedefs import Handler, Middleware

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
