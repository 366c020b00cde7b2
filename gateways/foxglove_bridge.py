"""`bridge`: a live Foxglove server with the channels that a recording would hold."""

import argparse
from collections import deque
from collections.abc import Iterable, Sequence
from time import time_ns
from typing import Any, Final, NamedTuple

from gateways.foxglove_door import ViewerDoor, hidden_address
from ground.client.link import Link
from ground.grammar.words import add_common
from ground.recording.log_writer import MAX_KEY
from ground.recording.mcap.channels import ChannelMessage, ChannelSplitter
from ground.recording.metadata import MetadataReader
from ground.recording.tlog import is_whole_frame
from ground.text.output import Output
from runtime.clock import Clock
from runtime.errors import UserError

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


class Place(NamedTuple):
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


def place(text: str) -> Place:
    """Parse HOST:PORT; ArgumentTypeError for anything else."""
    host, colon, port = text.strip().rpartition(":")
    if not (colon and host and port.isdecimal() and int(port) < 65_536):
        raise argparse.ArgumentTypeError(f"{text!r} is not HOST:PORT, as in {DEFAULT_PLACE}")
    return Place(host, int(port))


def act(options: argparse.Namespace, link: Link, output: Output) -> int:
    """Serve until a signal ends the process. No viewer can send anything to the robot."""
    bridge = Bridge(link)
    run_for(bridge, link.clock, HEAD_START_NS)
    server = served(options.at, link.robot, options.origin)
    try:
        output.note(f"{link.robot} at ws://{options.at.host}:{server.port}, without a password")
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


def served(at: Place, robot: str, origins: Sequence[str] = ()) -> ViewerDoor:
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

    def __init__(self, link: Link) -> None:
        self._link = link
        self._offset_ns = time_ns() - link.clock.now_ns()
        self._splitter = ChannelSplitter(link.robot)
        self._metadata = MetadataReader(link.bus, link.robot)
        self._arrived: deque[tuple[str, bytes, int]] = deque(maxlen=MAX_WAITING)
        self._channels: dict[str, Any] = {}
        self._rare: dict[str, ChannelMessage] = {}
        self._repeat_ns = 0
        link.bus.stream_all(self._take, link.robot)

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
