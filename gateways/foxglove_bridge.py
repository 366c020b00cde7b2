"""`bridge`: a live Foxglove server with the channels that a recording would hold.

Its door admits viewers, and no web page of another site. A browser lets every page open a web
socket to this computer, and says in `Origin` which page it is. The server of the Foxglove SDK does
not look at that. So it listens at an address of 127.0.0.0/8 that no page can guess (24 random bits,
and the port), and the door passes on what it admits.
"""

import argparse
import asyncio
import threading
from collections import deque
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from ipaddress import ip_address
from secrets import randbelow
from time import time_ns
from typing import Any, Final, NamedTuple
from urllib.parse import urlsplit

from ground.cli.options import common_of
from ground.client.robot_link import RobotLink, open_link
from ground.commands.command import add_common
from ground.recording.log_reader import is_whole_frame
from ground.recording.log_writer import MAX_KEY
from ground.recording.mcap_file import ChannelMessage, ChannelSplitter
from ground.recording.metadata import MetadataReader
from ground.text.output import Output
from runtime.clock import Clock
from runtime.errors import UserError

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


DEFAULT_PLACE: Final = "127.0.0.1:8765"
ROUND_NS: Final = 50_000_000
REPEAT_NS: Final = 2_000_000_000
HEAD_START_NS: Final = 1_000_000_000
"""Time to create channels before the server starts.

The SDK (0.30.3) can lose a viewer's subscription to a channel that is created at the same moment.
"""
MAX_WAITING: Final = 4096
RARE_CHANNELS: Final = ("/world", "/robot/body", "/goal")
"""Rare channels, repeated for viewers that connect later."""


class ListenAddress(NamedTuple):
    """The address that a server listens on."""

    host: str
    port: int


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `bridge`."""
    text = f"address for viewers; port 0 selects a free port (default {DEFAULT_PLACE})"
    parser.add_argument("--at", type=place, default=place(DEFAULT_PLACE), metavar="H:P", help=text)
    text = "admit web pages of this origin, too, such as https://viewer.example; may be repeated"
    parser.add_argument("--origin", action="append", default=[], metavar="URL", help=text)
    add_common(parser)


def place(text: str) -> ListenAddress:
    """Parse HOST:PORT; ArgumentTypeError for anything else."""
    host, colon, port = text.strip().rpartition(":")
    if not (colon and host and port.isdecimal() and int(port) < 65_536):
        raise argparse.ArgumentTypeError(f"{text!r} is not HOST:PORT, as in {DEFAULT_PLACE}")
    return ListenAddress(host, int(port))


def run(options: argparse.Namespace, output: Output) -> int:
    """Serve until a signal ends the process. No viewer can send anything to the robot."""
    with open_link(common_of(options, output)) as link:
        return serve(options, link, output)


def serve(options: argparse.Namespace, link: RobotLink, output: Output) -> int:
    """Serve over a link until a signal ends the process."""
    bridge = Bridge(link)
    run_for(bridge, link.clock, HEAD_START_NS)
    server = served(options.at, link.name, options.origin)
    try:
        output.note(f"{link.name} at ws://{options.at.host}:{server.port}, without a password")
        while True:
            run_for(bridge, link.clock, ROUND_NS)
    finally:
        server.stop()


def run_for(bridge: "Bridge", clock: Clock, for_ns: int) -> None:
    """Run the bridge at its own rate for at least this time."""
    over_ns = clock.now_ns() + for_ns
    while clock.now_ns() < over_ns:
        due_ns = clock.now_ns() + ROUND_NS
        bridge.round(clock.now_ns())
        clock.sleep_until(due_ns)


def served(at: ListenAddress, robot: str, origins: Sequence[str] = ()) -> ViewerDoor:
    """Start the SDK's server behind a door; UserError if it is not installed or cannot listen."""
    foxglove, hidden = sdk(), hidden_address()
    inner = foxglove.start_server(
        name=f"sidestep {robot}", host=hidden, port=0, message_backlog_size=1024
    )
    try:
        return ViewerDoor(at.host, at.port, inner, hidden, origins)
    except (RuntimeError, OSError) as error:
        inner.stop()
        why = getattr(error, "strerror", None) or error
        raise UserError(f"cannot listen at {at.host}:{at.port}: {why}") from error


def sdk() -> Any:
    """Import the Foxglove SDK; UserError if it is not installed."""
    try:
        import foxglove  # an optional dependency
    except ImportError:
        fix = "pip install 'sidestep[foxglove]'"
        raise UserError(f"the bridge needs foxglove-sdk, which is not installed: {fix}") from None
    return foxglove


class Bridge:
    """Collects frames from the bus's threads and logs them to the server from one thread."""

    def __init__(self, link: RobotLink) -> None:
        self._link = link
        self._offset_ns = time_ns() - link.clock.now_ns()
        self._splitter = ChannelSplitter(link.name)
        self._metadata = MetadataReader(link.bus, link.name)
        self._arrived: deque[tuple[str, bytes, int]] = deque(maxlen=MAX_WAITING)
        self._channels: dict[str, Any] = {}
        self._rare: dict[str, ChannelMessage] = {}
        self._repeat_ns = 0
        link.bus.stream_all(self._take, link.name)

    def _take(self, key: str, frame: bytes, arrived_ns: int) -> None:
        if len(key) <= MAX_KEY:
            self._arrived.append((key, frame, arrived_ns))

    def round(self, now_ns: int) -> None:
        """Log all frames that have arrived; repeat rare channels when they are due."""
        for name, text in self._metadata.poll(now_ns).items():
            self._log(self._splitter.draw_fact(name, text, now_ns + self._offset_ns), now_ns)
        for _ in range(len(self._arrived)):
            key, frame, arrived_ns = self._arrived.popleft()
            if is_whole_frame(frame):
                time_ns = arrived_ns + self._offset_ns
                self._log(self._splitter.add(key, frame, time_ns), arrived_ns)
        if now_ns >= self._repeat_ns:
            self._repeat_ns = now_ns + REPEAT_NS
            self._log(list(self._rare.values()), now_ns)

    @property
    def topics(self) -> frozenset[str]:
        """The channels that a viewer can choose from."""
        return frozenset(self._channels)

    def _log(self, messages: Iterable[ChannelMessage], at_ns: int) -> None:
        for message in messages:
            if message.topic in RARE_CHANNELS:
                self._rare[message.topic] = message
            channel = self._channels.get(message.topic)
            if channel is None:
                channel = self._channels[message.topic] = channel_of(message)
            channel.log(message.data, log_time=at_ns + self._offset_ns)


def channel_of(message: ChannelMessage) -> Any:
    """Create the Foxglove channel for a message."""
    foxglove = sdk()
    if message.schema is None:
        schema = foxglove.Schema(name="", encoding="", data=b"")
    else:
        schema = foxglove.Schema(
            name=message.schema.name, encoding="jsonschema", data=message.schema.text
        )
    return foxglove.Channel(message.topic, schema=schema, message_encoding=message.encoding)
