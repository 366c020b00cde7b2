"""The live state of a robot in one line, with or without an operator's heartbeat."""

import sys
from collections import deque
from contextlib import suppress
from typing import Final

from ground.client.connection import Common
from ground.client.link import LISTEN_NS, Link, open_link
from ground.client.requests import BEAT_NS, HeartbeatTimer
from ground.client.status_line import watch_line
from ground.client.telemetry import Telemetry
from ground.text.output import Output
from ground.text.wording import StatustextAssembler, aged
from protocol.topics import HEARTBEAT, STATUS, TEXT
from protocol.wire.codec import decode
from runtime.errors import RemoteError

SILENT_NS: Final = 2_000_000_000
SHOW_NS: Final = 200_000_000
SHOW_PLAIN_NS: Final = 1_000_000_000
MAX_WAITING: Final = 1000
"""Limit of text frames kept while the terminal blocks; the oldest are dropped."""


def follow(common: Common) -> int:
    """Show the state until a signal ends the process; the lines go to standard output."""
    with open_link(common) as link:
        LiveStatus(link, Output(as_json=False, err=sys.stdout), beats=False).run()
    return 0


class LiveStatus:
    """Shows the state until a signal ends the process; with `beats` it is also the operator."""

    def __init__(self, link: Link, output: Output, *, beats: bool) -> None:
        self._link = link
        self._output = output
        self._beats = beats
        self._telemetry = Telemetry(link.bus, link.robot, notify=link.pulse.beat)
        self._texts = StatustextAssembler()
        self._frames: deque[tuple[bytes, int]] = deque(maxlen=MAX_WAITING)
        self._pace = HeartbeatTimer()
        self._silent = False
        self._began_ns = link.clock.now_ns()
        link.bus.stream(TEXT, lambda _key, *frame: self._frames.append(frame), link.robot)

    def run(self) -> None:
        """Show the state and the robot's texts forever."""
        every_ns = SHOW_NS if self._output.live else SHOW_PLAIN_NS
        shown_ns = 0
        if self._beats:
            self._link.beat()
        self._link.wait(lambda: self._telemetry.latest(STATUS) is not None, LISTEN_NS)
        while True:
            now_ns = self._link.clock.now_ns()
            self._print_texts()
            if self._beats and self._pace.due(now_ns, self._stamp_ns()):
                self._link.beat()
            if now_ns - shown_ns >= every_ns:
                shown_ns = now_ns
                self._output.line(watch_line(self._telemetry, now_ns))
            self._explain_silence(now_ns)
            self._link.pulse.wait_until(now_ns + BEAT_NS // 2)

    def _explain_silence(self, now_ns: int) -> None:
        """Print the diagnosis once for each silence."""
        newest = self._telemetry.latest(HEARTBEAT)
        silent = now_ns - (self._began_ns if newest is None else newest[1]) > SILENT_NS
        if silent and not self._silent:
            self._output.note(self._link.diagnosis())
        self._silent = silent

    def _stamp_ns(self) -> int:
        newest = self._telemetry.latest(STATUS)
        return 0 if newest is None else newest[0].time_ns

    def _print_texts(self) -> None:
        while self._frames:
            with suppress(RemoteError):
                frame, sent_ns = self._frames.popleft()
                text = self._texts.receive(decode(frame).message)
                if text:
                    words = aged(text, self._link.clock.now_ns() - sent_ns)
                    self._output.note(f"{self._link.robot}: {words}")
