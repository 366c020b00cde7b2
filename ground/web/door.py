"""Who may come in: textual-serve asks nobody who they are, so this does, before it hears of them.

The token comes once in the address and then in a cookie, so that neither the address bar nor a
referrer keeps it. A web socket is opened only from a page that we have served.
"""

from hmac import compare_digest
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


class Door:
    """Lets in who has the token. `cookie` has the port in its name: cookies do not know ports."""

    def __init__(self, token: str, port: int) -> None:
        self._token = token
        self.cookie = f"sidestep_{port}"

    def knows(self, token: str | None) -> bool:
        """In a time that says nothing about how much of it was right."""
        return token is not None and compare_digest(token.encode(), self._token.encode())

    def middleware(self) -> Middleware:
        @web.middleware
        async def ask(request: web.Request, handler: Handler) -> web.StreamResponse:
            if self.knows(request.query.get("token")):
                return self._admit(request)
            if not self.knows(request.cookies.get(self.cookie)):
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
        answer.set_cookie(self.cookie, self._token, httponly=True, samesite="Lax", path="/")
        return answer


def from_here(origin: str | None, host: str) -> bool:
    """Whether a request comes from a page of this host; without an origin it is no page's."""
    try:
        return origin is None or urlsplit(origin).netloc == host
    except ValueError:  # an origin that is no address
        return False
