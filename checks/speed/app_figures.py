"""Cost and latency of the app on a terminal with a real robot.

CPU time is the kernel's figure of the app's process, at ten frames a second: driving, idle, paused,
on a slow line. Output is counted and keys are pressed at the other end of its pty. An observer on
the robot's bus sees the reaction, and the distance rolled. A hold has acted when the robot's mode
is HOLD: from that tick on its wheels slow down as fast as permitted. An e-stop has acted when the
wheels are commanded to zero.

The start counts until a screen has the robot's name. Bare Python and Python with Textual are
started in turn with the app, so that all meet the same load.

Memory is that of minutes of telemetry at 50 Hz on simulated time, with key latency while 100 000
log lines arrive.
"""

import argparse
import asyncio
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from math import cos, hypot, pi, sin
from pathlib import Path
from random import Random
from threading import Event, Thread
from time import monotonic_ns
from types import SimpleNamespace
from typing import Any, Final, TypeVar

from textual.pilot import Pilot

from checks.harness.figures import BenchmarkReport, Figure, figure
from checks.harness.messages import make
from checks.harness.observer import PATIENCE_S, Observer, Shuttle, apart_m, observed
from checks.harness.processes import resident_mb
from checks.harness.terminal import Spent, Terminal
from checks.harness.until import until
from checks.speed import fleet
from ground.app.app import GroundApp
from ground.app.appearance import Appearance
from ground.console.completion import Assistance
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
from protocol.wire.enums import GoalState, Mode, Severity, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import (
    AvoidanceDecision,
    CycleReport,
    GroundTruth,
    Heartbeat,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
    Statustext,
    WheelCommand,
)
from runtime.clock import ManualClock
from runtime.errors import NoAnswerError
from runtime.units import NS_PER_S, PERIOD_MS, PERIOD_S

SIZES: Final = ((80, 24), (140, 40))
READY: Final = "read: ready"
REPLAYING: Final = "REPLAY"
RECORDINGS: Final = Path("sidestep") / "recordings"
APP_PATIENCE_S: Final = 30.0


@contextmanager
def on_terminal(
    observer: Observer,
    size: tuple[int, int],
    *,
    bytecode: Path | None = None,
) -> Iterator[Terminal]:
    """Start `sidestep ground` with a state folder of its own.

    With `bytecode` compiled modules are kept there, as in an installation.
    """
    words = ("ground", "--id", observer.robot, "--connect", observer.endpoint)
    environment = {"XDG_STATE_HOME": str(observer.folder)}
    if bytecode is not None:
        environment["PYTHONPYCACHEPREFIX"] = str(bytecode)
    with Terminal(words, size, environment) as terminal:
        yield terminal


@contextmanager
def commanding(observer: Observer, size: tuple[int, int]) -> Iterator[Terminal]:
    """Start the app and wait until it has read all that it needs."""
    with on_terminal(observer, size) as terminal:
        terminal.shown(READY, APP_PATIENCE_S)
        yield terminal


@contextmanager
def replaying(observer: Observer, size: tuple[int, int]) -> Iterator[Terminal]:
    """Show the latest recording without playing it."""
    path = max((observer.folder / RECORDINGS).glob("*.mcap"), key=lambda path: path.stat().st_size)
    environment = {"XDG_STATE_HOME": str(observer.folder)}
    with Terminal(("replay", str(path)), size, environment) as terminal:
        terminal.shown(REPLAYING, APP_PATIENCE_S)
        yield terminal


M = TypeVar("M", bound=Message)
"""Keys are pressed at random phases of it, as the observer is in step with the robot."""
MIN_DRIVING_M_S: Final = 0.28
MAX_STILL_M_S: Final = 0.003
AGAIN_S: Final = 2.0
SETTLES_S: Final = 0.2
"""Time for the app to receive the reply: it sends one request at a time."""
ATTEMPTS: Final = 20
PLACES: Final = ((5.2, 2.4), (0.8, 1.6))
"""Distant goals in the open world."""


@dataclass(slots=True)
class Presses:
    """Results per key press: time to reaction and to wheels at zero (ms), distance rolled (m)."""

    acted_ms: list[float] = field(default_factory=list)
    wheels_ms: list[float] = field(default_factory=list)
    rolled_m: list[float] = field(default_factory=list)


