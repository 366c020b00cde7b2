"""The state of a robot in one live line, with an operator's heartbeat or without."""

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
from ground.text.statustext import StatustextAssembler, aged
from protocol.topics import HEARTBEAT, STATUS, TEXT
from protocol.wire.codec import decode
from runtime.errors import RemoteError

SILENT_NS: Final = 2_000_000_000
SHOW_NS: Final = 200_000_000
SHOW_PLAIN_NS: Final = 1_000_000_000
MAX_WAITING: Final = 1000
"""Frames of texts kept while the terminal takes no more; the oldest give way."""


def follow(common: Common) -> int:
    """Show it until a signal ends it. The lines are the result: they go to standard output."""
    with open_link(common) as link:
        LiveStatus(link, Output(as_json=False, err=sys.stdout), beats=False).run()
    return 0


class LiveStatus:
    """Shows the state until a signal ends it; with `beats` it is also the operator."""

    def __init__(self, link: Link, says: Output, *, beats: bool) -> None:
        self._link = link
        self._says = says
        self._beats = beats
        self._telemetry = Telemetry(link.bus, link.robot, notify=link.pulse.beat)
        self._texts = StatustextAssembler()
        self._frames: deque[tuple[bytes, int]] = deque(maxlen=MAX_WAITING)
        self._pace = HeartbeatTimer()
        self._silent = False
        self._began_ns = link.clock.now_ns()
        link.bus.stream(TEXT, lambda _key, *told: self._frames.append(told), link.robot)

    def run(self) -> None:
        every_ns = SHOW_NS if self._says.live else SHOW_PLAIN_NS
        shown_ns = 0
        if self._beats:
            self._link.beat()
        self._link.wait(lambda: self._telemetry.latest(STATUS) is not None, LISTEN_NS)
        while True:
            now_ns = self._link.clock.now_ns()
            self._tell_texts()
            if self._beats and self._pace.due(now_ns, self._stamp_ns()):
                self._link.beat()
            if now_ns - shown_ns >= every_ns:
                shown_ns = now_ns
                self._says.line(watch_line(self._telemetry, now_ns))
            self._explain_silence(now_ns)
            self._link.pulse.wait_until(now_ns + BEAT_NS // 2)

    def _explain_silence(self, now_ns: int) -> None:
        """Once for each silence: is nobody there, or does somebody hang?"""
        heard = self._telemetry.latest(HEARTBEAT)
        silent = now_ns - (self._began_ns if heard is None else heard[1]) > SILENT_NS
        if silent and not self._silent:
            self._says.note(self._link.diagnosis())
        self._silent = silent

    def _stamp_ns(self) -> int:
        newest = self._telemetry.latest(STATUS)
        return 0 if newest is None else newest[0].time_ns

    def _tell_texts(self) -> None:
        while self._frames:
            with suppress(RemoteError):
                frame, told_ns = self._frames.popleft()
                text = self._texts.receive(decode(frame).message)
                if text:
                    words = aged(text, self._link.clock.now_ns() - told_ns)
                    self._says.note(f"{self._link.robot}: {words}")
