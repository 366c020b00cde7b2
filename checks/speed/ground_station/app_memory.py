"""Memory of the app over a long run, and its key latency while 100 000 log lines arrive.

The run is minutes of telemetry at 50 Hz on simulated time.
"""

import argparse
import asyncio
import os
from collections.abc import Callable, Iterator
from math import cos, pi, sin
from threading import Event, Thread
from typing import Any, Final

from textual.pilot import Pilot

from checks.harness.figures import Figure
from checks.harness.observer import Observer, observed
from checks.harness.processes import resident_mb
from checks.speed.ground_station.app_terminal import SIZES, commanding
from ground.app.app import GroundApp
from ground.app.appearance import Appearance
from ground.console.completion import Assistance
from ground.map.scene import MapTarget
from ground.station.station import Station
from protocol.bus.bus import open_bus
from protocol.bus.mailbox import Mailbox, Sample
from protocol.bus.network import Network
from protocol.topics import (
    CYCLE,
    DECISION,
    ENCODING,
    HEARTBEAT,
    ODOMETRY,
    SONAR,
    STATUS,
    TEXT,
    Role,
    Service,
    Topic,
)
from protocol.wire.codec import Encoder
from protocol.wire.enums import GoalState, Mode, Navigator, Severity, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import (
    AvoidanceDecision,
    CycleReport,
    Heartbeat,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
    Statustext,
)
from runtime.clock import ManualClock
from runtime.errors import NoAnswerError

TELEMETRY_HZ: Final = 50
POLL_HZ: Final = 10
STEP_NS: Final = 1_000_000_000 // TELEMETRY_HZ
SIZE: Final = (140, 40)
ROUND_S: Final = 60.0
SAMPLES: Final = 10


class OfflineBus:
    """A bus without network: messages come from `put` only, and requests raise NoAnswerError."""

    def __init__(self) -> None:
        self._boxes: dict[str, list[Mailbox[Any]]] = {}
        self._handlers: dict[str, list[Callable[[str, bytes, int], None]]] = {}
        self._encoder = Encoder(1, 1)

    def mailbox(
        self,
        topic: Topic[Any],
        robot: str | None = None,
        notify: Callable[[int], None] | None = None,
        *,
        take: Callable[[str, bytes, int], None] | None = None,
    ) -> Mailbox[Any]:
        """Return a mailbox of a topic."""
        box = Mailbox(topic, notify)
        self._boxes.setdefault(topic.path, []).append(box)
        if take is not None:
            self._handlers.setdefault(topic.path, []).append(take)
        return box

    def present(self) -> list[Any]:
        """Return the peers: none."""
        return []

    def ask(
        self,
        service: Service,
        message: Message | None = None,
        timeout_s: float = 0.5,
        robot: str | None = None,
    ) -> Message | bytes:
        """Raise NoAnswerError."""
        raise NoAnswerError("there is no robot on this bus")

    def put(self, topic: Topic[Any], message: Message, at_ns: int) -> None:
        """Deliver a message to mailboxes and handlers."""
        frame = self._encoder.encode(message)
        for box in self._boxes.get(topic.path, ()):
            box.store(Sample(ENCODING, frame), at_ns)
        for handle in self._handlers.get(topic.path, ()):
            handle(topic.path, frame, at_ns)


