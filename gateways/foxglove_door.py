"""The door of the bridge: it admits viewers, and no web page of another site.

A browser lets every page open a web socket to this computer, and says in `Origin` which page it is.
The server of the Foxglove SDK does not look at that. So it listens at an address of 127.0.0.0/8
that no page can guess (24 random bits, and the port), and this door passes on what it admits.
"""

import asyncio
import threading
from collections.abc import Collection
from contextlib import suppress
from ipaddress import ip_address
from secrets import randbelow
from typing import Any, Final
from urllib.parse import urlsplit

FOXGLOVE: Final = ("https://app.foxglove.dev", "https://studio.foxglove.dev")
DESKTOP: Final = "file://"
"""The origin of the desktop apps of Foxglove and Lichtblick, if they send one."""
MAX_HEAD: Final = 8192
HEAD_S: Final = 5.0
MAX_VIEWERS: Final = 32
BLOCK: Final = 1 << 16
REFUSED: Final = (
    "Refused: this request comes from a web page that may not see the robot."
    " To admit it: sidestep run bridge --origin {origin}\n"
)
ONLY_VIEWERS: Final = "This is a bridge for Foxglove and Lichtblick: open it there.\n"


def hidden_address() -> str:
    """Return an address of this computer that is hard to guess."""
    return f"127.{1 + randbelow(254)}.{randbelow(256)}.{1 + randbelow(254)}"


def is_admitted(origin: str, others: Collection[str] = ()) -> bool:
    """Return whether a page of this origin may see the robot: Foxglove, this computer, or others.

    The origin `null` is that of a page in a sandbox, which may be of any site.
    """
    if origin in {DESKTOP, *FOXGLOVE, *others}:
        return True
    try:
        place = urlsplit(origin)
        host = place.hostname or ""
        is_origin = place.scheme in {"http", "https"} and "@" not in origin
        is_origin &= origin == f"{place.scheme}://{place.netloc}"
        return is_origin and (host == "localhost" or ip_address(host).is_loopback)
    except ValueError:
        return False


def refusal_of(head: bytes, others: Collection[str]) -> tuple[str, str] | None:
    """Return status and text for a request that is not admitted; None for a viewer."""
    lines = [line.partition(":") for line in head.decode("latin-1").split("\r\n")[1:]]
    values: dict[str, list[str]] = {}
    for name, _, value in lines:
        values.setdefault(name.lower(), []).append(value.strip())
    origins = values.get("origin", [])
    if len(origins) > 1 or not all(is_admitted(origin, others) for origin in origins):
        shown = "".join(filter(str.isprintable, origins[0]))
        return "403 Forbidden", REFUSED.format(origin=shown)
    if [value.lower() for value in values.get("upgrade", [])] != ["websocket"]:
        return "426 Upgrade Required", ONLY_VIEWERS
    return None


class ViewerDoor:
    """Listens at an address for viewers of the server `inner`, in a thread of its own.

    Raises OSError if it cannot listen there.
    """

    def __init__(self, host: str, port: int, inner: Any, at: str, origins: Collection[str]) -> None:
        """`inner` is the SDK's server, at the address `at`; `origins` are admitted besides."""
        self._inner, self._at, self._origins = inner, at, origins
        self._viewers: set[asyncio.Task[None]] = set()
        self._loop = asyncio.new_event_loop()
        try:
            listening = asyncio.start_server(self._admit, host, port, limit=MAX_HEAD)
            self._server = self._loop.run_until_complete(listening)
        except OSError:
            self._loop.close()
            raise
        self.port: int = self._server.sockets[0].getsockname()[1]
        self._thread = threading.Thread(target=self._loop.run_forever, name="door", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End all connections and both servers."""
        asyncio.run_coroutine_threadsafe(self._close(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
        self._inner.stop()

    async def _close(self) -> None:
        self._server.close()
        for viewer in self._viewers:
            viewer.cancel()
        await asyncio.gather(*self._viewers, return_exceptions=True)

    async def _admit(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None, "a connection has a task"
        self._viewers.add(task)
        try:
            if len(self._viewers) <= MAX_VIEWERS:
                await self._serve(reader, writer)
        except (OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, TimeoutError):
            pass  # the viewer has gone, or is none
        finally:
            self._viewers.discard(task)
            writer.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), HEAD_S)
        refused = refusal_of(head, self._origins)
        if refused is not None:
            writer.write(answer(*refused))
            await writer.drain()
            return
        inner_reader, inner_writer = await asyncio.open_connection(self._at, self._inner.port)
        inner_writer.write(head)
        ways = {
            asyncio.ensure_future(pass_on(reader, inner_writer)),
            asyncio.ensure_future(pass_on(inner_reader, writer)),
        }
        try:
            await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for way in ways:
                way.cancel()
            await asyncio.gather(*ways, return_exceptions=True)
            inner_writer.close()


async def pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Pass on all bytes until one side ends."""
    with suppress(OSError):
        while data := await reader.read(BLOCK):
            writer.write(data)
            await writer.drain()


def answer(status: str, text: str) -> bytes:
    """Return the bytes of a refusal."""
    content = text.encode()
    head = (
        f"HTTP/1.1 {status}",
        "Content-Type: text/plain; charset=utf-8",
        f"Content-Length: {len(content)}",
        "Connection: close",
    )
    return "\r\n".join((*head, "", "")).encode() + content