class TerminalOperator:
    """Type keys as an operator and observe the reaction."""

    def __init__(self, terminal: Terminal, observer: Observer) -> None:
        self._terminal, self._observer = terminal, observer
        self._random = Random(1)

    def presses(self, key: str, release: Callable[[], None], times: int) -> Presses:
        """Press a key while the robot drives, then release it; repeat."""
        found = Presses()
        for _ in range(times):
            self.drive()
            Event().wait(self._random.uniform(0.0, PERIOD_S))
            at_ns = self._terminal.type(key)
            self._note(found, at_ns, stopped if key == " " else held)
            release()
        return found

    def resume(self) -> None:
        """Resume; if the goal was just reached, `drive` gives another one."""
        self._terminal.type("r")
        with suppress(RuntimeError):
            self._until(lambda status: status.mode == Mode.GUIDED, "resumed", AGAIN_S)

    def clear(self) -> None:
        """Clear the e-stop."""
        self._terminal.type("DD")
        self._until(lambda status: status.vehicle == Vehicle.STANDBY, "e-stop cleared", PATIENCE_S)
        Event().wait(SETTLES_S)

    def drive(self) -> None:
        """Drive at full speed; give another goal after one that has ended."""
        for _ in range(ATTEMPTS):
            if self._observer.status.vehicle == Vehicle.FAILSAFE:
                self._leave_failsafe()
            if not self._observer.on_its_way:
                x_m, y_m = self._farthest()
                self._terminal.type(f":goal {x_m:g} {y_m:g}\r")
            elif self._observer.status.mode == Mode.HOLD:
                self._terminal.type("r")
            with suppress(RuntimeError):
                until(self._fast, "driving", AGAIN_S)
                return
        raise RuntimeError(f"the robot does not drive: {self._terminal.text()[-500:]!r}")

    def _farthest(self) -> tuple[float, float]:
        """Return the farther place: a robot that stopped on its way there need not turn round."""
        truth = self._observer.truths[-1][0]
        return max(PLACES, key=lambda place: hypot(place[0] - truth.x_m, place[1] - truth.y_m))

    def _leave_failsafe(self) -> None:
        """Disarm after a failsafe: a busy machine may delay samples past their limit."""
        self._terminal.type("A")
        with suppress(RuntimeError):
            self._until(lambda status: status.vehicle == Vehicle.STANDBY, "disarmed", AGAIN_S)

    def _fast(self) -> bool:
        return self._observer.speed_m_s > MIN_DRIVING_M_S

    def _until(
        self, condition: Callable[[NavigatorStatus], bool], what: str, within_s: float
    ) -> None:
        until(lambda: condition(self._observer.status), what, within_s)

    def _note(self, found: Presses, at_ns: int, acted: Callable[[Message], bool]) -> None:
        seen = self._observer
        until(lambda: first(seen.wheels, at_ns, stopped), "wheels commanded to zero")
        until(lambda: first(seen.truths, at_ns, still), "at rest")
        acts = first([*seen.statuses, *seen.wheels], at_ns, acted)
        wheels = first(seen.wheels, at_ns, stopped)
        before = [truth for truth, arrived_ns in tuple(seen.truths) if arrived_ns <= at_ns][-1]
        after = seen.truths[-1][0]
        assert acts is not None
        assert wheels is not None
        found.acted_ms.append((acts - at_ns) / 1e6)
        found.wheels_ms.append((wheels - at_ns) / 1e6)
        found.rolled_m.append(apart_m(before, after))


def first(
    seen: Iterable[tuple[Message, int]], after_ns: int, condition: Callable[[Message], bool]
) -> int | None:
    """Return when the first such message after a moment arrived."""
    arrivals = [at_ns for message, at_ns in tuple(seen) if at_ns > after_ns and condition(message)]
    return min(arrivals, default=None)


def held(message: Message) -> bool:
    """Return whether the robot reports HOLD."""
    return isinstance(message, NavigatorStatus) and message.mode == Mode.HOLD