class NoCommands:
    """Ignore every command."""

    last = ""
    draft_items: tuple[MapTarget, ...] = ()

    def begin_world(self, *, keeps_draft: bool) -> None:
        """Do nothing."""

    def run_line(self, line: str) -> None:
        """Ignore a command line."""

    def perform(self, command: object) -> None:
        """Ignore a command."""

    def is_local(self, line: str) -> bool:
        """Return False: no line is local."""
        return False

    def assist(self, text: str) -> Assistance:
        """Return no completions."""
        return Assistance()

    def search(self, words: str) -> Assistance:
        """Return no earlier lines."""
        return Assistance()

    def recall(self, text: str, step: int) -> str:
        """Return the text unchanged."""
        return text

    def begin_teleop(self) -> bool:
        """Refuse to steer."""
        return False

    def steer(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        """Ignore a steering command."""

    def end_teleop(self) -> None:
        """Ignore the end of steering."""


def sizes_mb(minutes: float, lines: int) -> list[float]:
    """Return resident memory in MB at the start and after each tenth."""
    clock, bus = ManualClock(1), OfflineBus()
    station = Station(bus, "r1", clock)
    app = GroundApp(station, NoCommands(), None, Appearance(hz=0.0))
    sizes: list[float] = []
    ticks = round(minutes * 60 * TELEMETRY_HZ)

    async def play(pilot: Pilot[object]) -> None:
        for tick in range(ticks):
            if tick % (ticks // SAMPLES) == 0:
                sizes.append(resident_mb(os.getpid()))
            clock.advance(STEP_NS)
            publish_tick(
                bus, tick, clock.now_ns(), range(lines * tick // ticks, lines * (tick + 1) // ticks)
            )
            if tick % (TELEMETRY_HZ // POLL_HZ) == 0:
                app.sample()
                await asyncio.sleep(0)
        app.sample()
        await pilot.pause()
        sizes.append(resident_mb(os.getpid()))
        app.exit(0)

    app.run(headless=True, size=SIZE, auto_pilot=play)
    if station.log.total < lines:
        raise RuntimeError(f"only {station.log.total} of {lines} lines reached the log")
    return sizes


def publish_tick(bus: OfflineBus, tick: int, now_ns: int, lines: range) -> None:
    """Publish the messages of one tick and these log lines."""
    for topic, message in messages_of_tick(tick, now_ns):
        bus.put(topic, message, now_ns)
    for number in lines:
        text = Statustext(severity=Severity.INFO, text=f"line {number}", id=0, chunk_seq=0)
        bus.put(TEXT, text, now_ns)


def messages_of_tick(tick: int, now_ns: int) -> Iterator[tuple[Topic[Any], Message]]:
    """Yield the telemetry of a robot on a slowly growing spiral."""
    angle_rad = 2.0 * pi * tick / (ROUND_S * TELEMETRY_HZ)
    radius_m = 1.0 + 0.05 * angle_rad
    x_m, y_m = radius_m * cos(angle_rad), radius_m * sin(angle_rad)
    if tick % 10 == 0:
        yield (
            HEARTBEAT,
            Heartbeat(type=10, autopilot=0, base_mode=0, custom_mode=0, system_status=4),
        )
    yield (
        ODOMETRY,
        PlanarOdometry(
            time_ns=now_ns, x_m=x_m, y_m=y_m, heading_rad=(angle_rad + pi / 2) % (2 * pi) - pi,
            speed_m_s=0.3, yaw_rate_rad_s=0.1, cov_xx_m2=1e-3, cov_xy_m2=1e-4,
            cov_xh_m_rad=0.0, cov_yy_m2=1e-3, cov_yh_m_rad=0.0, cov_hh_rad2=1e-3,
        ),
    )  # fmt: skip
    yield (
        STATUS,
        NavigatorStatus(
            time_ns=now_ns, goal_started_ns=1, goal_ended_ns=0, goal_id=7, goal_x_m=9.0,
            goal_y_m=7.0, goal_heading_rad=0.0, goal_distance_m=10.0 - x_m,
            vehicle=Vehicle.ACTIVE, mode=Mode.AUTO,
            goal=GoalState.AVOIDING if tick % 500 < 250 else GoalState.DRIVING,
            vehicle_reason=0, goal_reason=0, navigator=Navigator.VGM, side=1,
        ),
    )  # fmt: skip
    yield from driving_messages(tick, now_ns, (x_m, y_m), angle_rad)


def driving_messages(
    tick: int, now_ns: int, place_m: tuple[float, float], angle_rad: float
) -> Iterator[tuple[Topic[Any], Message]]:
    """Yield decision, cycle report and sonar scan of the same tick."""
    x_m, y_m = place_m
    yield (
        DECISION,
        AvoidanceDecision(
            time_ns=now_ns, nearest_bearing_rad=0.4, nearest_range_m=1.0 + 0.5 * sin(angle_rad),
            zone_m=0.3, goal_bearing_rad=0.1, rotation_rad=0.5 * sin(7 * angle_rad),
            virtual_x_m=x_m + 1.0, virtual_y_m=y_m, speed_m_s=0.3, yaw_rate_rad_s=0.1,
            branch=1, guard=0,
        ),
    )  # fmt: skip
    yield (
        CYCLE,
        CycleReport(
            time_ns=now_ns, tick=tick, missed=0, overruns=0, rejected=0, late_us=tick % 90,
            sense_age_us=9000, budget_us=2500, stage_us=(80, 12, 100 + tick % 50, 9, 150),
        ),
    )  # fmt: skip
    near_mm = tuple(600 + (tick * (3 + sonar)) % 1500 for sonar in range(8))
    yield (
        SONAR,
        SonarScan(
            time_ns=now_ns, seq=tick, range_mm=near_mm, ping_age_us=(0,) * 8, valid=255, echo=255
        ),
    )


WORLD: Final = "forest_medium"
GROWTH_AT_MOST_MB: Final = 15.0
KEY_AT_MOST_MS: Final = 100.0
LINES_PER_S: Final = 5000
BURST_S: Final = 0.02
TURNS: Final = (("4", "Severity"), ("1", "Command"))
"""A key, and a word that only the key bar of its screen contains."""
APART_S: Final = 0.4


def long_run_figures(options: argparse.Namespace) -> tuple[list[Figure], list[str]]:
    """Measure growth of memory and key latency."""
    sizes = sizes_mb(options.minutes, options.lines)
    name = f"{options.minutes:g} min at 50 Hz, {options.lines} lines"
    with observed(WORLD) as observer:
        during_ms, after_ms, grown_mb = during_flood(observer, options.lines, options.presses_after)
    figures = [
        Figure(
            name=f"growth, {name}",
            unit="MB",
            values=(sizes[-1] - sizes[1],),
            at_most=GROWTH_AT_MOST_MB,
        ),
        Figure(
            name="growth of its second half",
            unit="MB",
            values=(sizes[-1] - sizes[len(sizes) // 2],),
        ),
        Figure(name="key to screen, in the flood", unit="ms", values=tuple(during_ms)),
        Figure(
            name="key to screen, after it",
            unit="ms",
            values=tuple(after_ms),
            at_most=KEY_AT_MOST_MS,
        ),
        Figure(name="growth of the process in the flood", unit="MB", values=(grown_mb,)),
    ]
    tenths = ", ".join(f"{size:.0f}" for size in sizes)
    return figures, [
        f"resident after each tenth of {name}, MB: {tenths}; growth counts from the first",
        f"flood: {options.lines} lines of log at {LINES_PER_S} a second over the bus, at 140x40",
    ]


def during_flood(
    observer: Observer, lines: int, presses_after: int
) -> tuple[list[float], list[float], float]:
    """Return key latencies in ms during the flood and after it, and growth in MB."""
    with commanding(observer, SIZES[1]) as terminal:
        before_mb, flood = (
            resident_mb(terminal.pid),
            Thread(target=publish_lines, args=(observer, lines)),
        )
        flood.start()
        during_ms: list[float] = []
        after_ms: list[float] = []
        while flood.is_alive() or len(after_ms) < presses_after:
            into = during_ms if flood.is_alive() else after_ms
            for key, words in TURNS:
                terminal.forget()
                at_ns = terminal.type(key)
                into.append((terminal.shown(words, 10.0) - at_ns) / 1e6)
                Event().wait(APART_S)
        return during_ms, after_ms, resident_mb(terminal.pid) - before_mb


def publish_lines(observer: Observer, lines: int) -> None:
    """Publish log lines as the robot."""
    network, pause = Network(mode="client", connect=(observer.endpoint,)), Event()
    burst = round(LINES_PER_S * BURST_S)
    with open_bus(network, Role.ROBOT, observer.robot) as bus:
        texts = bus.publisher(TEXT)
        for number in range(lines):
            words = f"line {number} of {lines}"
            texts.put(Statustext(severity=Severity.INFO, text=words, id=0, chunk_seq=0))
            if number % burst == 0:
                pause.wait(BURST_S)
