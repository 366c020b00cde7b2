"""textual-serve with a door in front; its address is that of the request, its words are ours."""

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import Any, Final

from aiohttp import web
from textual_serve.server import Server

from ground.web.access import WebAccess
from ground.web.address import Address

MOST_SESSIONS: Final = 8
FULL: Final = f"{MOST_SESSIONS} browsers have this ground station open, more are not served.\n"


class WebServer(Server):
    """Serves the app that `command` starts, one process for each browser that has come in.

    `ready` is called when it listens.
    """

    def __init__(
        self, command: str, address: Address, token: str, ready: Callable[[], None]
    ) -> None:
        super().__init__(command, host=address.host, port=address.port, title="Sidestep")
        self.door = WebAccess(token, address.port)
        self.sessions: set[asyncio.Task[object]] = set()
        self._ready = ready

    def initialize_logging(self) -> None:
        """Nothing but the app writes: what aiohttp has to say about requests is for nobody."""
        logging.getLogger("textual-serve").setLevel(logging.CRITICAL)
        logging.getLogger("aiohttp").setLevel(logging.CRITICAL)

    async def _make_app(self) -> web.Application:
        app = await super()._make_app()
        app.middlewares.append(self.door.middleware())
        return app

    async def on_startup(self, app: web.Application) -> None:
        self._ready()

    async def handle_index(self, request: web.Request) -> Any:
        """With addresses of the place where the browser found us, whatever maps it there."""
        self.public_url = f"{request.scheme}://{request.host}"
        page: Callable[[web.Request], Awaitable[web.StreamResponse]] = super().handle_index
        return await page(request)

    async def handle_websocket(self, request: web.Request) -> Any:
        task = asyncio.current_task()
        if task is None or len(self.sessions) >= MOST_SESSIONS:
            return web.Response(status=503, text=FULL)
        self.sessions.add(task)
        try:
            return await super().handle_websocket(request)
        finally:
            self.sessions.discard(task)

    async def on_shutdown(self, app: web.Application) -> None:
        """End the apps: left to themselves, open browsers would hold up the end for a minute."""
        for session in self.sessions:
            session.cancel()
        await asyncio.gather(*self.sessions, return_exceptions=True)