def stopped(message: Message) -> bool:
    """Return whether the wheels are commanded to zero."""
    return isinstance(message, WheelCommand) and not (message.left_mrad_s or message.right_mrad_s)


def still(message: Message) -> bool:
    """Return whether the robot is at rest."""
    return isinstance(message, GroundTruth) and abs(message.speed_m_s) < MAX_STILL_M_S


KEY_WORLD: Final = "open"
SLACK_MS: Final = 5.0
HOLD, ESTOP = "h", " "


def key_figures(options: argparse.Namespace) -> tuple[list[Figure], list[str]]:
    """Measure hold and e-stop."""
    with observed(KEY_WORLD) as observer, commanding(observer, SIZES[0]) as terminal:
        operator = TerminalOperator(terminal, observer)
        holds = operator.presses(HOLD, operator.resume, options.presses)
        stops = operator.presses(ESTOP, operator.clear, options.presses)
    notes = [
        "from the write of the key into the pty to what an observer on the bus receives;"
        " one period is 50 ms",
        "hold has acted when the robot reports HOLD: the wheels slow down from that tick on;"
        " e-stop when the wheels are commanded to zero",
        "rolled: true distance from the last sample before the key to rest, at 0.3 m/s",
    ]
    return [*key_figures_of("hold", holds), *key_figures_of("e-stop", stops)], notes


def key_figures_of(name: str, found: Presses) -> list[Figure]:
    """Return the figures of one key."""
    worst_ms = max(found.acted_ms)
    return [
        figure(f"{name}: key to robot acts", found.acted_ms, "ms", at_most=PERIOD_MS + SLACK_MS),
        figure(
            f"{name}: key to robot acts, worst", worst_ms, "ms", at_most=2 * PERIOD_MS + SLACK_MS
        ),
        figure(f"{name}: key to wheels at zero", found.wheels_ms, "ms"),
        figure(f"{name}: rolled", found.rolled_m, "m"),
    ]


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


def no_commands() -> Any:
    """Return commands of which none is ever given."""
    ignored = dict.fromkeys(("begin_world", "run_line", "perform"), lambda *_, **__: None)
    return SimpleNamespace(last="", draft_items=(), assist=lambda _: Assistance(), **ignored)


