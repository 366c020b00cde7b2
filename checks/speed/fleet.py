"""The app beside a whole fleet that drives: CPU time, missed ticks, and the stop of all robots.

The stop counts from the key in the terminal to the last wheel that stands.
"""

import argparse
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from threading import Event, Lock, Thread
from time import monotonic_ns
from typing import Final

from checks.endurance.fleet import GoalSender, RobotTelemetry
from checks.harness.figures import BenchmarkReport, Figure, figure
from checks.harness.observer import Seen, standing_from, stood_s
from checks.harness.operator import ThreadedOperator
from checks.harness.played_fleet import played_fleet
from checks.harness.processes import resident_mb
from checks.harness.terminal import Terminal
from checks.harness.until import until
from ground.cli.main import parse
from ground.cli.run.up import free_endpoint
from ground.launch.child_processes import Children
from ground.launch.scenario import process_arguments, run_of, scenario_of
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network
from protocol.topics import CYCLE, ODOMETRY, SONAR, STATUS, TRUTH, Role
from protocol.wire.codec import decode
from protocol.wire.messages import GroundTruth
from runtime.clock import WallClock
from runtime.units import NS_PER_S, PERIOD_S

WORLD: Final = "open"
SIZE: Final = (80, 24)
SIZES: Final = (SIZE, (140, 40))
CPU_AT_MOST: Final = 25.0
DRAWN: Final = "pose"
"""A word that is on the screen before many lines of the log hide that the app is ready."""
LISTENS_S: Final = 30.0
PATIENCE_S: Final = 60.0
POLL_S: Final = 0.05


class DrivingFleet:
    """Robots that keep driving; `missed` counts their missed ticks."""

    def __init__(self, endpoint: str, robots: tuple[str, ...], bus: Bus) -> None:
        self.endpoint, self.robots = endpoint, robots
        self._telemetry = {robot: RobotTelemetry(monotonic_ns()) for robot in robots}
        for robot, telemetry in self._telemetry.items():
            for topic in (CYCLE, STATUS, ODOMETRY, SONAR):
                bus.stream(topic, telemetry.record, robot)
        self._senders = [GoalSender(bus, robot) for robot in robots]

    def is_complete(self) -> bool:
        """Return whether every robot has been received."""
        return all(one.pose is not None and one.ticks for one in self._telemetry.values())

    def keep_driving(self, over: Event) -> None:
        """Send goals until `over` is set."""
        while not over.wait(POLL_S):
            for sender in self._senders:
                sender.poll(self._telemetry[sender.robot], monotonic_ns())

    def ticks(self) -> tuple[int, int]:
        """Return the ticks so far, and those that were missed."""
        ticks = [missed for one in self._telemetry.values() for _, missed in one.ticks]
        return len(ticks), sum(ticks)


@contextmanager
def driving_fleet(robots: int, folder: Path, world: str = WORLD) -> Iterator[DrivingFleet]:
    """Start a router, robots and their plant as `up` does in wall time, and keep them driving."""
    words = ["up", "--headless", "--clock", "wall", "--world", world, "--robots", str(robots)]
    options = parse([*words, "--router", "--no-record"])
    scenario = scenario_of(options, run_of(options))
    endpoint, over = free_endpoint(), Event()
    with ExitStack() as scope:
        children = scope.enter_context(Children(WallClock()))
        for role, arguments in process_arguments(scenario, endpoint):
            children.start(role, arguments)
        network = Network(mode="client", connect=(endpoint,), connect_timeout_s=LISTENS_S)
        bus = scope.enter_context(open_bus(network, Role.GROUND, "r1"))
        fleet = DrivingFleet(endpoint, scenario.robots, bus)
        until(fleet.is_complete, "telemetry of every robot", within_s=PATIENCE_S)
        thread = Thread(target=fleet.keep_driving, args=(over,), daemon=True)
        thread.start()
        try:
            yield fleet
        finally:
            over.set()
            thread.join()


