"""`bridge`: what a recording would hold, live, for Foxglove or Lichtblick to connect to."""

import argparse
from collections import deque
from collections.abc import Iterable
from time import time_ns
from typing import Any, Final, NamedTuple

from ground.cli.options import common_of
from ground.client.link import Link
from ground.grammar.words import add_common
from ground.recording.log_writer import MAX_KEY
from ground.recording.mcap.channels import ChannelMessage, ChannelSplitter
from ground.recording.metadata import MetadataReader
from ground.recording.tlog import is_whole_frame
from ground.text.output import Output
from runtime.clock import Clock
from runtime.errors import UserError

USUAL_PLACE: Final = "127.0.0.1:8765"
ROUND_NS: Final = 50_000_000
AGAIN_NS: Final = 2_000_000_000
HEAD_START_NS: Final = 1_000_000_000
"""A viewer that waits to connect again is to find the channels there: the SDK (0.30.3) can lose
what a viewer asks for in the moment in which its channel is made."""
MOST_WAITING: Final = 4096
ONCE: Final = ("/world", "/robot/body", "/goal")
"""Told seldom, and so again and again: whoever connects later is to see it, too."""


class Place(NamedTuple):
    host: str
    port: int


def arguments(parser: argparse.ArgumentParser) -> None:
    says = f"where viewers connect; port 0: any that is free ({USUAL_PLACE})"
    parser.add_argument("--at", type=place, default=place(USUAL_PLACE), metavar="H:P", help=says)
    add_common(parser)


def place(text: str) -> Place:
    host, colon, port = text.strip().rpartition(":")
    if not (colon and host and port.isdecimal() and int(port) < 65_536):
        raise argparse.ArgumentTypeError(f"{text!r} is no HOST:PORT, as in {USUAL_PLACE}")
    return Place(host, int(port))


def act(options: argparse.Namespace, link: Link, says: Output) -> int:
    """Until a signal ends it. It only looks: nothing that a viewer does reaches the robot."""
    bridge = Bridge(link, common_of(options).network.prefix)
    go_round(bridge, link.clock, HEAD_START_NS)
    server = served(options.at, link.robot)
    try:
        says.note(f"{link.robot} at ws://{options.at.host}:{server.port}; no password guards it")
        while True:
            go_round(bridge, link.clock, ROUND_NS)
    finally:
        server.stop()


def go_round(bridge: "Bridge", clock: Clock, for_ns: int) -> None:
    """For at least this time, at the bridge's pace."""
    over_ns = clock.now_ns() + for_ns
    while clock.now_ns() < over_ns:
        due_ns = clock.now_ns() + ROUND_NS
        bridge.round(clock.now_ns())
        clock.sleep_until(due_ns)


def served(at: Place, robot: str) -> Any:
    """The SDK's own server; UserError when it is not installed or cannot listen there."""
    foxglove = sdk()
    try:
        return foxglove.start_server(
            name=f"sidestep {robot}", host=at.host, port=at.port, message_backlog_size=1024
        )
    except (RuntimeError, OSError) as error:
        raise UserError(f"cannot listen at {at.host}:{at.port}: {error}") from error


def sdk() -> Any:
    try:
        import foxglove  # an extra of its own: nothing else needs it
    except ImportError:
        fix = "pip install 'sidestep[foxglove]'; an .mcap needs nothing to be opened"
        raise UserError(f"the bridge needs foxglove-sdk, which is not installed: {fix}") from None
    return foxglove


class Bridge:
    """Takes frames from the bus's threads and tells them to whoever is connected, from one."""

    def __init__(self, link: Link, prefix: str) -> None:
        self._link = link
        self._offset_ns = time_ns() - link.clock.now_ns()
        self._splitter = ChannelSplitter(link.robot)
        self._facts = MetadataReader(link.bus, link.robot)
        self._arrived: deque[tuple[str, bytes, int]] = deque(maxlen=MOST_WAITING)
        self._channels: dict[str, Any] = {}
        self._once: dict[str, ChannelMessage] = {}
        self._again_ns = 0
        link.bus.stream(f"{prefix}/{link.robot}/**", self._take)

    def _take(self, key: str, frame: bytes, arrived_ns: int) -> None:
        if len(key) <= MAX_KEY:
            self._arrived.append((key, frame, arrived_ns))

    def round(self, now_ns: int) -> None:
        """Everything that has come; and what is told seldom, when it is time to."""
        for name, text in self._facts.poll(now_ns).items():
            self._tell(self._splitter.draw_fact(name, text, now_ns + self._offset_ns), now_ns)
        for _ in range(len(self._arrived)):
            key, frame, arrived_ns = self._arrived.popleft()
            if is_whole_frame(frame):
                time_ns = arrived_ns + self._offset_ns
                self._tell(self._splitter.add(key, frame, time_ns), arrived_ns)
        if now_ns >= self._again_ns:
            self._again_ns = now_ns + AGAIN_NS
            self._tell(list(self._once.values()), now_ns)

    @property
    def topics(self) -> frozenset[str]:
        """What a viewer that connects now can choose from."""
        return frozenset(self._channels)

    def _tell(self, pieces: Iterable[ChannelMessage], at_ns: int) -> None:
        for piece in pieces:
            if piece.topic in ONCE:
                self._once[piece.topic] = piece
            channel = self._channels.get(piece.topic)
            if channel is None:
                channel = self._channels[piece.topic] = channel_of(piece)
            channel.log(piece.data, log_time=at_ns + self._offset_ns)


def channel_of(piece: ChannelMessage) -> Any:
    foxglove = sdk()
    if piece.schema is None:
        schema = foxglove.Schema(name="", encoding="", data=b"")
    else:
        schema = foxglove.Schema(
            name=piece.schema.name, encoding="jsonschema", data=piece.schema.text
        )
    return foxglove.Channel(piece.topic, schema=schema, message_encoding=piece.encoding)
