"""Who may come in: textual-serve asks nobody who they are, so this does, before it hears of them.

The token comes once in the address, and is exchanged for a cookie with a random session id: neither
the address bar, a referrer nor another service on this host, to which a browser sends the cookie,
learns the token. A web socket is opened only from a page that we have served.
"""

from collections import deque
from hmac import compare_digest
from secrets import token_urlsafe
from typing import Final
from urllib.parse import urlsplit

from aiohttp import web
from aiohttp.typedefs import Handler, Middleware

REFUSAL: Final = (
    "This ground station wants its token: open the address that `sidestep ground --web` printed.\n"
)
FOREIGN: Final = "A page of another site may not drive this robot.\n"
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
"""Browsers that are let in without the token; the oldest session ends for a new one."""


class WebAccess:
    """Lets in who has the token. `cookie` has the port in its name: cookies do not know ports."""

    def __init__(self, token: str, port: int) -> None:
        self._token = token
        self.sessions: deque[str] = deque(maxlen=MAX_SESSIONS)
        self.cookie = f"sidestep_{port}"

    def knows(self, token: str | None) -> bool:
        """Return whether it is the token."""
        return token is not None and same(token, self._token)

    def has_let_in(self, session: str | None) -> bool:
        """Return whether it is the session id of a browser that has shown the token."""
        return session is not None and any(same(session, one) for one in self.sessions)

    def middleware(self) -> Middleware:
        @web.middleware
        async def ask(request: web.Request, handler: Handler) -> web.StreamResponse:
            if self.knows(request.query.get("token")):
                return self._admit(request)
            if not self.has_let_in(request.cookies.get(self.cookie)):
                return web.Response(status=403, text=REFUSAL, headers=HEADERS)
            if not from_here(request.headers.get("Origin"), request.host):
                return web.Response(status=403, text=FOREIGN, headers=HEADERS)
            answer = await handler(request)
            if not answer.prepared:
                answer.headers.update(HEADERS)
            return answer

        return ask

    def _admit(self, request: web.Request) -> web.StreamResponse:
        """Once more without the token in the address."""
        answer = web.Response(status=303, headers={"Location": request.path, **HEADERS})
        self.sessions.append(token_urlsafe(SESSION_BYTES))
        session = self.sessions[-1]
        answer.set_cookie(self.cookie, session, httponly=True, samesite="Strict", path="/")
        return answer


def same(given: str, secret: str) -> bool:
    """Compare in constant time.

    What came in may hold bytes that are no text, as halves of surrogate pairs.
    """
    return compare_digest(given.encode(errors="surrogatepass"), secret.encode())


def from_here(origin: str | None, host: str) -> bool:
    """Whether a request comes from a page of this host; without an origin it is no page's."""
    try:
        return origin is None or urlsplit(origin).netloc == host
    except ValueError:  # an origin that is no address
        return False