def fleet_figures(options: argparse.Namespace) -> tuple[list[Figure], list[str]]:
    """Measure CPU share, output and missed ticks, without the app and with it."""
    with TemporaryDirectory() as folder, driving_fleet(options.robots, Path(folder)) as fleet:
        Event().wait(options.settle)
        alone = missed_in(fleet, options.seconds)
        words = ("ground", "--id", "r1", "--connect", fleet.endpoint)
        with Terminal(words, SIZE, {"XDG_STATE_HOME": folder}) as terminal:
            terminal.shown(DRAWN, PATIENCE_S)
            Event().wait(options.settle)
            before = fleet.ticks()
            spent = [terminal.spent(options.seconds) for _ in range(options.repetitions)]
            after = fleet.ticks()
    shares = tuple(one.cpu_percent for one in spent)
    name = f"{options.robots} robots, 80x24"
    figures = [
        figure(f"CPU of one core, {name}", shares, "%", at_most=CPU_AT_MOST),
        figure(f"written, {name}", [one.kb_per_s for one in spent], "kB/s"),
        figure(f"ticks missed with the app, {name}", after[1] - before[1], "ticks"),
        figure(f"ticks missed before it, {name}", alone, "ticks"),
    ]
    return figures, [
        f"fleet: {options.robots} robots at 20 Hz in {WORLD}, all driving, in wall time;"
        f" {after[0] - before[0]} ticks with the app"
    ]


WATCHED_MB_AT_MOST: Final = 120.0
SETTLES_S: Final = 8.0


def watch_figures(options: argparse.Namespace) -> tuple[list[Figure], list[str]]:
    """Measure the app that watches many robots, whose topics are played at their rates."""
    endpoint, robots = free_endpoint(), options.watched
    figures, played = [], []
    with TemporaryDirectory() as folder, played_fleet(robots, endpoint) as fleet:
        words = ("ground", "--id", "r1", "--connect", endpoint)
        with Terminal(words, SIZES[0], {"XDG_STATE_HOME": folder}) as terminal:
            terminal.shown(DRAWN, PATIENCE_S)
            for size in SIZES:
                terminal.resize(size)
                Event().wait(SETTLES_S)
                before = fleet[0].ticks
                spent = [terminal.spent(options.seconds) for _ in range(options.repetitions)]
                waited_s = options.seconds * options.repetitions
                played.append((fleet[0].ticks - before) / waited_s)
                name = f"watching {robots} robots, {size[0]}x{size[1]}"
                shares = tuple(one.cpu_percent for one in spent)
                resident = resident_mb(terminal.pid)
                figures += [
                    figure(f"CPU of one core, {name}", shares, "%", at_most=CPU_AT_MOST),
                    figure(f"written, {name}", [one.kb_per_s for one in spent], "kB/s"),
                    figure(f"memory, {name}", resident, "MB", at_most=WATCHED_MB_AT_MOST),
                ]
    rates = " and ".join(f"{rate:.1f}" for rate in played)
    return figures, [f"watch: the topics of {robots} robots are played, r1 at {rates} Hz of 20"]


def missed_in(fleet: DrivingFleet, seconds: float) -> int:
    """Return the ticks that were missed in the next so many seconds."""
    before = fleet.ticks()[1]
    Event().wait(seconds)
    return fleet.ticks()[1] - before


KEY: Final = "S"
AT_MOST_MS: Final = 150.0
MIN_DRIVING_M_S: Final = 0.1
"""Keys are pressed at random phases of the control period."""
STANDS_S: Final = 10.0
DRIVES_S: Final = 60.0


