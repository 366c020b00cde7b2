"""Run textual-serve behind the access check."""

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import Any, Final

from aiohttp import web
from textual_serve.server import Server

from ground.web.access import WebAccess
from ground.web.address import Address

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
