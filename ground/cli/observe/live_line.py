"""The live state of a robot in one line, with or without an operator's heartbeat."""

import asyncio
import sys
from collections import deque
from contextlib import suppress
from typing import Final

from ground.client.connection import Common
from ground.client.leases import READY_S, TICK_NS, Leasing
from ground.client.requests import HeartbeatTimer
from ground.client.robot_link import LISTEN_NS, RobotLink, open_link
from ground.client.status_line import watch_line
from ground.client.telemetry import SUMMARY_TOPICS, Telemetry
from ground.robot import Robot
from ground.text.output import Output, SpokenLines
from ground.text.wording import aged
from protocol.topics import HEARTBEAT, STATUS, TEXT
from protocol.wire.codec import decode
from protocol.wire.statustext import StatustextAssembler
from runtime.errors import RemoteError

SILENT_NS: Final = 2_000_000_000
SHOW_NS: Final = 200_000_000
SHOW_PLAIN_NS: Final = 1_000_000_000
MAX_WAITING: Final = 1000
"""Limit of text frames kept while the terminal blocks; the oldest are dropped."""


def follow(common: Common) -> int:
    """Show the state until a signal ends the process; the lines go to standard output."""
    with open_link(common) as link:
        show_status(link, Output(as_json=False, err=sys.stdout), beats=False)
    return 0


def show_status(link: RobotLink, output: Output, *, beats: bool, spoken: bool = False) -> None:
    """Show the state until a signal ends the process; with `beats` it is also the operator.

    `spoken` prints lines for a screen reader.

    The signal raises: it has to end a write to a terminal that blocks, too.
    """
    robot = Robot(link.bus, link.common, clock=link.clock, leasing=Leasing.NEVER)
    asyncio.run(LiveStatus(robot, output, spoken=spoken).run(beats=beats))


class LiveStatus:
    """The state of a robot and its texts, as lines."""

    def __init__(self, robot: Robot, output: Output, *, spoken: bool = False) -> None:
        self._robot = robot
        self._output = output
        self._spoken = SpokenLines(output, robot.clock) if spoken else None
        self._texts = StatustextAssembler()
        self._frames: deque[tuple[bytes, int]] = deque(maxlen=MAX_WAITING)
        self._pace = HeartbeatTimer()
        self._silent = False
        self._began_ns = robot.clock.now_ns()
        robot.bus.stream(TEXT, lambda _key, *frame: self._frames.append(frame), robot.name)

    async def run(self, *, beats: bool) -> None:
        """Show them forever; with `beats` send the operator's heartbeat."""
        robot, every_ns = self._robot, SHOW_NS if self._output.live else SHOW_PLAIN_NS
        shown_ns = 0
        with robot.subscribed(*SUMMARY_TOPICS) as telemetry:
            if beats:
                await self._begin_heartbeat()
            await robot.wait(lambda: telemetry.latest(STATUS) is not None, LISTEN_NS)
            while True:
                now_ns = robot.clock.now_ns()
                self._print_texts()
                newest = telemetry.latest(STATUS)
                if beats and self._pace.due(now_ns, 0 if newest is None else newest[0].time_ns):
                    robot.lease.beat()
                if now_ns - shown_ns >= every_ns:
                    shown_ns = now_ns
                    parts = watch_line(telemetry, now_ns)
                    if self._spoken is None:
                        self._output.line(parts)
                    else:
                        self._spoken.show(parts)
                await self._explain_silence(telemetry, now_ns)
                await robot.sleep_until(now_ns + TICK_NS)

    async def _begin_heartbeat(self) -> None:
        robot = self._robot
        heartbeat = robot.lease.declare_heartbeat()
        await robot.in_own_thread(lambda: robot.bus.await_matched([heartbeat], timeout_s=READY_S))
        robot.lease.beat()

    async def _explain_silence(self, telemetry: Telemetry, now_ns: int) -> None:
        """Print the diagnosis once for each silence, also of a robot without simulated time."""
        newest = [telemetry.latest(topic) for topic in (HEARTBEAT, STATUS)]
        heard_ns = min(self._began_ns if one is None else one[1] for one in newest)
        silent = now_ns - heard_ns > SILENT_NS
        if silent and not self._silent:
            self._output.note(await self._robot.diagnosis())
        self._silent = silent

    def _print_texts(self) -> None:
        while self._frames:
            with suppress(RemoteError):
                frame, sent_ns = self._frames.popleft()
                text = self._texts.receive(decode(frame).message)
                if text:
                    words = aged(text, self._robot.clock.now_ns() - sent_ns)
                    self._output.note(f"{self._robot.name}: {words}")