class Wheels:
    """The true motion of each robot; `since` returns it from a key press on."""

    def __init__(self, bus: Bus, robots: tuple[str, ...]) -> None:
        self._lock = Lock()
        self._seen: dict[str, list[tuple[int, GroundTruth]]] = {robot: [] for robot in robots}
        for robot in robots:
            bus.stream(TRUTH, self._note, robot)

    def _note(self, key: str, frame: bytes, arrived_ns: int) -> None:
        message, robot = decode(frame).message, key.split("/")[-3]
        if isinstance(message, GroundTruth):
            with self._lock:
                self._seen[robot].append((arrived_ns, message))

    def forget(self) -> None:
        """Forget all motion so far."""
        with self._lock:
            for seen in self._seen.values():
                seen.clear()

    def all_drive(self) -> bool:
        """Return whether the newest sample of every robot shows it driving."""
        with self._lock:
            return all(
                seen and seen[-1][1].speed_m_s > MIN_DRIVING_M_S for seen in self._seen.values()
            )

    def since(self, pressed_ns: int) -> dict[str, list[Seen]]:
        """Return the motion of each robot from a moment on, with times since then."""
        with self._lock:
            return {
                robot: [
                    Seen((at - pressed_ns) / NS_PER_S, one) for at, one in seen if at > pressed_ns
                ]
                for robot, seen in self._seen.items()
            }

    def all_stand(self, pressed_ns: int) -> bool:
        """Return whether every robot has come to rest since a moment."""
        return all(standing_from(seen) is not None for seen in self.since(pressed_ns).values())


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--robots", type=int, default=6)
    parser.add_argument("--presses", type=int, default=200, help="of the key that stops all (200)")


def measure(options: argparse.Namespace) -> BenchmarkReport:
    """Press the key while all robots drive, and wait until each stands; release and repeat."""
    worst_ms: list[float] = []
    of_robot: dict[str, list[float]] = {}
    random = Random(1)
    with TemporaryDirectory() as folder, driving_fleet(options.robots, Path(folder)) as fleet:
        network = Network(mode="client", connect=(fleet.endpoint,), connect_timeout_s=PATIENCE_S)
        words = ("ground", "--id", "r1", "--connect", fleet.endpoint, "--quiet-bell")
        with (
            open_bus(network, Role.GROUND, "r1") as bus,
            ThreadedOperator(bus, "r1") as operator,
            Terminal(words, SIZE, {"XDG_STATE_HOME": folder}) as terminal,
        ):
            wheels = Wheels(bus, fleet.robots)
            terminal.shown(DRAWN, PATIENCE_S)
            for _ in range(options.presses):
                took_ms = one_press(terminal, wheels, operator, random)
                worst_ms.append(max(took_ms.values()))
                for robot, ms in took_ms.items():
                    of_robot.setdefault(robot, []).append(ms)
    return BenchmarkReport(
        benchmark="stop_all",
        figures=tuple(figures_of(worst_ms, of_robot)),
        notes=notes_of(fleet, options.presses),
    )


def one_press(
    terminal: Terminal, wheels: Wheels, operator: ThreadedOperator, random: Random
) -> dict[str, float]:
    """Press the key, and return the time in ms until the wheels of each robot stood."""
    until(wheels.all_drive, "all robots driving", within_s=DRIVES_S)
    Event().wait(random.uniform(0.0, PERIOD_S))
    wheels.forget()
    pressed_ns = terminal.type(KEY)
    until(lambda: wheels.all_stand(pressed_ns), "all robots at rest", within_s=STANDS_S)
    took_ms = {
        robot: (stood_s(seen) or 0.0) * 1e3 for robot, seen in wheels.since(pressed_ns).items()
    }
    released = operator.wait(operator.robot.clear_emergency_stop_all({}))
    if not released.ok:
        raise RuntimeError(released.text)
    return took_ms


def figures_of(worst_ms: list[float], of_robot: dict[str, list[float]]) -> list[Figure]:
    """Return the figures of the last wheel of each press, and of each robot."""
    last = "key to the last wheel standing"
    return [
        figure(last, worst_ms, "ms"),
        figure(f"{last}, worst", max(worst_ms), "ms", at_most=AT_MOST_MS),
        *(
            figure(f"{robot}: key to wheels standing, worst", max(ms), "ms")
            for robot, ms in sorted(of_robot.items())
        ),
    ]


def notes_of(fleet: DrivingFleet, presses: int) -> tuple[str, ...]:
    """Return the notes below the figures: the setting, and how each press was timed."""
    return (
        f"{len(fleet.robots)} robots driving in wall time, {presses} presses of {KEY} in the app",
        "from the write of the key into the pty to the beginning of the first period without"
        " motion of the last robot, as the plant's truth shows it",
    )