def sizes_mb(minutes: float, lines: int) -> list[float]:
    """Return resident memory in MB at the start and after each tenth."""
    clock, bus = ManualClock(1), OfflineBus()
    station = Station(bus, "r1", clock)
    app = GroundApp(station, no_commands(), None, Appearance(hz=0.0))
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
    speed = {"time_ns": now_ns, "speed_m_s": 0.3, "yaw_rate_rad_s": 0.1}
    sigmas = dict.fromkeys(("cov_xx_m2", "cov_yy_m2", "cov_hh_rad2"), 1e-3)
    heading_rad = (angle_rad + pi / 2) % (2 * pi) - pi
    place = {"x_m": x_m, "y_m": y_m, "heading_rad": heading_rad, "cov_xy_m2": 1e-4}
    goal = {"goal_x_m": 9.0, "goal_y_m": 7.0, "goal_distance_m": 10.0 - x_m, "mode": Mode.AUTO}
    state = GoalState.AVOIDING if tick % 500 < 250 else GoalState.DRIVING
    times = {"time_ns": now_ns, "goal_started_ns": 1, "goal_id": 7}
    seen = {"nearest_bearing_rad": 0.4, "nearest_range_m": 1.0 + 0.5 * sin(angle_rad)}
    turn = {"zone_m": 0.3, "goal_bearing_rad": 0.1, "rotation_rad": 0.5 * sin(7 * angle_rad)}
    virtual = {"virtual_x_m": x_m + 1.0, "virtual_y_m": y_m, "branch": 1}
    cost = {"sense_age_us": 9000, "budget_us": 2500, "late_us": tick % 90, "tick": tick}
    stages_us = (80, 12, 100 + tick % 50, 9, 150)
    near_mm = tuple(600 + (tick * (3 + sonar)) % 1500 for sonar in range(8))
    if tick % 10 == 0:
        yield HEARTBEAT, make(Heartbeat)
    yield ODOMETRY, make(PlanarOdometry, **speed, **place, **sigmas)
    yield STATUS, make(NavigatorStatus, **times, **goal, goal=state)
    yield DECISION, make(AvoidanceDecision, **speed, **seen, **turn, **virtual)
    yield CYCLE, make(CycleReport, time_ns=now_ns, stage_us=stages_us, **cost)
    yield SONAR, make(SonarScan, time_ns=now_ns, seq=tick, range_mm=near_mm, echo=255)


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
        figure(f"growth, {name}", sizes[-1] - sizes[1], "MB", at_most=GROWTH_AT_MOST_MB),
        figure("growth of its second half", sizes[-1] - sizes[len(sizes) // 2], "MB"),
        figure("key to screen, in the flood", during_ms, "ms"),
        figure("key to screen, after it", after_ms, "ms", at_most=KEY_AT_MOST_MS),
        figure("growth of the process in the flood", grown_mb, "MB"),
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


CPU_AT_MOST: Final = (10.0, 16.0)
KB_AT_MOST: Final = (60.0, 120.0)
SLOW_LINE: Final = 20_000
SLOW_KEY_AT_MOST_MS: Final = 1000.0


def cost_figures(options: argparse.Namespace) -> tuple[list[Figure], list[str]]:
    """Measure CPU share and output of one app in each situation, then of a replay."""
    figures: list[Figure] = []
    with observed(WORLD) as observer:
        with commanding(observer, SIZES[0]) as terminal:
            with keep_driving(observer):
                for size, cpu, kb in zip(SIZES, CPU_AT_MOST, KB_AT_MOST, strict=True):
                    terminal.resize(size)
                    found = readings(terminal, options, options.repetitions)
                    figures += figures_of(f"driving, {size[0]}x{size[1]}", found, cpu, kb)
                figures += on_a_slow_line(terminal, options)
            terminal.resize(SIZES[0])
            observer.hold()
            figures += figures_of("standing, 80x24", readings(terminal, options, 1))
            observer.pause()
            figures += figures_of("paused, 80x24", readings(terminal, options, 1))
        with replaying(observer, SIZES[0]) as terminal:
            still = readings(terminal, options, 1)
        figures += figures_of("nothing changes, 80x24", still, None, 0.0)
    notes = [
        f"10 frames a second; each reading {options.seconds:g} s; in {WORLD}, with noise",
        "nothing changes: a recording that is shown but not played",
        "paused: simulated time is stopped; the robot continues and reports the cost of its cycles",
        f"slow line: the app's output is read at {SLOW_LINE // 1000} kB/s; from the key that shows"
        " or hides the goal cursor until the key bar shows it",
    ]
    return figures, notes


def readings(terminal: Terminal, options: argparse.Namespace, times: int) -> list[Spent]:
    """Return the readings of an app that has settled."""
    Event().wait(options.settle)
    return [terminal.spent(options.seconds) for _ in range(times)]


def figures_of(
    name: str, found: list[Spent], cpu: float | None = None, kb: float | None = None
) -> list[Figure]:
    """Return the figures of one situation."""
    shares = tuple(one.cpu_percent for one in found)
    rates = tuple(one.kb_per_s for one in found)
    return [
        figure(f"CPU of one core, {name}", shares, "%", at_most=cpu),
        figure(f"written, {name}", rates, "kB/s", at_most=kb),
    ]


def on_a_slow_line(terminal: Terminal, options: argparse.Namespace) -> list[Figure]:
    """Measure at the larger size, which has the most output."""
    waits_ms = []
    with terminal.slow(SLOW_LINE):
        Event().wait(2 * options.settle)
        spent = terminal.spent(options.seconds)
        for turn in range(options.slow_presses):
            terminal.forget()
            key, words = (("G", "Heading"), ("\x1b", "Command"))[turn % 2]
            at_ns = terminal.type(key)
            waits_ms.append((terminal.shown(words, 10.0) - at_ns) / 1e6)
            Event().wait(options.settle / 3)
    name = "slow line, 140x40"
    return [
        figure(f"written, {name}", spent.kb_per_s, "kB/s"),
        figure(f"key to screen, {name}", waits_ms, "ms", at_most=SLOW_KEY_AT_MOST_MS),
    ]


@contextmanager
def keep_driving(observer: Observer) -> Iterator[None]:
    """Keep the robot driving between start and goal in a thread, until the block ends."""
    over, shuttle = Event(), Shuttle(observer)

    def drive() -> None:
        while not over.wait(0.05):
            shuttle.keep_driving()

    thread = Thread(target=drive, daemon=True)
    thread.start()
    until(lambda: observer.on_its_way, "on its way")
    try:
        yield
    finally:
        over.set()
        thread.join()


AT_MOST_S: Final = 0.6
PAINTED: Final = "Palette"
"""Last word of the key bar, which is the last row."""
FLOORS: Final = ("pass", "import textual.app")


def paint_figures(options: argparse.Namespace) -> tuple[list[Figure], list[str]]:
    """Measure the first paint and its baselines."""
    with observed(WORLD) as observer, tempfile.TemporaryDirectory() as bytecode:
        in_turn(observer, Path(bytecode))  # compiles the imported modules
        rows = [in_turn(observer, Path(bytecode)) for _ in range(options.starts)]
    names = ["first paint", "first bytes", *(f"python -c '{line}'" for line in FLOORS)]
    figures = [
        figure(
            name, [row[at] for row in rows], "s", at_most=AT_MOST_S if name == names[0] else None
        )
        for at, name in enumerate(names)
    ]
    quotients = tuple(row[0] / row[3] for row in rows)
    figures.append(figure(f"first paint / '{FLOORS[1]}'", quotients, "x"))
    figures.append(figure("CPU time until the first paint", [r[4] for r in rows], "s"))
    return figures, [
        "first paint: the whole screen, with the robot found, at 80x24; its modules compiled before"
    ]


def in_turn(observer: Observer, bytecode: Path) -> tuple[float, float, float, float, float]:
    """Return seconds to paint and to first output, of both baselines, and CPU time until paint."""
    with on_terminal(observer, SIZES[0], bytecode=bytecode) as terminal:
        painted_ns = terminal.shown(PAINTED, PATIENCE_S)
        cost_s = terminal.reading().cpu_s
        paint_s, first_s = (
            (at_ns - terminal.begun_ns) / NS_PER_S for at_ns in (painted_ns, terminal.first_ns)
        )
    bare_s, textual_s = (took_s(line, bytecode) for line in FLOORS)
    return paint_s, first_s, bare_s, textual_s, cost_s


def took_s(line: str, bytecode: Path) -> float:
    """Return the time that Python takes to run one line."""
    environment = {**os.environ, "PYTHONPYCACHEPREFIX": str(bytecode)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    begun_ns = monotonic_ns()
    subprocess.run([sys.executable, "-c", line], check=True, env=environment)
    return (monotonic_ns() - begun_ns) / NS_PER_S


PARTS: Final = {
    "paint": paint_figures,
    "cost": cost_figures,
    "keys": key_figures,
    "crowd": long_run_figures,
    "fleet": fleet.fleet_figures,
    "watch": fleet.watch_figures,
}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--parts", nargs="+", choices=list(PARTS), default=list(PARTS))
    parser.add_argument("--robots", type=int, default=12, help="of the part `fleet`")
    parser.add_argument("--watched", type=int, default=100, help="robots of the part `watch`")
    parser.add_argument("--seconds", type=float, default=20.0, help="of each reading of the cost")
    parser.add_argument("--settle", type=float, default=3.0, help="seconds before each reading")
    parser.add_argument("--slow-presses", type=int, default=10, help="of a key on a slow line")
    parser.add_argument("--repetitions", type=int, default=3, help="of each reading of the cost")
    parser.add_argument("--starts", type=int, default=10, help="first paints")
    parser.add_argument("--presses", type=int, default=200, help="of hold, and of the e-stop")
    parser.add_argument("--minutes", type=float, default=10.0, help="of telemetry at 50 Hz")
    parser.add_argument("--lines", type=int, default=100_000, help="of log")
    parser.add_argument("--presses-after", type=int, default=20, help="of keys after these lines")


def measure(options: argparse.Namespace) -> BenchmarkReport:
    """Measure the selected parts."""
    return BenchmarkReport.of("ground", (PARTS[name](options) for name in options.parts))
